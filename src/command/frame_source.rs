//! The frames to measure offline: a recording, or footage of another program or camera.

use super::view_config;
use crate::camera::StreamFormat;
use crate::camera::replay::TimeRange;
use crate::config::Config;
use crate::console::UsageError;
use crate::failure::Failure;
use crate::image::{Frame, FrameMeta, Image};
use crate::import::{self, Order};
use crate::process::reference_picture;
use crate::recording::{self, Recording, RecordingError};
use crate::results::FrameCoding;
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::iter::Peekable;
use std::path::{Path, PathBuf};

/// The frames with their time stamps, in order.
pub(super) type Frames = Box<dyn Iterator<Item = Result<(FrameMeta, Vec<u8>), Failure>>>;

/// The metadata of results that holds the frame rate that the user gave for the film, Hz.
pub(super) const GIVEN_RATE: &str = "fps";
/// The metadata of results that holds the order that the user gave for the images of a sequence.
pub(super) const GIVEN_ORDER: &str = "order";
/// The value of that metadata for the reverse order.
pub(super) const REVERSED: &str = "reversed";

/// An opened film.
pub(super) struct Film {
    /// Size, pixel format and frame rate.
    pub(super) format: StreamFormat,
    /// The number of frames.
    pub(super) count: u64,
    /// The metadata of the file.
    pub(super) metadata: BTreeMap<String, String>,
    /// The reason why the file is truncated, if it is.
    pub(super) truncated: Option<String>,
    /// The configuration to measure with.
    pub(super) config: Config,
    /// The image in which the patches were drawn, if there are any.
    pub(super) reference: Option<Image>,
    /// The frames.
    pub(super) frames: Frames,
}

impl Film {
    /// Restricts the film to the frames from the start of an interval on and before its end, in s after its first
    /// frame.
    pub(super) fn within(mut self, span: TimeRange) -> Self {
        if span == TimeRange::ALL {
            return self;
        }
        let mut first_ns = None;
        let mut place = move |frame: &Result<(FrameMeta, Vec<u8>), Failure>| {
            let Ok((meta, _)) = frame else { return Ordering::Equal };
            span.locate(*first_ns.get_or_insert(meta.stamp_ns), meta.stamp_ns)
        };
        let placed = self.frames.map(move |frame| (place(&frame), frame));
        let inside = placed.skip_while(|(place, _)| place.is_lt()).take_while(|(place, _)| !place.is_gt());
        self.frames = Box::new(inside.map(|(_, frame)| frame));
        let max_frames = (span.to_s - span.from_s) * self.format.frame_rate_hz;
        self.count = self.count.min(max_frames.ceil() as u64);
        self
    }

    /// Opens a recording, the parts of one, another file, or the images of a sequence in the order given.
    ///
    /// `camera` selects one of several cameras by name. `config` replaces the attached rig file, `fps` the file's frame
    /// rate, Hz, and `order` the order of images. The metadata hold the rate and the order that were given.
    ///
    /// # Errors
    ///
    /// When a file cannot be opened, an option does not apply to it, or the rig file or the frame rate is missing.
    pub(super) fn open(
        inputs: &[PathBuf],
        camera: Option<&str>,
        config: Option<&Path>,
        fps: Option<f64>,
        order: Order,
    ) -> Result<Self, Failure> {
        if let Some(fps) = fps.filter(|fps| !(*fps > 0.0 && *fps <= import::MAX_RATE_HZ)) {
            let most = import::MAX_RATE_HZ;
            return Err(UsageError(format!("--fps {fps:e}: must be above 0 and at most {most:e}")).into());
        }
        let mut film = match inputs {
            [first, ..] if import::is_importable(first) => match camera {
                Some(camera) => {
                    return Err(
                        UsageError(format!("--camera {camera}: {} has only one camera", first.display())).into()
                    );
                }
                None => Self::open_footage(inputs, config, fps, order)?,
            },
            _ if order == Order::Reversed => {
                return Err(UsageError("--reverse: only the images of a sequence can be reversed".into()).into());
            }
            _ => Self::open_recordings(inputs, camera, config, fps)?,
        };
        film.metadata.remove(GIVEN_RATE);
        film.metadata.remove(GIVEN_ORDER);
        film.metadata.extend(fps.map(|fps| (GIVEN_RATE.to_owned(), fps.to_string())));
        film.metadata.extend((order == Order::Reversed).then(|| (GIVEN_ORDER.to_owned(), REVERSED.to_owned())));
        Ok(film)
    }

