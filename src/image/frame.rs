//! One raw frame as the camera delivered it.

use multiversion::multiversion;

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
        self.unpack_part([0, 0, self.meta.width_px, self.meta.height_px], image)
    }

    /// As [`Self::unpack`], but only a part of the frame: x, y, width and height, clipped to the frame.
    ///
    /// `image` is as large as the frame, and holds beside the part what it held before.
    ///
    /// # Errors
    ///
    /// As [`Self::unpack`].
    pub fn unpack_part(&self, [x, y, width, height]: [u32; 4], image: &mut Image) -> Result<(), ShapeError> {
        self.check()?;
        let size = (self.meta.width_px as usize, self.meta.height_px as usize);
        let (stride, bytes_per_pixel) = (self.meta.stride_bytes as usize, self.meta.format.bytes_per_pixel());
        if (image.view().width(), image.view().height()) != size {
            image.reshape(size.0, size.1);
        }
        let (left, top) = ((x as usize).min(size.0), (y as usize).min(size.1));
        let (right, bottom) = (left.saturating_add(width as usize).min(size.0), top.saturating_add(height as usize));
        for (row, target) in image.rows_mut().enumerate().take(bottom).skip(top) {
            let bytes = &self.bytes[row * stride + left * bytes_per_pixel..row * stride + right * bytes_per_pixel];
            let target = &mut target[left..right];
            match bytes_per_pixel {
                1 => widen_bytes(bytes, target),
                _ => widen_pairs(bytes, target),
            }
        }
        Ok(())
    }

    /// Whether the bytes are those that the header promises.
    ///
    /// # Errors
    ///
    /// [`ShapeError`] when there are fewer.
    pub fn check(&self) -> Result<(), ShapeError> {
        let (width, height) = (self.meta.width_px as usize, self.meta.height_px as usize);
        let row_bytes = width * self.meta.format.bytes_per_pixel();
        let stride = self.meta.stride_bytes as usize;
        if stride < row_bytes || self.bytes.len() < stride * height {
            return Err(ShapeError { expected: row_bytes.max(stride) * height, actual: self.bytes.len() });
        }
        Ok(())
    }
}

/// Grey levels of one byte each.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn widen_bytes(bytes: &[u8], out: &mut [f32]) {
    out.iter_mut().zip(bytes).for_each(|(out, byte)| *out = f32::from(*byte));
}

/// Grey levels of two bytes each, the lower one first.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn widen_pairs(bytes: &[u8], out: &mut [f32]) {
    let pairs = bytes.as_chunks::<2>().0;
    out.iter_mut().zip(pairs).for_each(|(out, pair)| *out = f32::from(u16::from_le_bytes(*pair)));
}
