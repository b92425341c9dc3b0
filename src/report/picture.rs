//! A part of a frame as a PNG.

use crate::image::{Frame, FrameMeta, Image};
use base64::prelude::{BASE64_STANDARD, Engine as _};

/// Maximum side of a picture on the page, px. Larger parts of a frame are averaged down to it.
const MAX_SIDE_PX: usize = 360;

/// A part of a frame, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Crop {
    /// First column.
    pub(super) x: usize,
    /// First row.
    pub(super) y: usize,
    /// Columns.
    pub(super) width: usize,
    /// Rows.
    pub(super) height: usize,
}

impl Crop {
    /// Returns the square with half side `half_px` about a point, clipped to the frame.
    ///
    /// It is the whole frame without a point, or for a half side below 1 px.
    pub(super) fn about(center: Option<[f64; 2]>, half_px: f64, meta: &FrameMeta) -> Self {
        let (width, height) = (meta.width_px as usize, meta.height_px as usize);
        let span = |at: f64, size: usize| {
            let from = (at - half_px).floor().clamp(0.0, size as f64 - 1.0) as usize;
            let to = (at + half_px).ceil().clamp(from as f64, size as f64 - 1.0) as usize;
            (from, to - from + 1)
        };
        match center {
            Some([x, y]) if half_px >= 1.0 => {
                let ((x, width), (y, height)) = (span(x, width), span(y, height));
                Self { x, y, width, height }
            }
            _ => Self { x: 0, y: 0, width, height },
        }
    }
}

/// Encodes a part of a frame as an 8-bit grey PNG, stretched from black to white, averaged down to [`MAX_SIDE_PX`].
///
/// Returns `None` for a frame that does not unpack.
///
/// # Panics
///
/// If the part exceeds the frame.
pub(super) fn encode_png(meta: FrameMeta, bytes: &[u8], crop: Crop) -> Option<Vec<u8>> {
    let mut image = Image::default();
    Frame { meta, bytes }.unpack(&mut image).ok()?;
    let view = image.view();
    let side = crop.width.max(crop.height).div_ceil(MAX_SIDE_PX).max(1);
    let (columns, rows) = (crop.width.div_ceil(side), crop.height.div_ceil(side));
    let mean = |column: usize, row: usize| {
        let (x, y) = (crop.x + column * side, crop.y + row * side);
        let (right, low) = ((x + side).min(crop.x + crop.width), (y + side).min(crop.y + crop.height));
        let sum: f32 = (y..low).flat_map(|y| &view.row(y)[x..right]).sum();
        sum / ((right - x) * (low - y)) as f32
    };
    let levels: Vec<f32> =
        (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))).map(|(c, r)| mean(c, r)).collect();
    let low = levels.iter().copied().fold(f32::INFINITY, f32::min);
    let range = (levels.iter().copied().fold(0.0, f32::max) - low).max(1.0);
    let grey: Vec<u8> = levels.iter().map(|level| (255.0 * (level - low) / range).round() as u8).collect();
    crate::image::encode_png(&image::GrayImage::from_raw(columns as u32, rows as u32, grey)?).ok()
}

/// Returns the `data:` URL of a PNG, which a page shows without asking for a file.
pub(super) fn data_url(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", BASE64_STANDARD.encode(png))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::PixelFormat;

    fn meta(width_px: u32, height_px: u32) -> FrameMeta {
        FrameMeta { width_px, height_px, stride_bytes: width_px, format: PixelFormat::Mono8, ..FrameMeta::default() }
    }

    #[test]
    fn a_crop_at_the_edge_stays_inside_the_frame() {
        let meta = meta(100, 50);
        assert_eq!(Crop::about(Some([2.0, 48.0]), 10.0, &meta), Crop { x: 0, y: 38, width: 13, height: 12 });
        assert_eq!(Crop::about(Some([500.0, -500.0]), 10.0, &meta), Crop { x: 99, y: 0, width: 1, height: 1 });
        assert_eq!(Crop::about(None, 10.0, &meta), Crop { x: 0, y: 0, width: 100, height: 50 });
    }

    #[test]
    fn the_png_shows_the_part_asked_for_and_large_parts_are_averaged() {
        let meta = meta(1000, 400);
        let bytes: Vec<u8> = (0..400_000).map(|k| (k % 1000 / 4) as u8).collect();
        let small = encode_png(meta, &bytes, Crop { x: 400, y: 10, width: 21, height: 3 }).unwrap();
        let small = image::load_from_memory(&small).unwrap().to_luma8();
        assert_eq!((small.dimensions(), small.get_pixel(0, 0).0, small.get_pixel(20, 2).0), ((21, 3), [0], [255]));
        assert_eq!(small.get_pixel(8, 1).0, [102], "two fifths of the way");
        let whole = image::load_from_memory(&encode_png(meta, &bytes, Crop::about(None, 0.0, &meta)).unwrap()).unwrap();
        assert_eq!((whole.width(), whole.height()), (334, 134));
    }

    #[test]
    fn a_frame_with_too_few_bytes_has_no_picture() {
        assert_eq!(encode_png(meta(10, 10), &[0; 50], Crop::about(None, 0.0, &meta(10, 10))), None);
    }
}
