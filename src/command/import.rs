//! `ricochet import`: other people's footage as a recording.

use crate::image::Frame;
use crate::import::{self, ImportError};
use crate::recording::{RecordingError, RecordingInfo, RecordingWriter, WriterOptions};
use std::path::PathBuf;

/// What to import, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// One Photron, Phantom or NumPy file, film or TIFF of several pages, or images that make a sequence in this order.
    pub inputs: Vec<PathBuf>,
    /// Frames a second; takes the place of the file's own.
    pub fps: Option<f64>,
    /// The new recording; it may not exist yet.
    pub output: PathBuf,
}

/// What was imported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Imported {
    /// The new recording.
    pub path: PathBuf,
    /// Frames in it.
    pub frames: u64,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Why nothing was imported.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The footage cannot be read.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// The recording cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// Imports footage; its settings become metadata of the recording.
///
/// # Errors
///
/// [`Failure`] naming the file that cannot be read or written. An unfinished
/// recording stays as its part file.
pub fn run(options: &ImportOptions) -> Result<Imported, Failure> {
    let footage = import::open(&options.inputs, options.fps)?;
    let mut metadata = footage.description.clone();
    metadata.insert("version".into(), env!("CARGO_PKG_VERSION").into());
    metadata.insert("frame_rate_hz".into(), footage.frame_rate_hz.to_string());
    let names = options.inputs.first().and_then(|path| path.file_name());
    metadata.insert("imported_from".into(), names.unwrap_or_default().to_string_lossy().into_owned());
    let info = RecordingInfo { metadata, ..RecordingInfo::default() };
    let warnings = footage.warnings.clone();
    let mut writer = RecordingWriter::create(&options.output, &info, &WriterOptions::default())?;
    for frame in footage {
        let (meta, bytes) = frame?;
        writer.frame(&Frame { meta, bytes: &bytes })?;
    }
    let finished = writer.finish()?;
    Ok(Imported { path: finished.path, frames: finished.frames, warnings })
}
