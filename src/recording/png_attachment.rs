//! Attached pictures: grey levels to PNG and back.

use crate::image::{Image, PixelFormat, encode_png, grey_pixels};
use image::{GrayImage, ImageBuffer, ImageFormat, Luma};
use std::io::Cursor;

/// Maximum memory for decoding a picture, bytes.
const MAX_PICTURE_BYTES: u64 = 1 << 30;

/// Encodes a picture of grey levels from 0 to 65535, rounded to whole ones, as PNG: in 8 bits if all fit, else in 16.
///
/// Returns `None` when the picture has no pixels or is too large.
pub fn to_png(picture: &Image) -> Option<Vec<u8>> {
    let view = picture.view();
    let is_small = (0..view.height()).all(|y| view.row(y).iter().all(|level| level.round() <= 255.0));
    to_png_with_bit_depth(picture, if is_small { 8 } else { 16 })
}

/// Encodes a picture of grey levels as PNG, with 8 bits per pixel for a `bit_depth` of at most 8, else with 16.
///
/// Grey levels are rounded, and clamped to the range. Returns `None` when the picture has no pixels or is too large.
pub fn to_png_with_bit_depth(picture: &Image, bit_depth: u32) -> Option<Vec<u8>> {
    let view = picture.view();
    let (width, height) = (u32::try_from(view.width()).ok()?, u32::try_from(view.height()).ok()?);
    let levels =
        (0..view.height()).flat_map(|y| view.row(y).iter().map(|level| level.round().clamp(0.0, 65_535.0) as u16));
    if bit_depth <= 8 {
        encode_png(&GrayImage::from_raw(width, height, levels.map(|level| level.min(255) as u8).collect())?).ok()
    } else {
        encode_png(&ImageBuffer::<Luma<u16>, _>::from_raw(width, height, levels.collect())?).ok()
    }
}

/// Decodes the grey levels of a PNG, 0 to 255 or 0 to 65535; `None` for other data, a picture in colour, and one that
/// needs more than 1 GiB.
pub fn from_png(png: &[u8]) -> Option<Image> {
    let mut reader = image::ImageReader::with_format(Cursor::new(png), ImageFormat::Png);
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_PICTURE_BYTES);
    reader.limits(limits);
    let picture = reader.decode().ok()?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let (format, bytes) = grey_pixels(picture)?;
    let levels = match format {
        PixelFormat::Mono8 => bytes.iter().map(|level| f32::from(*level)).collect(),
        _ => bytes.chunks_exact(2).map(|pair| f32::from(u16::from_le_bytes([pair[0], pair[1]]))).collect(),
    };
    Image::from_vec(levels, width, height).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_8_and_16_bit_come_back_as_they_were() {
        for highest in [255, 4095, 65_535] {
            let levels: Vec<f32> = (0..35 * 21).map(|k| (k * 977 % (highest + 1)) as f32).collect();
            let picture = Image::from_vec(levels, 35, 21).unwrap();
            let png = to_png(&picture).unwrap();
            let back = from_png(&png).unwrap();
            assert!((0..21).all(|y| back.view().row(y) == picture.view().row(y)), "{highest}");
        }
        assert!(from_png(b"no picture").is_none() && from_png(&[]).is_none());
    }
}
