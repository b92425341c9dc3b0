//! Stacks of frames as NumPy arrays of shape frames x height x width, unsigned 8 or 16 bit.
//!
//! Layout: "A simple file format for NumPy arrays" (NumPy Enhancement Proposal 1).

use super::footage::Footage;
use super::rate::Rate;
use super::shape::Shape;
use super::timeline::Timeline;
use super::{ImportError, MAX_FRAME_BYTES, grey, open_file};
use crate::image::PixelFormat;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// The first bytes of an array.
const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Maximum length of the header. One that describes three axes has about a hundred bytes.
const MAX_HEADER_BYTES: u64 = 1 << 16;

/// Opens an array of frames. A 2-D array is one frame; a fourth axis of 3 or 4 holds colours.
pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let invalid = |reason: String| ImportError::invalid(path, reason);
    let name = path.to_path_buf();
    let (file, file_bytes) = open_file(path)?;
    let (header, start) = read_header(&file, path, file_bytes)?;
    let array = Array::parse(&header).map_err(invalid)?;
    let FrameSizes { frames: count, height_px, width_px, channels } = array.shape;
    let format = array.format();
    let shape = Shape::new(path, width_px, height_px, format)?;
    let bytes = shape.bytes() * channels;
    let end = count.checked_mul(bytes).and_then(|all| all.checked_add(start));
    if count == 0 || end != Some(file_bytes) {
        let rest = file_bytes - start;
        return Err(invalid(format!("{rest} bytes after the header are not {count} frames of {bytes} bytes")));
    }
    let rate = Rate::known(path, fps, None)?;
    let columns = match array.order {
        AxisOrder::C => None,
        AxisOrder::Fortran => Some(read_columns(&file, path, start, count * bytes)?),
    };
    let path = path.to_path_buf();
    let frames = (0..count).map(move |number| {
        let samples = match &columns {
            None => read_bytes(&file, &path, start + number * bytes, bytes)?,
            Some(columns) => array.shape.frame_from_fortran(columns, number as usize, format.bytes_per_pixel()),
        };
        Ok(array.grey_frame(samples))
    });
    let mut footage = Footage::new(shape, Timeline::consecutive(rate), count, frames);
    if channels > 1 {
        footage.provenance.grey_rule = grey::LUMA.to_owned();
    }
    footage.with_bits_of_first(&name)
}

/// Reads the samples of an array in Fortran order, `bytes` from byte `start` of the file on, since every frame is
/// spread over all of them.
///
/// # Errors
///
/// [`ImportError::Invalid`] with the cure when there are too many; [`ImportError::Io`] when the file cannot be read.
fn read_columns(file: &File, path: &Path, start: u64, bytes: u64) -> Result<Vec<u8>, ImportError> {
    if bytes > MAX_FRAME_BYTES {
        let advice = "save numpy.ascontiguousarray of it";
        let reason = format!("{bytes} bytes in Fortran order; at most {MAX_FRAME_BYTES} are read: {advice}");
        return Err(ImportError::invalid(path, reason));
    }
    read_bytes(file, path, start, bytes)
}

/// Reads this number of bytes from byte `at` of the file on.
fn read_bytes(file: &File, path: &Path, at: u64, bytes: u64) -> Result<Vec<u8>, ImportError> {
    let mut pixels = vec![0; bytes as usize];
    let read = file.read_exact_at(&mut pixels, at);
    read.map(|()| pixels).map_err(|error| ImportError::io("read", path, error))
}

/// Returns the text of the header and the offset of the pixels, bytes.
///
/// # Errors
///
/// [`ImportError::Invalid`] for a file that is no array, has another version, ends within its header, or has one longer
/// than [`MAX_HEADER_BYTES`].
fn read_header(file: &File, path: &Path, file_bytes: u64) -> Result<(String, u64), ImportError> {
    let read = |at: u64, count: u64| {
        if at + count > file_bytes {
            return Err(ImportError::invalid(path, format!("the file ends within its header, at byte {file_bytes}")));
        }
        let mut bytes = vec![0; count as usize];
        file.read_exact_at(&mut bytes, at).map_err(|error| ImportError::io("read", path, error))?;
        Ok(bytes)
    };
    let start = read(0, 8)?;
    if start[..6] != *MAGIC {
        return Err(ImportError::invalid(path, "not a NumPy array: the magic bytes are missing at byte 0"));
    }
    let (length_bytes, length) = match start[6] {
        1 => (2, read(8, 2).map(|b| u64::from(u16::from_le_bytes([b[0], b[1]])))?),
        2 | 3 => (4, read(8, 4).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])))?),
        other => {
            return Err(ImportError::invalid(path, format!("version {other} of the format; 1 to 3 are supported")));
        }
    };
    if length > MAX_HEADER_BYTES {
        return Err(ImportError::invalid(
            path,
            format!("a header of {length} bytes; at most {MAX_HEADER_BYTES} are read"),
        ));
    }
    let text = read(8 + length_bytes, length)?;
    Ok((String::from_utf8_lossy(&text).into_owned(), 8 + length_bytes + length))
}

/// The sizes of an array of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FrameSizes {
    frames: u64,
    height_px: u64,
    width_px: u64,
    /// 1 for grey, 3 for red, green and blue, 4 with transparency.
    channels: u64,
}

/// The order of the axes in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AxisOrder {
    /// Frame by frame: the first axis is the slowest.
    C,
    /// The first pixel of all frames, then the next one: the first axis is the fastest.
    Fortran,
}