    /// Opens one recording, or the recorded parts of one stream, in the order of their first stamps.
    ///
    /// With `fps`, Hz, stamps are recomputed from the sequence numbers.
    fn open_recordings(
        paths: &[PathBuf],
        camera: Option<&str>,
        config: Option<&Path>,
        fps: Option<f64>,
    ) -> Result<Self, Failure> {
        let recordings = Recording::open_all(paths)?.into_iter().map(|recording| recording.select_view(camera));
        let parts = recordings.map(|recording| Part::open(recording?));
        let mut parts = parts.collect::<Result<Vec<_>, Failure>>()?;
        parts.sort_by_key(|part| part.first.stamp_ns);
        for pair in parts.windows(2) {
            pair[1].check_follows(&pair[0], config)?;
        }
        let Some(Part { recording, first, .. }) = parts.first() else {
            return Err(UsageError("no recording was given".into()).into());
        };
        let (meta, recording) = (*first, recording.clone());
        let config = rig_config(&recording, camera, config)?;
        let recorded = recording.metadata().get("frame_rate_hz").and_then(|text| text.parse().ok());
        let recorded = recorded.filter(|rate_hz: &f64| rate_hz.is_finite() && *rate_hz > 0.0);
        let Some(frame_rate_hz) = fps.or(recorded).or(recording.frame_rate_hz()?) else {
            let path = recording.path().display();
            return Err(UsageError(format!("{path}: the frame rate is unknown; pass it with --fps")).into());
        };
        Ok(Self {
            format: StreamFormat {
                width_px: meta.width_px,
                height_px: meta.height_px,
                format: meta.format,
                frame_rate_hz,
                exposure_us: recording.exposure_us(),
                coding: recording.coding(),
            },
            count: parts.iter().map(|part| part.recording.frame_count()).sum(),
            metadata: recording.metadata().clone(),
            truncated: parts.iter().find_map(|part| part.recording.truncated().map(str::to_owned)),
            reference: reference_picture::from_recording(&recording, &config)?,
            config,
            frames: Box::new(parts.into_iter().flat_map(|part| part.frames).map(move |frame| {
                let (next, bytes) = frame?;
                Ok((fps.map_or(next, |fps| restamp(next, &meta, fps)), bytes))
            })),
        })
    }

    /// Opens footage of another program, and prints what it states about itself.
    ///
    /// # Errors
    ///
    /// When it has no rig file `config`, or a file cannot be opened.
    fn open_footage(
        inputs: &[PathBuf],
        config: Option<&Path>,
        fps: Option<f64>,
        order: Order,
    ) -> Result<Self, Failure> {
        let Some(config) = config else {
            let first = inputs.first().map_or_else(String::new, |path| path.display().to_string());
            return Err(
                UsageError(format!("{first}: no config.toml is attached; pass a rig file with --config")).into()
            );
        };
        let footage = import::open_in_order(inputs, fps, order)?;
        report_footage(&footage);
        let format = StreamFormat {
            width_px: footage.width_px,
            height_px: footage.height_px,
            format: footage.format,
            frame_rate_hz: footage.frame_rate_hz,
            exposure_us: 0.0,
            coding: FrameCoding::of_metadata(&footage.description),
        };
        let (count, metadata, config) = (footage.count, footage.description.clone(), Config::load(config)?);
        let mut frames = ReportedFrames { findings: footage.findings.clone(), frames: footage }.peekable();
        let first = frames.peek().and_then(|first| first.as_ref().ok());
        let reference =
            first.and_then(|(meta, bytes)| reference_picture::from_first_frame(&Frame { meta: *meta, bytes }, &config));
        Ok(Self {
            format,
            count,
            metadata,
            truncated: None,
            reference,
            config,
            frames: Box::new(frames.map(|frame| Ok(frame?))),
        })
    }
}

/// Prints what the file states about rate, gaps and geometry, and warnings.
pub(super) fn report_footage(footage: &import::Footage) {
    eprintln!("{}", footage.summary());
    footage.warnings.iter().for_each(|warning| log::warn!("{warning}"));
}

/// Frames of footage; what they show about the file is printed at their end.
struct ReportedFrames {
    frames: import::Footage,
    findings: import::Findings,
}

impl Iterator for ReportedFrames {
    type Item = Result<(FrameMeta, Vec<u8>), import::ImportError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.frames.next()
    }
}

