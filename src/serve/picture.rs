//! The live picture: a frame, scaled down and compressed for the page.

use crate::image::{Frame, Image, ImageView};
use axum::body::Bytes;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde_json::Value;

/// The maximum side of the live picture, px.
pub(super) const LIVE_SIDE_PX: usize = 512;
/// The quality of the compression, 1 to 100. Speckles must survive it, and the page finds saturated pixels in it.
const QUALITY: u8 = 85;
/// The grey level of a block with a saturated pixel, and the maximum of all others: so far apart that the page can
/// distinguish them after compression.
const SATURATED: u8 = 255;
/// The interval of the rows that the sharpness is estimated from.
const SHARPNESS_ROWS: usize = 4;
const MAX_UNSATURATED_LEVEL: f32 = 235.0;

/// A picture with its description.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    /// The frame, its size, the scale of the picture, and the bodies in it.
    pub(super) header: Value,
    /// The picture as a JPEG file.
    pub(super) jpeg: Bytes,
    /// The message of a WebSocket, the same for all clients: the length of the header as a 32-bit number
    /// (little-endian), the header, the JPEG file.
    pub(super) message: Bytes,
    /// The field of each body in the frame, as JSON with the columns of the `field` table; empty without Foxglove.
    pub(super) fields: Vec<Value>,
}

impl Picture {
    /// Puts a picture together, with its message.
    pub(super) fn new(header: Value, jpeg: &[u8], fields: Vec<Value>) -> Self {
        let text = header.to_string();
        let mut message = Vec::with_capacity(4 + text.len() + jpeg.len());
        message.extend((text.len() as u32).to_le_bytes());
        message.extend(text.as_bytes());
        message.extend(jpeg);
        let message = Bytes::from(message);
        Self { header, jpeg: message.slice(4 + text.len()..), message, fields }
    }
}

/// Scales and compresses frames; reuses its memory.
#[derive(Debug)]
pub(crate) struct PictureEncoder {
    /// The maximum side of a picture, px. Larger frames are averaged down to it.
    max_side_px: usize,
    /// The unpacked frame.
    image: Image,
    /// The grey levels of the picture, row by row.
    grey: Vec<u8>,
}

/// A compressed frame.
#[derive(Debug)]
pub(crate) struct Encoded {
    /// A grey JPEG file.
    pub(crate) jpeg: Vec<u8>,
    /// Pixels of the frame per pixel of the picture.
    pub(crate) scale: usize,
    /// The share of blocks with a saturated pixel, 0 to 1.
    pub(super) saturated_fraction: f64,
    /// The RMS difference of neighbouring pixels in a row over the standard deviation of all, which is highest in focus.
    pub(super) sharpness: f64,
}

impl PictureEncoder {
    /// Creates an encoder of pictures whose sides are at most this long, px.
    pub(crate) fn new(max_side_px: usize) -> Self {
        Self { max_side_px, image: Image::default(), grey: Vec::new() }
    }

    /// Encodes a frame as a grey JPEG file; `None` for a frame that does not unpack or cannot be compressed.
    ///
    /// Each pixel of the picture is the mean of a block of `scale` x `scale` pixels, scaled from the full range to 0 to
    /// [`MAX_UNSATURATED_LEVEL`], or [`SATURATED`] if a pixel of the block is. Incomplete blocks at the right and lower
    /// edges are left out.
    pub(crate) fn encode(&mut self, frame: &Frame<'_>) -> Option<Encoded> {
        frame.unpack(&mut self.image).ok()?;
        let view = self.image.view();
        let scale = view.width().max(view.height()).div_ceil(self.max_side_px).max(1);
        let (columns, rows) = (view.width() / scale, view.height() / scale);
        let full = ((1_u32 << frame.meta.format.bits()) - 1) as f32;
        self.grey.clear();
        for row in 0..rows {
            for column in 0..columns {
                let lines =
                    (row * scale..(row + 1) * scale).map(|y| &view.row(y)[column * scale..(column + 1) * scale]);
                let (mut sum, mut highest) = (0.0, 0.0_f32);
                for level in lines.flatten() {
                    sum += level;
                    highest = highest.max(*level);
                }
                let mean = sum / (scale * scale) as f32;
                let grey = (mean * (MAX_UNSATURATED_LEVEL / full)).round() as u8;
                self.grey.push(if highest >= full { SATURATED } else { grey });
            }
        }
        let sharpness = sharpness(view);
        let saturated = self.grey.iter().filter(|grey| **grey == SATURATED).count();
        let mut jpeg = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut jpeg, QUALITY);
        encoder.write_image(&self.grey, columns as u32, rows as u32, ExtendedColorType::L8).ok()?;
        let saturated_fraction = saturated as f64 / self.grey.len().max(1) as f64;
        Some(Encoded { jpeg, scale, saturated_fraction, sharpness })
    }
}

