//! Groups recordings into streams.

use crate::camera::replay::TimeRange;
use crate::console::UsageError;
use crate::failure::Failure;
use crate::image::FrameMeta;
use crate::recording::{Recording, RecordingError};
use std::path::PathBuf;

/// A stream of one camera.
pub(super) struct CameraStream {
    pub(super) recording: Recording,
    /// The name of a further camera; `None` for the first.
    pub(super) camera: Option<String>,
    /// The interval to play, in seconds from its first frame.
    pub(super) span: TimeRange,
}

/// Joins recordings that continue each other, separately for each camera, and returns the streams in time order.
///
/// Further cameras without frames are left out.
pub(super) fn join_streams(files: &[PathBuf]) -> Result<Vec<CameraStream>, RecordingError> {
    let mut parts = Vec::new();
    for recording in Recording::open_all(files)? {
        for camera in std::iter::once(None).chain(recording.views().into_iter().map(Some)) {
            let recording = recording.clone().select_view(camera.as_deref())?;
            if camera.is_some() && recording.frame_count() == 0 {
                continue;
            }
            parts.push(Part { first: recording.first_frame()?, last: recording.last_frame()?, recording, camera });
        }
    }
    // The sort is stable: of two that begin at the same time, the one named first comes first.
    parts.sort_by_key(|part| part.first.stamp_ns);
    let mut streams: Vec<Vec<Part>> = Vec::new();
    for part in parts {
        let before = streams.iter_mut().find(|stream| stream.last().is_some_and(|last| part.follows(last)));
        match before {
            Some(stream) => stream.push(part),
            None => streams.push(vec![part]),
        }
    }
    let joined = |stream: Vec<Part>| {
        let camera = stream.first().and_then(|part| part.camera.clone());
        let recording = Recording::joined(stream.into_iter().map(|part| part.recording).collect())?;
        Some(CameraStream { recording, camera, span: TimeRange::ALL })
    };
    Ok(streams.into_iter().filter_map(joined).collect())
}

/// A recording of one camera with its first and its last frame.
struct Part {
    recording: Recording,
    camera: Option<String>,
    first: FrameMeta,
    last: FrameMeta,
}

impl Part {
    /// Whether this part continues the stream of `before`.
    fn follows(&self, before: &Self) -> bool {
        let shape = |meta: &FrameMeta| (meta.width_px, meta.height_px, meta.format);
        let about = |part: &Self| {
            let entry = |key: &str| part.recording.metadata().get(key).cloned();
            (entry("rig"), entry("camera"), entry("serial"), part.recording.config_toml().map(str::to_owned))
        };
        // Other programs number their frames from 0, so a continuation cannot be recognised.
        self.recording.is_ours()
            && self.camera == before.camera
            && about(self) == about(before)
            && shape(&self.first) == shape(&before.first)
            && before.last.sequence < self.first.sequence
            && before.last.stamp_ns < self.first.stamp_ns
            && before.last.epoch <= self.first.epoch
    }
}

/// Returns the stamp of the earliest frame of all streams, ns since the Unix epoch.
pub(super) fn first_ns(streams: &[CameraStream]) -> Result<u64, RecordingError> {
    let mut first_ns = u64::MAX;
    for stream in streams {
        first_ns = first_ns.min(stream.recording.first_frame()?.stamp_ns);
    }
    Ok(first_ns)
}

/// Returns the streams that have frames in an interval, restricted to it. `whole` counts from the earliest frame of all
/// streams.
///
/// # Errors
///
/// [`UsageError`] when no stream has a frame in it, and [`RecordingError`] when one cannot be read.
pub(super) fn restrict_streams(streams: Vec<CameraStream>, whole: TimeRange) -> Result<Vec<CameraStream>, Failure> {
    let origin_ns = first_ns(&streams)?;
    let mut latest_ns = origin_ns;
    let mut inside = Vec::new();
    for stream in streams {
        let (first_ns, last_ns) = (stream.recording.first_frame()?.stamp_ns, stream.recording.last_frame()?.stamp_ns);
        latest_ns = latest_ns.max(last_ns);
        if whole.locate(origin_ns, last_ns).is_lt() || whole.locate(origin_ns, first_ns).is_gt() {
            continue;
        }
        let later_s = (first_ns - origin_ns) as f64 * 1e-9;
        let span = if later_s > 0.0 {
            TimeRange { from_s: (whole.from_s - later_s).max(0.0), to_s: whole.to_s - later_s }
        } else {
            whole
        };
        inside.push(CameraStream { span, ..stream });
    }
    if inside.is_empty() {
        let last_s = latest_ns.saturating_sub(origin_ns) as f64 * 1e-9;
        return Err(UsageError(format!("--from {}: beyond the last frame at {last_s} s", whole.from_s)).into());
    }
    Ok(inside)
}
