//! A grey image out of a file of still images.

use super::ImportError;
use super::footage::Shape;
use crate::image::grey_pixels;
use image::DynamicImage;
use std::path::Path;

/// A grey image.
pub(super) struct Still {
    pub(super) shape: Shape,
    /// Packed little-endian pixels.
    pub(super) bytes: Vec<u8>,
}

impl Still {
    /// Takes a decoded image of the file `path`. `None` stands for an image in another format.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for an image that is not grey.
    pub(super) fn new(path: &Path, picture: Option<DynamicImage>) -> Result<Self, ImportError> {
        let size = picture.as_ref().map(|picture| (picture.width(), picture.height())).unwrap_or_default();
        let (format, bytes) = picture
            .and_then(grey_pixels)
            .ok_or_else(|| ImportError::invalid(path, "not a grey image of 8 or 16 bit"))?;
        Ok(Self { shape: Shape::new(path, size.0.into(), size.1.into(), format)?, bytes })
    }
}
