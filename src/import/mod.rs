//! Files of other programs: image sequences, NumPy stacks, Photron and Phantom recordings, films.
//!
//! Every importer returns the same [`Footage`]: an iterator over grey frames with their stamps. The frame rate comes
//! from the file or from the user and is never guessed.

mod error;
mod numpy;
mod pages;
mod phantom;
mod photron;
mod sequence;
mod still;
mod video;

pub use error::ImportError;

use crate::image::{FrameMeta, PixelFormat};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Maximum size of a frame, bytes.
const FRAME_BYTES: u64 = 1 << 30;
/// Memory that a frame may take on top of twice the size of its file, bytes.
const SPARE_BYTES: u64 = 64 << 20;

/// Frames of a file, or of a sequence of files.
pub struct Footage {
    /// Pixels per row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Pixel layout.
    pub format: PixelFormat,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Number of frames.
    pub count: u64,
    /// Properties that the file states: camera, exposure, ...
    pub description: BTreeMap<String, String>,
    /// Warnings for the user: missing frames, contradicting settings.
    pub warnings: Vec<String>,
    /// Stamp of the frame with number 0, ns since the Unix epoch; 0 when the file has no time.
    first_ns: u64,
    frames: Box<dyn Iterator<Item = Numbered> + Send>,
}

/// A frame: its number, with missing ones counted, and its pixels, rows packed.
type Numbered = Result<(u64, Vec<u8>), ImportError>;

/// Size and pixel layout of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shape {
    width_px: u32,
    height_px: u32,
    format: PixelFormat,
}

impl Shape {
    /// Checks the shape of the frames of `path`.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for a frame without pixels, or of more than [`FRAME_BYTES`].
    fn new(path: &Path, width_px: u64, height_px: u64, format: PixelFormat) -> Result<Self, ImportError> {
        let bytes = width_px.checked_mul(height_px).and_then(|n| n.checked_mul(format.bytes_per_pixel() as u64));
        match bytes {
            // Sizes within the limit fit.
            Some(1..=FRAME_BYTES) => Ok(Self { width_px: width_px as u32, height_px: height_px as u32, format }),
            _ => {
                let reason = format!("frames of {width_px}x{height_px} pixels; 1 byte to 1 GiB are supported");
                Err(ImportError::invalid(path, reason))
            }
        }
    }

    /// The size of a packed frame, bytes.
    fn bytes(self) -> u64 {
        u64::from(self.width_px) * u64::from(self.height_px) * self.format.bytes_per_pixel() as u64
    }
}

impl std::fmt::Display for Shape {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}x{} {}", self.width_px, self.height_px, self.format.as_str())
    }
}

impl Footage {
    /// Collects frames without a time, properties and warnings.
    fn new(
        shape: Shape,
        frame_rate_hz: f64,
        count: u64,
        frames: impl Iterator<Item = Numbered> + Send + 'static,
    ) -> Self {
        let Shape { width_px, height_px, format } = shape;
        let (description, warnings, frames) = (BTreeMap::new(), Vec::new(), Box::new(frames));
        Self { width_px, height_px, format, frame_rate_hz, count, description, warnings, first_ns: 0, frames }
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
        let meta = |sequence: u64| FrameMeta {
            sequence,
            stamp_ns: self.first_ns.saturating_add((sequence as f64 * 1e9 / self.frame_rate_hz).round() as u64),
            width_px: self.width_px,
            height_px: self.height_px,
            stride_bytes: self.width_px * self.format.bytes_per_pixel() as u32,
            format: self.format,
            ..FrameMeta::default()
        };
        let frame = self.frames.next()?;
        Some(frame.map(|(sequence, bytes)| (meta(sequence), bytes)))
    }
}

/// Whether [`open`] can read a file with this ending.
pub fn is_importable(path: &Path) -> bool {
    matches!(
        extension(path).as_str(),
        "png" | "tif" | "tiff" | "bmp" | "pgm" | "cih" | "cihx" | "mraw" | "cine" | "npy"
    ) || is_film(path)
}

/// Whether the ending is that of a film, which ffmpeg reads.
fn is_film(path: &Path) -> bool {
    matches!(extension(path).as_str(), "avi" | "mp4" | "m4v" | "mov" | "mkv")
}

/// Opens footage: one Photron, Phantom or NumPy file, one film, one TIFF file of several pages, or a sequence of images
/// in the given order.
///
/// `fps` overrides the frame rate of the file; images have none. Stamps count from 0 where a file has no time.
///
/// # Errors
///
/// [`ImportError`] with the file and its problem, or when the frame rate is missing.
pub fn open(inputs: &[PathBuf], fps: Option<f64>) -> Result<Footage, ImportError> {
    if let Some(fps) = fps.filter(|fps| !(fps.is_finite() && *fps > 0.0)) {
        return Err(ImportError::FrameRate { reason: format!("--fps {fps} is not a positive number") });
    }
    let first = inputs.first().ok_or(ImportError::Nothing)?;
    match (extension(first).as_str(), inputs.len()) {
        ("cine", 1) => phantom::open(first, fps),
        ("npy", 1) => numpy::open(first, fps),
        ("cihx" | "cih" | "mraw", 1) => photron::open(first, fps),
        (_, 1) if is_film(first) => video::open(first, fps),
        ("cine" | "cihx" | "cih" | "mraw" | "npy" | "avi" | "mp4" | "m4v" | "mov" | "mkv", _) => {
            Err(ImportError::invalid(first, "the file is a whole recording; pass one at a time"))
        }
        ("png" | "tif" | "tiff" | "bmp" | "pgm", _) => sequence::open(inputs, fps),
        (other, _) => Err(ImportError::invalid(first, format!("files that end in {other:?} are not supported"))),
    }
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// Opens a file and returns its size, bytes.
fn open_file(path: &Path) -> Result<(File, u64), ImportError> {
    let io = |error| ImportError::io("open", path, error);
    let file = File::open(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    Ok((file, bytes))
}

/// The memory that decoding a frame of a file of this size may take, bytes.
///
/// A file that decodes to more is no film of an impact.
fn memory_limit_bytes(file_bytes: u64) -> u64 {
    file_bytes.saturating_mul(2).saturating_add(SPARE_BYTES).min(FRAME_BYTES)
}

/// Returns the rate of the user, or else that of the file.
fn frame_rate(path: &Path, fps: Option<f64>, of_file: Option<f64>) -> Result<f64, ImportError> {
    fps.or(of_file.filter(|rate| rate.is_finite() && *rate > 0.0))
        .ok_or_else(|| ImportError::FrameRate { reason: format!("{} does not record it; pass --fps", path.display()) })
}

/// Unpacks pixels of `bits` (9 to 16) bits, stored without gaps and high bits first, to little-endian words.
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
