//! `ricochet import`: converts footage of other programs or cameras into a recording.

use super::frame_source::{report_findings, report_footage};
use super::image_order::ImageOrder;
use crate::console::{print_line, progress};
use crate::failure::Failure;
use crate::image::Frame;
use crate::import::{self, Footage, Provenance};
use crate::recording::{Compression, RecordingInfo, RecordingWriter, WriterOptions};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The options of `ricochet import`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct ImportOptions {
    /// A Photron, Phantom or NumPy (.npy) file, a film (AVI, MP4, MOV, MKV, ...; needs ffmpeg), a multi-page TIFF, the
    /// images of one sequence, their folder, or a pattern such as 'shot/*.png'.
    #[arg(required = true)]
    pub inputs: Vec<PathBuf>,
    /// Frame rate, Hz; replaces the file's own.
    #[arg(long)]
    pub fps: Option<f64>,
    /// The order of the images of a sequence.
    #[command(flatten)]
    pub order: ImageOrder,
    /// Recording to write.
    #[arg(short, long)]
    pub output: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
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
    let footage = import::open_in_order(&options.inputs, options.fps, options.order.order())?;
    report_footage(&footage);
    let mut metadata = collect_metadata(&footage);
    let names = options.inputs.first().and_then(|path| path.file_name());
    metadata.insert("imported_from".into(), names.unwrap_or_default().to_string_lossy().into_owned());
    let info = RecordingInfo { metadata: metadata.clone(), ..RecordingInfo::default() };
    let (mut warnings, findings) = (footage.warnings.clone(), footage.findings.clone());
    // The frames of films and of empty backgrounds take a fraction of their size.
    let writer_options = WriterOptions { compression: Compression::Zstd1, ..WriterOptions::default() };
    let mut writer = RecordingWriter::create(&options.output, &info, &writer_options)?;
    let bar = progress::bar(footage.count, "import");
    for frame in footage {
        let (meta, bytes) = frame?;
        writer.write_frame(&Frame { meta, bytes: &bytes })?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    report_findings(&findings);
    warnings.extend(findings.warnings());
    let finished = writer.finish()?;
    let imported = Imported { path: finished.path, frames: finished.frames, warnings };
    if options.json {
        let Imported { path, frames, warnings } = &imported;
        let row = serde_json::json!({
            "recording": path, "frames": frames, "bytes": finished.bytes, "metadata": metadata, "warnings": warnings
        });
        print_line(&row.to_string());
    }
    Ok(imported)
}

/// Collects the properties that the file states, and what was done with them.
fn collect_metadata(footage: &Footage) -> BTreeMap<String, String> {
    let mut metadata = footage.description.clone();
    let Provenance { rate, missing, orientation, pixel_aspect, bits, grey_rule, .. } = &footage.provenance;
    let grey_rule = if grey_rule.is_empty() { "grey" } else { grey_rule };
    let entries = [
        ("frame_rate_hz", footage.frame_rate_hz.to_string()),
        ("frame_rate_source", rate.to_string()),
        ("missing_frames", missing.to_string()),
        ("orientation", orientation.to_string()),
        ("pixel_aspect", pixel_aspect.to_string()),
        ("significant_bits", bits.to_string()),
        ("grey_levels", grey_rule.to_owned()),
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
    ];
    metadata.extend(entries.map(|(name, value)| (name.to_owned(), value)));
    metadata
}