impl Drop for ReportedFrames {
    fn drop(&mut self) {
        report_findings(&self.findings);
    }
}

/// Prints what the frames show about the file: repeats, blended frames.
pub(super) fn report_findings(findings: &import::Findings) {
    findings.warnings().iter().for_each(|warning| log::warn!("{warning}"));
}

/// One of the recordings that form a film.
struct Part {
    recording: Recording,
    first: FrameMeta,
    frames: Peekable<recording::Frames>,
}

impl Part {
    /// Opens a recording at its first frame.
    ///
    /// # Errors
    ///
    /// When that frame cannot be read, or there is none.
    fn open(recording: Recording) -> Result<Self, Failure> {
        let mut frames = recording.frames()?.peekable();
        let first = match frames.peek() {
            Some(Ok((meta, _))) => *meta,
            _ => {
                let reason = "no readable frame".to_owned();
                let none = || RecordingError::Invalid { path: recording.path().to_owned(), reason };
                return Err(frames.next().and_then(Result::err).unwrap_or_else(none).into());
            }
        };
        Ok(Self { recording, first, frames })
    }

    /// Checks that this part continues the same stream: same kind of frames, later numbers and stamps, and same
    /// attached rig file.
    ///
    /// The rig file `config`, if it is given, replaces the attached ones, which then may differ.
    ///
    /// # Errors
    ///
    /// [`UsageError`] with both files and the reason.
    fn check_follows(&self, before: &Self, config: Option<&Path>) -> Result<(), Failure> {
        let [name, name_before] = [self, before].map(|part| part.recording.path().display().to_string());
        let shape = |meta: &FrameMeta| (meta.width_px, meta.height_px, meta.format);
        let last = before.recording.last_frame()?;
        let reason = if shape(&self.first) != shape(&before.first) {
            "its frames differ in size or pixel format"
        } else if last.sequence >= self.first.sequence || last.stamp_ns >= self.first.stamp_ns {
            "its frames do not follow the last frame of that recording"
        } else if config.is_none() && self.recording.config_toml() != before.recording.config_toml() {
            "its attached config.toml differs; pass a rig file with --config"
        } else {
            return Ok(());
        };
        Err(UsageError(format!("{name}: does not continue the recording in {name_before}: {reason}")).into())
    }
}

/// Checks `--from` and `--to` and returns the interval between them, from the first frame and to the last by default.
///
/// # Errors
///
/// [`UsageError`] when one is out of range or they are in the wrong order.
pub(super) fn span(from_s: Option<f64>, to_s: Option<f64>) -> Result<TimeRange, UsageError> {
    let known = |name: &str, seconds: Option<f64>| match seconds {
        Some(s) if !(0.0..=1.0e6).contains(&s) => Err(UsageError(format!("{name} {s}: must be 0 to 1000000 s"))),
        seconds => Ok(seconds),
    };
    let (from_s, to_s) = (known("--from", from_s)?.unwrap_or(0.0), known("--to", to_s)?.unwrap_or(f64::INFINITY));
    if to_s <= from_s {
        return Err(UsageError(format!("--to {to_s}: must be greater than --from, {from_s} s")));
    }
    Ok(TimeRange { from_s, to_s })
}

/// Returns a frame with its time stamp recomputed from the number of frames since the first and a rate in Hz.
pub(super) fn restamp(meta: FrameMeta, first: &FrameMeta, fps: f64) -> FrameMeta {
    let since_ns = meta.sequence.saturating_sub(first.sequence) as f64 * 1e9 / fps;
    FrameMeta { stamp_ns: first.stamp_ns.saturating_add(since_ns.round() as u64), ..meta }
}

/// Returns the configuration of a recording or of one of its cameras: the given rig file, else the attached one.
///
/// # Errors
///
/// When none is given and none is attached, or when it is invalid.
pub(super) fn rig_config(recording: &Recording, camera: Option<&str>, given: Option<&Path>) -> Result<Config, Failure> {
    if let Some(path) = given {
        let config = Config::load(path)?;
        // A rig file with several cameras configures each of them; any other applies to the selected camera.
        return Ok(if config.views.is_empty() { config } else { view_config(config, camera)? });
    }
    let path = recording.path().display();
    match recording.config_toml() {
        Some(text) => Ok(Config::parse(text, &format!("config.toml in {path}"))?),
        None => Err(UsageError(format!("{path}: no config.toml is attached; pass a rig file with --config")).into()),
    }
}
