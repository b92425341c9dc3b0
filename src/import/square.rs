//! Images whose pixels are not square.

use super::shape::{MAX_FRAME_BYTES, Shape};
use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Luma, Primitive};
use std::ops::RangeInclusive;

/// Pixel aspects that can be meant. Beyond them, a field of the file is damaged or means something else.
pub(super) const ASPECT_RANGE: RangeInclusive<f64> = 0.25..=4.0;
/// Difference from 1 that comes from rounded resolutions.
const MAX_ROUNDING_ERROR: f64 = 5e-3;

/// Returns the shape of an image with square pixels, from pixels `aspect` times as wide as high.
///
/// The image grows along the longer side of a pixel, so that nothing is lost. `None` when the aspect is 1 up to
/// [`MAX_ROUNDING_ERROR`] or outside [`ASPECT_RANGE`], or the image would have the same shape or exceed
/// [`MAX_FRAME_BYTES`].
pub(super) fn square_shape(stored: Shape, aspect: f64) -> Option<Shape> {
    let longer = |side: u32, factor: f64| (f64::from(side) * factor).round().min(f64::from(u32::MAX)) as u32;
    let shape = match aspect > 1.0 {
        true => Shape { width_px: longer(stored.width_px, aspect), ..stored },
        false => Shape { height_px: longer(stored.height_px, aspect.recip()), ..stored },
    };
    let is_meant = ASPECT_RANGE.contains(&aspect) && (aspect - 1.0).abs() > MAX_ROUNDING_ERROR;
    (is_meant && shape != stored && shape.bytes() <= MAX_FRAME_BYTES).then_some(shape)
}

/// Resamples packed pixels from the shape `stored` to `shape` by cubic interpolation (R. Keys 1981,
/// doi:10.1109/TASSP.1981.1163711), limited to full scale.
pub(super) fn resample(stored: Shape, shape: Shape, pixels: Vec<u8>) -> Vec<u8> {
    match stored.format.bytes_per_pixel() {
        1 => resample_levels(stored, shape, pixels),
        _ => {
            let words = pixels.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
            let highest = (1_u32 << stored.format.bits()) - 1;
            let within = |level: u16| u32::from(level).min(highest) as u16;
            resample_levels(stored, shape, words).into_iter().map(within).flat_map(u16::to_le_bytes).collect()
        }
    }
}

/// Resamples levels of 8 or 16 bits, row by row, from the shape `stored` to `shape`; empty if there are too few.
fn resample_levels<Level: Primitive + 'static>(stored: Shape, shape: Shape, levels: Vec<Level>) -> Vec<Level> {
    let image = ImageBuffer::<Luma<Level>, _>::from_raw(stored.width_px, stored.height_px, levels);
    let resized = image.map(|image| resize(&image, shape.width_px, shape.height_px, FilterType::CatmullRom));
    resized.map_or_else(Vec::new, ImageBuffer::into_raw)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::PixelFormat;

    /// A brightness that rises evenly keeps rising evenly.
    #[test]
    fn a_ramp_stays_a_ramp() {
        let stored = Shape { width_px: 40, height_px: 6, format: PixelFormat::Mono16 };
        let wide = square_shape(stored, 1.5).unwrap();
        assert_eq!((wide.width_px, wide.height_px), (60, 6));
        let words: Vec<u8> = (0..240_u16).flat_map(|at| (1000 + 300 * (at % 40)).to_le_bytes()).collect();
        let resized = resample(stored, wide, words);
        for (x, word) in resized.chunks_exact(2).take(60).enumerate().filter(|(x, _)| (4..56).contains(x)) {
            let expected = 1000.0 + 300.0 * ((x as f64 + 0.5) / 1.5 - 0.5);
            assert!((f64::from(u16::from_le_bytes([word[0], word[1]])) - expected).abs() < 1.5, "at {x}");
        }
        let high = square_shape(stored, 0.5).unwrap();
        assert_eq!((high.width_px, high.height_px), (40, 12));
        assert!(
            square_shape(stored, 1.0).is_none()
                && square_shape(stored, 1.001).is_none()
                && square_shape(stored, 90.0).is_none()
        );
    }
}