/// The content of the header, a Python dictionary with three entries.
#[derive(Debug, Clone, Copy)]
struct Array {
    is_wide: bool,
    is_big_endian: bool,
    order: AxisOrder,
    shape: FrameSizes,
}

impl Array {
    /// Parses the dictionary of the header.
    ///
    /// # Errors
    ///
    /// The reason, with a cure, when the array does not hold frames of unsigned 8 or 16 bits.
    fn parse(header: &str) -> Result<Self, String> {
        let kind = quoted(entry_after(header, "descr")?).unwrap_or_default();
        let (is_wide, is_big_endian) = match kind {
            "|u1" | "<u1" | ">u1" => (false, false),
            "<u2" => (true, false),
            ">u2" => (true, true),
            _ => {
                let (kind, advice) = (brief(entry_after(header, "descr")?), conversion_advice(kind));
                return Err(format!("values of type {kind}; unsigned numbers of 8 or 16 bit are supported: {advice}"));
            }
        };
        let order = match entry_after(header, "fortran_order")? {
            order if order.starts_with("False") => AxisOrder::C,
            order if order.starts_with("True") => AxisOrder::Fortran,
            order => return Err(format!("fortran_order is {}, neither True nor False", brief(order))),
        };
        let shape = entry_after(header, "shape")?;
        let axes = shape.strip_prefix('(').and_then(|rest| rest.split_once(')')).map(|(axes, _)| axes);
        let axes: Option<Vec<u64>> = axes.and_then(|axes| {
            let axes = axes.trim().trim_end_matches(',');
            axes.split(',').map(|axis| axis.trim().parse().ok()).collect()
        });
        let sized = |frames: u64, height_px: u64, width_px: u64, channels: u64| {
            Ok(Self { is_wide, is_big_endian, order, shape: FrameSizes { frames, height_px, width_px, channels } })
        };
        match axes.as_deref() {
            Some([height, width]) => sized(1, *height, *width, 1),
            Some([frames, height, width]) => sized(*frames, *height, *width, 1),
            Some([frames, height, width, channels @ (1 | 3 | 4)]) => sized(*frames, *height, *width, *channels),
            _ => Err(format!("an array of shape {}; frames x height x width is supported", brief(shape))),
        }
    }

    /// Returns the format of the grey levels.
    fn format(&self) -> PixelFormat {
        if self.is_wide { PixelFormat::Mono16 } else { PixelFormat::Mono8 }
    }

    /// Converts the samples of a frame, in C order, to packed little-endian grey levels. Colours become their luma, and
    /// transparency is ignored.
    fn grey_frame(&self, mut samples: Vec<u8>) -> Vec<u8> {
        if self.is_big_endian {
            samples.chunks_exact_mut(2).for_each(<[u8]>::reverse);
        }
        if self.shape.channels == 1 {
            return samples;
        }
        let (format, sample_bytes) = (self.format(), self.format().bytes_per_pixel());
        let pixels = samples.chunks_exact(self.shape.channels as usize * sample_bytes);
        grey::luma(format, &pixels.flat_map(|pixel| &pixel[..3 * sample_bytes]).copied().collect::<Vec<u8>>())
    }
}

impl FrameSizes {
    /// Collects the samples of frame `number`, from 0, of an array in Fortran order, and returns them in C order.
    ///
    /// `columns` is the whole array, and `sample_bytes` the size of a sample.
    fn frame_from_fortran(self, columns: &[u8], number: usize, sample_bytes: usize) -> Vec<u8> {
        let [frames, height, width] = [self.frames, self.height_px, self.width_px].map(|size| size as usize);
        let mut pixels = Vec::with_capacity(height * width * self.channels as usize * sample_bytes);
        for y in 0..height {
            for x in 0..width {
                for channel in 0..self.channels as usize {
                    let at = sample_bytes * (number + frames * (y + height * (x + width * channel)));
                    pixels.extend_from_slice(&columns[at..at + sample_bytes]);
                }
            }
        }
        pixels
    }
}

/// Returns the way to save an array of a type that is not supported as one that is.
fn conversion_advice(kind: &str) -> &'static str {
    match kind.trim_start_matches(['<', '>', '|', '=']) {
        "b1" => "save (255 * a).astype('u1')",
        kind if kind.starts_with('f') => "scale it to 0 to 65535 and save a.astype('u2')",
        kind if kind.starts_with('i') => "make it positive and save a.astype('u2')",
        kind if kind.starts_with('u') => "save a.astype('u2') if its values fit",
        _ => "save an array of numbers",
    }
}

/// Returns the text after a key of the dictionary and its colon, to the end of the header.
///
/// # Errors
///
/// The reason when the key is missing.
fn entry_after<'a>(header: &'a str, key: &str) -> Result<&'a str, String> {
    let missing = || format!("the header has no {key:?}");
    let (_, rest) = header.split_once(&format!("'{key}'")).ok_or_else(missing)?;
    Ok(rest.trim_start().strip_prefix(':').ok_or_else(missing)?.trim_start())
}

/// Returns the content of the single quotes that a value begins with; `None` without them.
fn quoted(value: &str) -> Option<&str> {
    Some(value.strip_prefix('\'')?.split_once('\'')?.0)
}

/// Returns the first 30 characters of a value, without control characters such as line ends.
fn brief(value: &str) -> String {
    value.chars().filter(|letter| !letter.is_control()).take(30).collect()
}
