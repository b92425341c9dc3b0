//! `ricochet import`: converts footage of other programs or cameras into a recording.

use super::frame_source::report_footage;
use crate::failure::Failure;
use crate::image::Frame;
use crate::import;
use crate::recording::{RecordingInfo, RecordingWriter, WriterOptions};
use std::path::PathBuf;

/// The options of `ricochet import`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct ImportOptions {
    /// A Photron, Phantom or NumPy (.npy) file, a film (AVI, MP4, MOV, MKV; needs ffmpeg), a multi-page TIFF, or the
    /// images of one sequence in order.
    #[arg(required = true)]
    pub inputs: Vec<PathBuf>,
    /// Frame rate, Hz; replaces the file's own.
    #[arg(long)]
    pub fps: Option<f64>,
    /// Recording to write.
    #[arg(short, long)]
    pub output: PathBuf,
}

/// The result of an import.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Imported {
    /// The new recording.
    pub path: PathBuf,
    /// The number of frames.
    pub frames: u64,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Imports footage and stores its settings as metadata of the recording.
///
/// # Errors
///
/// When a file cannot be read or written. An unfinished recording remains as a part file.
pub fn run(options: &ImportOptions) -> Result<Imported, Failure> {
    let footage = import::open(&options.inputs, options.fps)?;
    report_footage(&footage);
    let mut metadata = footage.description.clone();
    metadata.insert("frame_rate_source".into(), footage.provenance.rate.to_string());
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
