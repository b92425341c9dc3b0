//! Pictures as PNG files.

use image::{EncodableLayout, ImageBuffer, ImageFormat, ImageResult, PixelWithColorType};
use std::io::Cursor;

/// Encodes a picture as PNG.
///
/// # Errors
///
/// When the picture has no pixels or is too large.
pub fn encode_png<P>(picture: &ImageBuffer<P, Vec<P::Subpixel>>) -> ImageResult<Vec<u8>>
where
    P: PixelWithColorType,
    [P::Subpixel]: EncodableLayout,
{
    let mut png = Cursor::new(Vec::new());
    picture.write_to(&mut png, ImageFormat::Png)?;
    Ok(png.into_inner())
}
