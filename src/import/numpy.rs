//! Stacks of frames as NumPy arrays of shape frames x height x width, unsigned 8 or 16 bit, in C order.
//!
//! Layout: "A simple file format for NumPy arrays" (NumPy Enhancement Proposal 1).

use super::footage::{Footage, Shape};
use super::timeline::{Rate, Timeline};
use super::{ImportError, open_file};
use crate::image::PixelFormat;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Maximum length of the header. One that describes three axes has about a hundred bytes.
const HEADER_BYTES: u64 = 1 << 16;

pub(super) fn open(path: &Path, fps: Option<f64>) -> Result<Footage, ImportError> {
    let invalid = |reason: String| ImportError::invalid(path, reason);
    let (file, file_bytes) = open_file(path)?;
    let (header, start) = header(&file, path, file_bytes)?;
    let array = Array::parse(&header).map_err(invalid)?;
    let [count, height_px, width_px] = array.shape;
    let format = if array.is_wide { PixelFormat::Mono16 } else { PixelFormat::Mono8 };
    let shape = Shape::new(path, width_px, height_px, format)?;
    let bytes = shape.bytes();
    let end = count.checked_mul(bytes).and_then(|all| all.checked_add(start));
    if count == 0 || end != Some(file_bytes) {
        let rest = file_bytes - start;
        return Err(invalid(format!("{rest} bytes after the header are not {count} frames of {bytes} bytes")));
    }
    let rate = Rate::known(path, fps, None)?;
    let path = path.to_path_buf();
    let frames = (0..count).map(move |number| {
        let mut pixels = vec![0; bytes as usize];
        let read = file.read_exact_at(&mut pixels, start + number * bytes);
        read.map_err(|error| ImportError::io("read", &path, error))?;
        if array.is_big_endian {
            pixels.chunks_exact_mut(2).for_each(<[u8]>::reverse);
        }
        Ok(pixels)
    });
    Ok(Footage::new(shape, Timeline::consecutive(rate), count, frames))
}

/// Returns the text of the header and the offset of the pixels.
fn header(file: &File, path: &Path, file_bytes: u64) -> Result<(String, u64), ImportError> {
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
    if length > HEADER_BYTES {
        return Err(ImportError::invalid(path, format!("a header of {length} bytes; at most {HEADER_BYTES} are read")));
    }
    let text = read(8 + length_bytes, length)?;
    Ok((String::from_utf8_lossy(&text).into_owned(), 8 + length_bytes + length))
}

/// The content of the header, a Python dictionary with three entries.
struct Array {
    is_wide: bool,
    is_big_endian: bool,
    /// Frames, rows, pixels per row.
    shape: [u64; 3],
}

impl Array {
    fn parse(header: &str) -> Result<Self, String> {
        let (is_wide, is_big_endian) = match quoted(value(header, "descr")?) {
            Some("|u1" | "<u1" | ">u1") => (false, false),
            Some("<u2") => (true, false),
            Some(">u2") => (true, true),
            _ => {
                return Err(format!(
                    "values of type {}; unsigned numbers of 8 or 16 bit are supported",
                    brief(value(header, "descr")?)
                ));
            }
        };
        if !value(header, "fortran_order")?.starts_with("False") {
            return Err("the array is not in C order; save numpy.ascontiguousarray of it".into());
        }
        let shape = value(header, "shape")?;
        let axes = shape.strip_prefix('(').and_then(|rest| rest.split_once(')')).map(|(axes, _)| axes);
        let axes: Option<Vec<u64>> = axes.and_then(|axes| {
            let axes = axes.trim().trim_end_matches(',');
            axes.split(',').map(|axis| axis.trim().parse().ok()).collect()
        });
        match axes.as_deref() {
            Some([frames, height, width]) => Ok(Self { is_wide, is_big_endian, shape: [*frames, *height, *width] }),
            _ => Err(format!("an array of shape {}; frames x height x width is supported", brief(shape))),
        }
    }
}

/// Returns the text after a key of the dictionary.
fn value<'a>(header: &'a str, key: &str) -> Result<&'a str, String> {
    let missing = || format!("the header has no {key:?}");
    let (_, rest) = header.split_once(&format!("'{key}'")).ok_or_else(missing)?;
    Ok(rest.trim_start().strip_prefix(':').ok_or_else(missing)?.trim_start())
}

fn quoted(value: &str) -> Option<&str> {
    Some(value.strip_prefix('\'')?.split_once('\'')?.0)
}

/// Returns the beginning of a value in one line.
fn brief(value: &str) -> String {
    value.chars().filter(|letter| !letter.is_control()).take(30).collect()
}
