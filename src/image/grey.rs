//! Grey levels of decoded images.

use super::PixelFormat;
use image::DynamicImage;

/// Returns the layout and the packed little-endian pixels of a grey image of 8 or 16 bit.
///
/// Three equal channels of 8 bit count as grey, since bitmaps with a grey palette and the JPEG of many cameras decode
/// to them. `None` for any other image: in colour, with transparency, with several channels of 16 bit or with
/// floating-point numbers.
pub fn grey_pixels(picture: DynamicImage) -> Option<(PixelFormat, Vec<u8>)> {
    match picture {
        DynamicImage::ImageLuma8(picture) => Some((PixelFormat::Mono8, picture.into_raw())),
        DynamicImage::ImageLuma16(picture) => {
            Some((PixelFormat::Mono16, picture.into_raw().into_iter().flat_map(u16::to_le_bytes).collect()))
        }
        DynamicImage::ImageRgb8(picture) => {
            let is_grey = picture.pixels().all(|pixel| pixel.0[0] == pixel.0[1] && pixel.0[1] == pixel.0[2]);
            is_grey.then(|| (PixelFormat::Mono8, picture.pixels().map(|pixel| pixel.0[0]).collect()))
        }
        _ => None,
    }
}
