//! A grey image out of a file of still images.

use super::shape::Shape;
use super::{ImportError, Orientation, grey, square};
use crate::image::{PixelFormat, grey_pixels};
use image::DynamicImage;
use std::path::Path;

/// A grey image as it is displayed.
pub(super) struct Still {
    pub(super) shape: Shape,
    /// Packed little-endian pixels.
    pub(super) bytes: Vec<u8>,
    /// The way from the stored image to this one.
    pub(super) display: DisplayInfo,
}

/// The statements of a file about the display of an image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DisplayInfo {
    pub(super) orientation: Orientation,
    /// Width of a stored pixel over its height.
    pub(super) pixel_aspect: f64,
    /// Significant bits of a grey level.
    pub(super) bits: u32,
    /// The rule that makes grey levels of colours; `None` for a grey image.
    pub(super) grey_rule: Option<&'static str>,
    /// Whether the compression changes grey levels.
    pub(super) is_lossy: bool,
}

impl Default for DisplayInfo {
    fn default() -> Self {
        Self { orientation: Orientation::AS_STORED, pixel_aspect: 1.0, bits: 8, grey_rule: None, is_lossy: false }
    }
}

impl Still {
    /// Turns a stored image of the file `path` to the displayed one, with square pixels.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the bytes do not fill the shape.
    pub(super) fn new(path: &Path, stored: Shape, bytes: Vec<u8>, display: DisplayInfo) -> Result<Self, ImportError> {
        if bytes.len() as u64 != stored.bytes() {
            let reason = format!("{} bytes are decoded, expected {}", bytes.len(), stored.bytes());
            return Err(ImportError::invalid(path, reason));
        }
        let (shape, bytes) = (display.orientation.shape(stored), display.orientation.apply(stored, bytes));
        let square = square::square_shape(shape, display.orientation.aspect(display.pixel_aspect));
        let bytes = match square {
            Some(square) => square::resample(shape, square, bytes),
            None => bytes,
        };
        let pixel_aspect = if square.is_some() { display.pixel_aspect } else { 1.0 };
        Ok(Self { shape: square.unwrap_or(shape), bytes, display: DisplayInfo { pixel_aspect, ..display } })
    }

    /// Converts a decoded image of the file `path`. Colours become their luma.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for an image of floating-point numbers, without pixels or too large.
    pub(super) fn from_picture(path: &Path, picture: DynamicImage, display: DisplayInfo) -> Result<Self, ImportError> {
        let (width_px, height_px) = (u64::from(picture.width()), u64::from(picture.height()));
        let GreyPixels { format, bytes, rule } = to_grey(picture).ok_or_else(|| {
            ImportError::invalid(path, "floating-point numbers; save it in grey or RGB with 8 or 16 bits")
        })?;
        let shape = Shape::new(path, width_px, height_px, format)?;
        Self::new(path, shape, bytes, DisplayInfo { bits: format.bits(), grey_rule: rule, ..display })
    }
}

/// The pixels of a decoded image in grey.
struct GreyPixels {
    format: PixelFormat,
    /// Packed little-endian pixels.
    bytes: Vec<u8>,
    /// The rule by which colours became grey; `None` for a grey image. Colours of 16 bit always have one, even if the
    /// channels are equal.
    rule: Option<&'static str>,
}

/// Converts a decoded image to 8 or 16 bit grey; `None` for floating-point numbers. Transparency is ignored.
fn to_grey(picture: DynamicImage) -> Option<GreyPixels> {
    let picture = match picture {
        DynamicImage::ImageLumaA8(_) => DynamicImage::ImageLuma8(picture.into_luma8()),
        DynamicImage::ImageLumaA16(_) => DynamicImage::ImageLuma16(picture.into_luma16()),
        DynamicImage::ImageRgba8(_) => DynamicImage::ImageRgb8(picture.into_rgb8()),
        DynamicImage::ImageRgba16(_) => DynamicImage::ImageRgb16(picture.into_rgb16()),
        picture => picture,
    };
    match picture {
        DynamicImage::ImageRgb16(picture) => {
            let words: Vec<u8> = picture.into_raw().into_iter().flat_map(u16::to_le_bytes).collect();
            let format = PixelFormat::Mono16;
            Some(GreyPixels { format, bytes: grey::luma(format, &words), rule: Some(grey::LUMA) })
        }
        DynamicImage::ImageRgb8(picture) => {
            let is_grey = picture.pixels().all(|pixel| pixel.0[0] == pixel.0[1] && pixel.0[1] == pixel.0[2]);
            let (format, rule) = (PixelFormat::Mono8, (!is_grey).then_some(grey::LUMA));
            Some(GreyPixels { format, bytes: grey::luma(format, &picture.into_raw()), rule })
        }
        grey => grey_pixels(grey).map(|(format, bytes)| GreyPixels { format, bytes, rule: None }),
    }
}
