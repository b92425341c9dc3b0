//! Files of other programs: image sequences, NumPy stacks, Photron and Phantom recordings, films.
//!
//! Every importer returns the same [`Footage`]: an iterator over grey frames, the `Timeline` that gives each its number
//! and its time, and the [`Provenance`] of both: what the file states about rate, gaps, orientation, pixel shape and
//! grey levels, and what in it contradicts what. The frame rate comes from the file or from the user and is never
//! guessed.

mod date;
mod error;
mod footage;
mod grey;
mod levels;
mod numpy;
mod orientation;
mod pages;
mod phantom;
mod photron;
mod provenance;
mod rate;
mod repeats;
mod sequence;
mod shape;
mod square;
mod still;
mod timeline;
mod video;

pub use error::ImportError;
pub use footage::{Findings, Footage};
pub use orientation::Orientation;
pub use provenance::Provenance;
pub use rate::RateSource;
pub use sequence::Order;

use sequence::{is_collection, is_image};
use shape::MAX_FRAME_BYTES;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Memory that a frame may take on top of twice the size of its file, bytes.
const SPARE_BYTES: u64 = 64 << 20;
/// The highest frame rate that a user may give, Hz.
pub const MAX_RATE_HZ: f64 = 1e9;

/// Whether [`open`] can read a file with this ending, a folder, or a pattern with wildcards.
pub fn is_importable(path: &Path) -> bool {
    let is_recording = matches!(extension(path).as_str(), "cih" | "cihx" | "mraw" | "cine" | "npy" | "npz");
    is_recording || is_film(path) || is_image(path) || is_collection(path)
}

/// The endings of films.
const FILMS: [&str; 19] = [
    "3gp", "avi", "flv", "gif", "m2ts", "m4v", "mkv", "mov", "mp4", "mpeg", "mpg", "mts", "mxf", "nut", "ogv", "ts",
    "webm", "wmv", "y4m",
];

/// Whether the ending is that of a film, which ffmpeg reads.
fn is_film(path: &Path) -> bool {
    FILMS.contains(&extension(path).as_str())
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
    open_in_order(inputs, fps, Order::Forward)
}

/// Opens footage as [`open`] does, with the images of a sequence in this order.
///
/// # Errors
///
/// Those of [`open`], and when `order` reverses something else than a sequence of images.
pub fn open_in_order(inputs: &[PathBuf], fps: Option<f64>, order: Order) -> Result<Footage, ImportError> {
    if let Some(fps) = fps.filter(|fps| !(*fps > 0.0 && *fps <= MAX_RATE_HZ)) {
        return Err(ImportError::FrameRate {
            reason: format!("--fps {fps:e}: must be above 0 and at most {MAX_RATE_HZ:e}"),
        });
    }
    let first = inputs.first().ok_or(ImportError::Nothing)?;
    if is_image(first) || is_collection(first) {
        return Ok(sequence::open(inputs, fps, order)?.without_repeats(first));
    }
    if order == Order::Reversed {
        return Err(ImportError::invalid(first, "only the images of a sequence can be reversed"));
    }
    let footage = match (extension(first).as_str(), inputs.len()) {
        ("cine", 1) => phantom::open(first, fps),
        ("npy", 1) => numpy::open(first, fps),
        ("npz", _) => {
            Err(ImportError::invalid(first, "an archive of arrays; save one of them with numpy.save as .npy"))
        }
        ("cihx" | "cih" | "mraw", 1) => photron::open(first, fps),
        (_, 1) if is_film(first) => video::open(first, fps),
        (other, 1) => Err(ImportError::invalid(first, format!("files that end in {other:?} are not supported"))),
        _ if is_importable(first) => {
            Err(ImportError::invalid(first, "the file is a whole recording; pass one at a time"))
        }
        (other, _) => Err(ImportError::invalid(first, format!("files that end in {other:?} are not supported"))),
    }?;
    Ok(footage.without_repeats(first))
}

/// Returns the extension of a file name in lower case, without the dot.
fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// Opens a file and returns its size, bytes.
fn open_file(path: &Path) -> Result<(File, u64), ImportError> {
    let io = |error| ImportError::io("open", path, error);
    let file = crate::input::open(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    Ok((file, bytes))
}

/// Returns the memory that decoding a frame of a file of this size may take, bytes: twice the size and
/// [`SPARE_BYTES`], at most [`MAX_FRAME_BYTES`].
///
/// A file that decodes to more is no film of an impact.
fn memory_limit_bytes(file_bytes: u64) -> u64 {
    file_bytes.saturating_mul(2).saturating_add(SPARE_BYTES).min(MAX_FRAME_BYTES)
}

/// Unpacks pixels of `bits` (9 to 16) bits, stored without gaps and with the most significant bit first, to
/// little-endian 16-bit words. Bits at the end that fill no pixel are dropped.
fn unpack_msb_first(packed: &[u8], bits: u32) -> Vec<u8> {
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
