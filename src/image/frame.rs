//! One raw frame as the camera delivered it.

use super::{Image, PixelFormat, ShapeError};

/// Everything known of a frame besides its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameMeta {
    /// Counts the camera's frames, lost ones included; a jump is a loss.
    pub sequence: u64,
    /// Raised each time the camera is opened anew.
    pub epoch: u32,
    /// Exposure start, ns since the Unix epoch (device clock mapped to host).
    pub stamp_ns: u64,
    /// The camera's own clock at exposure start, ns; 0 when it has none.
    pub device_ns: u64,
    /// Pixels a row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Bytes from one row to the next.
    pub stride_bytes: u32,
    /// Pixel layout.
    pub format: PixelFormat,
}

impl FrameMeta {
    /// Bytes the pixels take, padding at the end of rows included.
    pub fn size_bytes(&self) -> usize {
        self.stride_bytes as usize * self.height_px as usize
    }
}

/// A frame: what is known of it and its bytes, borrowed.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// What is known of it.
    pub meta: FrameMeta,
    /// `meta.size_bytes()` bytes, row by row.
    pub bytes: &'a [u8],
}

impl Frame<'_> {
    /// Unpacks the frame to grey levels in digital numbers (DN), into `image`.
    ///
    /// `image` is resized when its shape differs, and not allocated anew otherwise.
    ///
    /// # Errors
    ///
    /// [`ShapeError`] when there are fewer bytes than the header promises.
    pub fn unpack(&self, image: &mut Image) -> Result<(), ShapeError> {
        let (width, height) = (self.meta.width_px as usize, self.meta.height_px as usize);
        let row_bytes = width * self.meta.format.bytes_per_pixel();
        let stride = self.meta.stride_bytes as usize;
        if stride < row_bytes || self.bytes.len() < stride * height {
            return Err(ShapeError { expected: row_bytes.max(stride) * height, actual: self.bytes.len() });
        }
        image.reshape(width, height);
        for (row, target) in image.rows_mut().enumerate() {
            let bytes = &self.bytes[row * stride..row * stride + row_bytes];
            match self.meta.format.bytes_per_pixel() {
                1 => target.iter_mut().zip(bytes).for_each(|(pixel, byte)| *pixel = f32::from(*byte)),
                _ => target
                    .iter_mut()
                    .zip(bytes.chunks_exact(2))
                    .for_each(|(pixel, pair)| *pixel = f32::from(u16::from_le_bytes([pair[0], pair[1]]))),
            }
        }
        Ok(())
    }
}
