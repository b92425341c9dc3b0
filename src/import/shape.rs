//! Size and pixel layout of frames.

use super::ImportError;
use crate::image::PixelFormat;
use std::path::Path;

/// Maximum size of a frame, bytes.
pub(super) const MAX_FRAME_BYTES: u64 = 1 << 30;

/// Size and pixel layout of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    pub(super) width_px: u32,
    pub(super) height_px: u32,
    pub(super) format: PixelFormat,
}

impl Shape {
    /// Checks the shape of the frames of `path`.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for a frame without pixels, or of more than [`MAX_FRAME_BYTES`].
    pub(super) fn new(path: &Path, width_px: u64, height_px: u64, format: PixelFormat) -> Result<Self, ImportError> {
        let bytes = width_px.checked_mul(height_px).and_then(|n| n.checked_mul(format.bytes_per_pixel() as u64));
        match bytes {
            // Sizes within the limit fit.
            Some(1..=MAX_FRAME_BYTES) => Ok(Self { width_px: width_px as u32, height_px: height_px as u32, format }),
            _ => {
                let reason = format!("frames of {width_px}x{height_px} pixels; 1 byte to 1 GiB are supported");
                Err(ImportError::invalid(path, reason))
            }
        }
    }

    /// Returns the size of a packed frame, bytes.
    pub(super) fn bytes(self) -> u64 {
        u64::from(self.width_px) * u64::from(self.height_px) * self.format.bytes_per_pixel() as u64
    }
}

impl std::fmt::Display for Shape {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}x{} {}", self.width_px, self.height_px, self.format.as_str())
    }
}
