//! Frames to measure offline: a recording, or other people's footage.

use super::{UsageError, replay::rig_config};
use crate::camera::StreamFormat;
use crate::config::Config;
use crate::image::FrameMeta;
use crate::import;
use crate::recording::{Recording, RecordingError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// One frame after the other, with their stamps.
pub(super) type Frames = Box<dyn Iterator<Item = anyhow::Result<(FrameMeta, Vec<u8>)>>>;

/// A film that was opened.
pub(super) struct Film {
    /// Shape and rate of its frames.
    pub(super) format: StreamFormat,
    /// How many there are.
    pub(super) count: u64,
    /// What the file says of itself.
    pub(super) metadata: BTreeMap<String, String>,
    /// Why it ends too early, when it does.
    pub(super) truncated: Option<String>,
    /// The rig it is measured with.
    pub(super) config: Config,
    /// The frames.
    pub(super) frames: Frames,
}

impl Film {
    /// Opens a recording, or one other file, or images that make a sequence in the order given.
    ///
    /// `config` takes the place of the attached rig file, `fps` that of the file's frame rate.
    pub(super) fn open(inputs: &[PathBuf], config: Option<&Path>, fps: Option<f64>) -> anyhow::Result<Self> {
        if let Some(fps) = fps.filter(|fps| !(fps.is_finite() && *fps > 0.0)) {
            return Err(UsageError(format!("--fps {fps}: not a positive number")).into());
        }
        match inputs {
            [first, ..] if import::is_importable(first) => Self::footage(inputs, config, fps),
            [recording] => Self::recording(recording, config, fps),
            _ => Err(UsageError("give one recording, or the images of one sequence".into()).into()),
        }
    }

    fn recording(path: &Path, config: Option<&Path>, fps: Option<f64>) -> anyhow::Result<Self> {
        let recording = Recording::open(path)?;
        let mut frames = recording.frames()?.peekable();
        let meta = match frames.peek() {
            Some(Ok((meta, _))) => *meta,
            _ => {
                let reason = "no frame of it can be read".to_owned();
                let none = || RecordingError::Invalid { path: path.to_owned(), reason };
                return Err(frames.next().and_then(Result::err).unwrap_or_else(none).into());
            }
        };
        let told = recording.metadata().get("frame_rate_hz").and_then(|text| text.parse().ok());
        let told = told.filter(|rate_hz: &f64| rate_hz.is_finite() && *rate_hz > 0.0);
        let Some(frame_rate_hz) = fps.or(told).or(recording.frame_rate_hz()?) else {
            let path = path.display();
            return Err(UsageError(format!("{path}: no frame rate can be told; give one with --fps")).into());
        };
        Ok(Self {
            format: StreamFormat {
                width_px: meta.width_px,
                height_px: meta.height_px,
                format: meta.format,
                frame_rate_hz,
                exposure_us: recording.exposure_us(),
            },
            count: recording.frame_count(),
            metadata: recording.metadata().clone(),
            truncated: recording.truncated().map(str::to_owned),
            config: rig_config(&recording, config)?,
            frames: Box::new(frames.map(move |frame| {
                let (next, bytes) = frame?;
                Ok((fps.map_or(next, |fps| restamped(next, &meta, fps)), bytes))
            })),
        })
    }

    fn footage(inputs: &[PathBuf], config: Option<&Path>, fps: Option<f64>) -> anyhow::Result<Self> {
        let Some(config) = config else {
            let first = inputs.first().map_or_else(String::new, |path| path.display().to_string());
            return Err(UsageError(format!("{first}: no config.toml is attached; give one with --config")).into());
        };
        let footage = import::open(inputs, fps)?;
        for warning in &footage.warnings {
            log::warn!("{warning}");
        }
        Ok(Self {
            format: StreamFormat {
                width_px: footage.width_px,
                height_px: footage.height_px,
                format: footage.format,
                frame_rate_hz: footage.frame_rate_hz,
                exposure_us: 0.0,
            },
            count: footage.count,
            metadata: footage.description.clone(),
            truncated: None,
            config: Config::load(config)?,
            frames: Box::new(footage.map(|frame| Ok(frame?))),
        })
    }
}

/// A frame with the stamp that a rate from the person who asks gives it, in place of the file's own.
fn restamped(meta: FrameMeta, first: &FrameMeta, fps: f64) -> FrameMeta {
    let since_ns = meta.sequence.saturating_sub(first.sequence) as f64 * 1e9 / fps;
    FrameMeta { stamp_ns: first.stamp_ns.saturating_add(since_ns.round() as u64), ..meta }
}
