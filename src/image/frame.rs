//! Raw frames, as the camera delivers them.

use super::{Image, PixelFormat, PixelRect, ShapeError};
use multiversion::multiversion;

/// The first stamp that is a date, ns since the Unix epoch: the year 1971. Earlier ones count from the first frame of a
/// film without a date.
const FIRST_DATE_NS: u64 = 365 * 86_400 * 1_000_000_000;

/// Whether a stamp is a date, and not the time since the first frame.
///
/// # Examples
///
/// ```
/// use ricochet::image::is_dated;
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
///
/// assert!(is_dated(recording.first_frame()?.stamp_ns));
/// // 9.9 ms after the first frame of a film without a date.
/// assert!(!is_dated(9_900_000));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn is_dated(stamp_ns: u64) -> bool {
    stamp_ns >= FIRST_DATE_NS
}

/// The header of a frame: everything but its pixels.
///
/// # Examples
///
/// ```
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
/// let [first, last] = [recording.first_frame()?, recording.last_frame()?];
/// assert_eq!((first.width_px, first.height_px), (256, 192));
/// assert_eq!(first.size_bytes(), 256 * 192);
/// // Lost frames would have taken numbers too.
/// let expected = last.sequence - first.sequence + 1;
/// assert_eq!(recording.frame_count(), expected);
/// assert_eq!(last.stamp_ns - first.stamp_ns, 9_900_000);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameMeta {
    /// The number of the frame, counting lost ones too. A jump is a loss.
    pub sequence: u64,
    /// A number that rises each time the camera is opened again.
    pub epoch: u32,
    /// The start of the exposure, ns since the Unix epoch (device clock mapped to host).
    pub stamp_ns: u64,
    /// The camera's own clock at the start of the exposure, ns; 0 if it has none.
    pub device_ns: u64,
    /// The number of pixels per row.
    pub width_px: u32,
    /// The number of rows.
    pub height_px: u32,
    /// The number of bytes from one row to the next.
    pub stride_bytes: u32,
    /// The pixel layout.
    pub format: PixelFormat,
}

impl FrameMeta {
    /// Returns the size of the pixels in bytes, including the padding at the end of rows.
    pub fn size_bytes(&self) -> usize {
        self.stride_bytes as usize * self.height_px as usize
    }
}

/// A frame whose pixels are borrowed.
///
/// # Examples
///
/// ```
/// use ricochet::image::{Frame, Image};
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
///
/// let (meta, bytes) = recording.frames()?.next().unwrap()?;
/// let mut image = Image::default();
/// Frame { meta, bytes: &bytes }.unpack(&mut image)?;
/// assert_eq!((image.view().width(), image.view().height()), (256, 192));
/// // Grey levels in digital numbers: 0 to 255 in a frame of 8 bits.
/// assert_eq!(image.view().at(0, 0), Some(f32::from(bytes[0])));
/// // Too few bytes are refused.
/// assert!(Frame { meta, bytes: &bytes[1..] }.check().is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// The header.
    pub meta: FrameMeta,
    /// The pixels row by row, `meta.size_bytes()` bytes.
    pub bytes: &'a [u8],
}

impl Frame<'_> {
    /// Unpacks the frame to grey levels in digital numbers (DN).
    ///
    /// Resizes `image` if its shape differs. Allocates nothing otherwise.
    ///
    /// # Errors
    ///
    /// See [`Self::check`].
    pub fn unpack(&self, image: &mut Image) -> Result<(), ShapeError> {
        self.unpack_part(PixelRect::whole(self.meta.width_px, self.meta.height_px), image)
    }

    /// Unpacks a part of the frame like [`Self::unpack`], clipped to the frame.
    ///
    /// Outside the part, an `image` of the frame's size keeps its content. Another one is resized first, which leaves
    /// the pixels outside the part unspecified.
    ///
    /// # Errors
    ///
    /// See [`Self::check`].
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn unpack_part(&self, part: PixelRect, image: &mut Image) -> Result<(), ShapeError> {
        self.check()?;
        let (width, height) = (self.meta.width_px as usize, self.meta.height_px as usize);
        let (stride, bytes_per_pixel) = (self.meta.stride_bytes as usize, self.meta.format.bytes_per_pixel());
        if (image.view().width(), image.view().height()) != (width, height) {
            image.reshape(width, height);
        }
        let part = part.clipped(PixelRect::whole(self.meta.width_px, self.meta.height_px));
        let (left, right) = (part.left as usize, part.right as usize);
        for (row, target) in image.rows_mut().enumerate().take(part.bottom as usize).skip(part.top as usize) {
            let bytes = &self.bytes[row * stride + left * bytes_per_pixel..row * stride + right * bytes_per_pixel];
            match bytes_per_pixel {
                1 => widen_bytes(bytes, &mut target[left..right]),
                _ => widen_words(bytes, &mut target[left..right]),
            }
        }
        Ok(())
    }

    /// Checks that there are at least as many bytes as the header requires, and that rows do not overlap.
    ///
    /// # Errors
    ///
    /// [`ShapeError`] with numbers of bytes if there are too few, or if `stride_bytes` is shorter than a row of pixels.
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

/// Converts grey levels of one byte each.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn widen_bytes(bytes: &[u8], out: &mut [f32]) {
    out.iter_mut().zip(bytes).for_each(|(out, byte)| *out = f32::from(*byte));
}

/// Converts grey levels of two bytes each, in little-endian order.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn widen_words(bytes: &[u8], out: &mut [f32]) {
    let words = bytes.as_chunks::<2>().0;
    out.iter_mut().zip(words).for_each(|(out, word)| *out = f32::from(u16::from_le_bytes(*word)));
}
