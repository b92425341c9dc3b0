//! Pictures as PNG files.

use image::codecs::png::PngEncoder;
use image::{EncodableLayout, ImageBuffer, ImageResult, PixelWithColorType};

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
    let mut png = Vec::new();
    picture.write_with_encoder(PngEncoder::new(&mut png))?;
    Ok(png)
}