/// Returns the RMS difference of neighbouring pixels in a row over the standard deviation of all pixels, from every
/// [`SHARPNESS_ROWS`]th row; 0 for an image without contrast.
fn sharpness(image: ImageView<'_>) -> f64 {
    let (mut count, mut sum, mut squares, mut differences) = (0.0, 0.0, 0.0, 0.0);
    for row in (0..image.height()).step_by(SHARPNESS_ROWS).map(|y| image.row(y)) {
        for pair in row.windows(2) {
            let (level, step) = (f64::from(pair[0]), f64::from(pair[1] - pair[0]));
            count += 1.0;
            sum += level;
            squares += level * level;
            differences += step * step;
        }
    }
    let variance = squares / count - (sum / count).powi(2);
    if variance > 0.0 { (differences / count / variance).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{FrameMeta, PixelFormat};

    #[test]
    fn a_sharp_picture_is_sharper_than_a_blurred_one_of_any_brightness() {
        let stripes = |widths: usize, gain: f32| {
            let mut image = Image::default();
            let pixels: Vec<u8> = (0..64 * 64)
                .map(|at| if (at % 64 / widths).is_multiple_of(2) { 20 } else { (20.0 + 100.0 * gain) as u8 })
                .collect();
            let meta = FrameMeta { width_px: 64, height_px: 64, stride_bytes: 64, ..FrameMeta::default() };
            Frame { meta, bytes: &pixels }.unpack(&mut image).unwrap();
            sharpness(image.view())
        };
        assert!(stripes(2, 1.0) > 1.9 * stripes(8, 1.0));
        assert!((stripes(2, 1.0) - stripes(2, 0.5)).abs() < 1e-6);
        assert!(stripes(2, 0.0).abs() < 1e-12, "without contrast");
    }

    #[test]
    fn a_large_frame_is_averaged_and_a_saturated_pixel_stands_out() {
        let (width_px, height_px) = (1200_u32, 600_u32);
        let mut levels = vec![1000_u16; (width_px * height_px) as usize];
        // One saturated pixel in a block, far from the others.
        for y in 300..306 {
            levels[y * 1200 + 600..y * 1200 + 612].fill(4095);
        }
        let bytes: Vec<u8> = levels.iter().flat_map(|level| level.to_le_bytes()).collect();
        let format = PixelFormat::Mono12;
        let meta = FrameMeta { width_px, height_px, stride_bytes: 2 * width_px, format, ..FrameMeta::default() };
        let encoded = PictureEncoder::new(LIVE_SIDE_PX).encode(&Frame { meta, bytes: &bytes }).unwrap();
        let picture = image::load_from_memory(&encoded.jpeg).unwrap().to_luma8();
        assert_eq!((encoded.scale, picture.dimensions()), (3, (400, 200)));
        assert!((i32::from(picture.get_pixel(20, 20).0[0]) - 57).abs() <= 2, "{:?}", picture.get_pixel(20, 20));
        assert!(picture.get_pixel(201, 101).0[0] > 245);
        assert!((encoded.saturated_fraction - 8.0 / 80_000.0).abs() < 1e-9, "{}", encoded.saturated_fraction);
        assert!(PictureEncoder::new(LIVE_SIDE_PX).encode(&Frame { meta, bytes: &bytes[..9] }).is_none());
    }
}
