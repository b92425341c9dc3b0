//! Other people's files: image sequences, NumPy stacks, Photron and Phantom recordings, films.
//!
//! Every importer gives the same [`Footage`]: grey frames with their stamps, one
//! after the other. A frame rate comes from the file or from the user, and is
//! never guessed.

mod error;
mod numpy;
mod pages;
mod phantom;
mod photron;
mod sequence;
mod video;

pub use error::ImportError;

use crate::image::{FrameMeta, PixelFormat};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Largest frame taken from a file, bytes.
const FRAME_BYTES: u64 = 1 << 30;

/// Frames of a file, or of a sequence of files.
pub struct Footage {
    /// Pixels a row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Pixel layout.
    pub format: PixelFormat,
    /// Frames a second.
    pub frame_rate_hz: f64,
    /// How many frames there are.
    pub count: u64,
    /// What the file says of itself: camera, exposure, ...
    pub description: BTreeMap<String, String>,
    /// What the user should know: frames missing, settings that contradict.
    pub warnings: Vec<String>,
    frames: Box<dyn Iterator<Item = Result<Numbered, ImportError>> + Send>,
    stamps: Stamps,
}

/// A frame's number in its sequence (missing ones counted) and its pixels, rows packed.
type Numbered = (u64, Vec<u8>);

/// Stamps of frames taken at a constant rate.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stamps {
    first_ns: u64,
    frame_rate_hz: f64,
}

impl Stamps {
    fn at(self, sequence: u64) -> u64 {
        self.first_ns.saturating_add((sequence as f64 * 1e9 / self.frame_rate_hz).round() as u64)
    }
}

impl std::fmt::Debug for Footage {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Footage")
            .field("width_px", &self.width_px)
            .field("height_px", &self.height_px)
            .field("format", &self.format)
            .field("frame_rate_hz", &self.frame_rate_hz)
            .field("count", &self.count)
            .finish_non_exhaustive()
    }
}

impl Iterator for Footage {
    type Item = Result<(FrameMeta, Vec<u8>), ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        let (sequence, bytes) = match self.frames.next()? {
            Ok(frame) => frame,
            Err(error) => return Some(Err(error)),
        };
        let meta = FrameMeta {
            sequence,
            epoch: 0,
            stamp_ns: self.stamps.at(sequence),
            device_ns: 0,
            width_px: self.width_px,
            height_px: self.height_px,
            stride_bytes: self.width_px * self.format.bytes_per_pixel() as u32,
            format: self.format,
        };
        Some(Ok((meta, bytes)))
    }
}

/// Whether [`open`] knows what to do with a file of this name.
pub fn is_importable(path: &Path) -> bool {
    matches!(
        extension(path).as_str(),
        "png" | "tif" | "tiff" | "bmp" | "pgm" | "cih" | "cihx" | "mraw" | "cine" | "npy"
    ) || is_film(path)
}

/// Whether the name is that of a film, which ffmpeg reads.
fn is_film(path: &Path) -> bool {
    matches!(extension(path).as_str(), "avi" | "mp4" | "m4v" | "mov" | "mkv")
}

/// Opens footage: one Photron, Phantom or NumPy file, film or TIFF file of pages, or images that make a sequence in the
/// order given.
///
/// `fps` takes the place of the file's own frame rate; images have none. Where
/// a file does not tell when it was filmed, stamps count from 0.
///
/// # Errors
///
/// [`ImportError`] naming the file and what is wrong with it, or the missing frame rate.
pub fn open(inputs: &[PathBuf], fps: Option<f64>) -> Result<Footage, ImportError> {
    if let Some(fps) = fps.filter(|fps| !(fps.is_finite() && *fps > 0.0)) {
        return Err(ImportError::FrameRate { reason: format!("{fps} is not a positive number") });
    }
    let first = inputs.first().ok_or(ImportError::Nothing)?;
    match (extension(first).as_str(), inputs.len()) {
        ("cine", 1) => phantom::open(first, fps),
        ("npy", 1) => numpy::open(first, fps),
        ("cihx" | "cih" | "mraw", 1) => photron::open(first, fps),
        (_, 1) if is_film(first) => video::open(first, fps),
        ("cine" | "cihx" | "cih" | "mraw" | "npy" | "avi" | "mp4" | "m4v" | "mov" | "mkv", _) => {
            Err(ImportError::invalid(first, "such a file is a whole recording; give one at a time"))
        }
        ("png" | "tif" | "tiff" | "bmp" | "pgm", _) => sequence::open(inputs, fps),
        (other, _) => Err(ImportError::invalid(first, format!("files ending in {other:?} cannot be imported"))),
    }
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// Bytes of a packed frame, or why it cannot be one.
fn frame_bytes(path: &Path, width_px: u64, height_px: u64, format: PixelFormat) -> Result<u64, ImportError> {
    let bytes = width_px.checked_mul(height_px).and_then(|n| n.checked_mul(format.bytes_per_pixel() as u64));
    match bytes {
        Some(bytes) if (1..=FRAME_BYTES).contains(&bytes) => Ok(bytes),
        _ => Err(ImportError::invalid(path, format!("frames of {width_px}x{height_px} pixels"))),
    }
}

/// The rate to use: the user's, else the file's.
fn frame_rate(path: &Path, fps: Option<f64>, of_file: Option<f64>) -> Result<f64, ImportError> {
    fps.or(of_file.filter(|rate| rate.is_finite() && *rate > 0.0))
        .ok_or_else(|| ImportError::FrameRate { reason: format!("{} does not tell it; give --fps", path.display()) })
}

/// Unpacks pixels of `bits` (9 to 16) bits that follow each other without a gap, high bits first, to little-endian words.
fn unpack_high_first(packed: &[u8], bits: u32) -> Vec<u8> {
    let mut words = Vec::with_capacity(packed.len() * 16 / bits as usize);
    let (mut held, mut held_bits) = (0_u32, 0);
    for byte in packed {
        held = held << 8 | u32::from(*byte);
        held_bits += 8;
        if held_bits >= bits {
            held_bits -= bits;
            words.extend(((held >> held_bits) as u16).to_le_bytes());
            held &= (1 << held_bits) - 1;
        }
    }
    words
}
