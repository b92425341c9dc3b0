//! A recording that is being made: frames and steps in, a finished file out.

mod camera_part;

use crate::camera::{CameraIdentity, StreamFormat};
use crate::config::{Compression, Config, Scale};
use crate::image::{Frame, is_dated};
use crate::recording::{self, Annotations, EventRow, FinishedRecording, RecordingError, RecordingInfo};
use crate::recording::{RecordingWriter, WriterOptions};
use crate::results::{BodyStep, PairField, VelocitySample, segments};
use crate::synth::SimulatedFilm;
use crate::track::{TrackerParams, TrackerRows};
use camera_part::CameraPart;
use chrono::DateTime;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// The frames of one camera's part of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRange {
    /// Sequence number of the first frame.
    pub first: u64,
    /// Sequence number of the last frame; `None` if unknown yet.
    pub last: Option<u64>,
    /// Number of newer frames after which a missing step is given up.
    pub max_delay_frames: u64,
}

/// A recording that is being made.
///
/// Its rows come from a tracker of its own that receives the steps of exactly the recorded frames. They are thus a
/// function of the file's frames alone, and offline analysis of the file gives the same bytes. Each camera has its own
/// part; camera 0 is the main one.
pub struct Shot {
    writer: RecordingWriter,
    writes_frames: bool,
    /// One per camera; `None` until its first frame is known.
    parts: Vec<Option<CameraPart>>,
}

impl Shot {
    /// Creates `<path>.part` for the main camera and the views in `info`.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn create(path: &Path, config: &Config, info: &RecordingInfo) -> Result<Self, RecordingError> {
        let record = config.record.as_ref();
        let compression = match record.map(|record| record.compression) {
            Some(Compression::Zstd) => recording::Compression::Zstd1,
            _ => recording::Compression::None,
        };
        let split_bytes = record.and_then(|record| record.split_bytes);
        let options = WriterOptions { compression, split_bytes, ..WriterOptions::default() };
        Ok(Self {
            writer: RecordingWriter::create(path, info, &options)?,
            writes_frames: record.is_some_and(|record| record.raw_frames),
            parts: (0..=info.views.len()).map(|_| None).collect(),
        })
    }

    /// Begins the part of a camera, tracked with `params`; `None` if nothing is measured.
    pub fn begin(&mut self, camera: usize, params: Option<&TrackerParams>, range: FrameRange) {
        self.parts[camera] = Some(CameraPart::new(params, range));
    }

    /// Sets the end of a camera's part, one past its last frame.
    pub fn set_end(&mut self, camera: usize, end: u64) {
        if let Some(part) = &mut self.parts[camera] {
            part.range.last = Some(end.saturating_sub(1));
        }
    }

    /// Writes the true impacts of a camera's film, and from now on the ground truth of each of its frames; `None`
    /// writes none.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn set_truth(&mut self, camera: usize, world: Option<Rc<SimulatedFilm>>) -> Result<(), RecordingError> {
        self.writer.select_camera(camera);
        for impact in world.iter().flat_map(|world| world.impacts()) {
            self.writer.write_truth_impact(&impact)?;
        }
        if let Some(part) = &mut self.parts[camera] {
            part.truth = world;
        }
        Ok(())
    }

    /// Counts the next frame of a camera and writes it, unless raw frames are off, with its ground truth. Sequence
    /// numbers rise. Frames before the camera's part has begun are ignored.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn write_frame(&mut self, camera: usize, frame: &Frame<'_>) -> Result<(), RecordingError> {
        let Some(part) = &mut self.parts[camera] else { return Ok(()) };
        self.writer.select_camera(camera);
        part.count(frame.meta.sequence);
        if self.writes_frames {
            self.writer.write_frame(frame)?;
        }
        if let Some(world) = &part.truth
            && frame.meta.sequence < world.frames()
        {
            for row in world.truths(frame.meta.sequence) {
                // Between pulses the camera's clock runs on, but the simulated time stands still.
                self.writer.write_truth(&VelocitySample { stamp_ns: frame.meta.stamp_ns, ..row })?;
            }
        }
        Ok(())
    }

    /// Hands buffered data to the system; to be called when nothing else is to be written at once.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn write_buffered(&mut self) -> Result<(), RecordingError> {
        self.writer.write_buffered()
    }

    /// Returns the path; that of the first file if split.
    pub fn path(&self) -> &Path {
        self.writer.path()
    }

    /// Returns the size of its files so far, bytes.
    pub fn written_bytes(&self) -> u64 {
        self.writer.written_bytes()
    }

    /// Whether a camera's part has begun.
    pub fn has_begun(&self, camera: usize) -> bool {
        self.parts[camera].is_some()
    }

    /// Returns the first frame of a camera; 0 before its part has begun.
    pub fn first_frame(&self, camera: usize) -> u64 {
        self.parts[camera].as_ref().map_or(0, |part| part.range.first)
    }

    /// Returns one past the newest frame of a camera; 0 before its part has begun.
    pub fn next_frame(&self, camera: usize) -> u64 {
        self.parts[camera].as_ref().map_or(0, |part| part.next_frame)
    }

    /// Returns the number of a camera's frames that are missing between the first and the newest.
    pub fn lost(&self, camera: usize) -> u64 {
        self.parts[camera].as_ref().map_or(0, |part| part.lost)
    }

    /// Returns the number of frames written (or, without raw frames, passed) for all cameras.
    pub fn frames(&self) -> u64 {
        self.parts.iter().flatten().map(|part| part.frames).sum()
    }

    /// Returns the number of frames that may be missing in the file if nothing more can be written: the main camera's
    /// before `end`, and the others' so far.
    pub fn missing_before(&self, end: u64) -> u64 {
        let due = |(camera, part): (usize, &Option<CameraPart>)| match part {
            Some(part) if camera == 0 => end.saturating_sub(part.range.first),
            Some(part) => part.frames,
            None => 0,
        };
        let due: u64 = self.parts.iter().enumerate().map(due).sum();
        due.saturating_sub(self.writer.safe_frames())
    }

    /// Writes a measured step, its field and the rows that become final; returns `false` if it lies outside the
    /// recording. Steps may come in any order.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn write_step(
        &mut self,
        camera: usize,
        step: BodyStep,
        field: Option<PairField>,
    ) -> Result<bool, RecordingError> {
        let Some(part) = &mut self.parts[camera] else { return Ok(false) };
        let Some((step, field)) = part.clip(step, field) else { return Ok(false) };
        self.writer.select_camera(camera);
        if let Some(field) = &field {
            self.writer.write_field(field)?;
        }
        if step.interval_frames == part.shortest_frames {
            self.writer.write_annotations(step.stamp_ns, &annotations(&step, field.as_ref()))?;
        }
        let rows = part.ordered.as_mut().map(|ordered| std::mem::take(ordered.push(step))).unwrap_or_default();
        self.write_rows(camera, &rows)?;
        Ok(true)
    }

    /// Writes an event.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn write_event(&mut self, event: &EventRow) -> Result<(), RecordingError> {
        self.writer.write_event(event)
    }

    /// Whether the steps of every frame of a camera before `end` have come, or none will.
    pub fn has_steps_before(&self, camera: usize, end: u64) -> bool {
        self.parts[camera].as_ref().is_none_or(|part| part.has_steps_before(end))
    }

    /// Ends each camera's part at its entry of `ends` (one past the last frame) and gives the file its name.
    ///
    /// Returns the file, and the number of lost results: rows given up because their steps never came, and steps that
    /// came too late or twice.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub fn finish(mut self, ends: &[u64]) -> Result<(FinishedRecording, u64), RecordingError> {
        let mut missing = 0;
        for (camera, end) in ends.iter().enumerate() {
            let Some(part) = &mut self.parts[camera] else { continue };
            let Some(ordered) = &mut part.ordered else { continue };
            let rows = std::mem::take(ordered.finish(*end));
            let losses = ordered.losses();
            missing += losses.lost + losses.late;
            self.write_rows(camera, &rows)?;
        }
        Ok((self.writer.finish()?, missing))
    }

    /// Writes the rows of a camera that became final.
    fn write_rows(&mut self, camera: usize, rows: &TrackerRows) -> Result<(), RecordingError> {
        self.writer.select_camera(camera);
        for sample in &rows.tracks {
            self.writer.write_track(sample)?;
        }
        for sample in &rows.velocities {
            self.writer.write_velocity(sample)?;
        }
        for impact in &rows.impacts {
            self.writer.write_impact(impact)?;
        }
        Ok(())
    }
}

/// Returns the outline of a body and ten times the displacement of each subset, as lines over the image, px.
fn annotations(step: &BodyStep, field: Option<&PairField>) -> Annotations {
    const MAGNIFICATION: f64 = 10.0;
    let vector = |point: &crate::results::FieldPoint| {
        let motion = point.displacement?;
        let (x, y) = (f64::from(point.x_px), f64::from(point.y_px));
        let tip = [x + MAGNIFICATION * f64::from(motion.u_px), y + MAGNIFICATION * f64::from(motion.v_px)];
        Some([[x, y], tip])
    };
    let rod = step.rod();
    let outline = rod.iter().flat_map(segments);
    let arrows = field.into_iter().flat_map(|field| field.points.iter().filter_map(vector));
    Annotations {
        circles: step.circle().iter().map(|circle| [circle.x_px, circle.y_px, circle.radius_px]).collect(),
        vectors: outline.chain(arrows).collect(),
    }
}

/// Returns the description of a recording: its configuration, metadata and bodies, without attachments and views.
/// `trigger` is the cause of the recording in words.
pub fn recording_info(config: &Config, format: &StreamFormat, camera: &CameraIdentity, trigger: &str) -> RecordingInfo {
    let scale = match config.scale {
        Some(Scale::MmPerPx(mm)) => format!("{mm} mm/px"),
        Some(Scale::BallDiameterMm(mm)) => format!("ball of {mm} mm"),
        Some(Scale::Unknown) | None => "none".into(),
    };
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let metadata = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("rig", config.rig.name.clone()),
        ("camera", camera.model.clone()),
        ("serial", camera.serial.clone()),
        ("frame_rate_hz", format.frame_rate_hz.to_string()),
        ("exposure_us", config.camera.exposure_us.unwrap_or(format.exposure_us).to_string()),
        ("scale", scale),
        ("host", host.trim().to_owned()),
        ("trigger", trigger.to_owned()),
    ];
    let entries = metadata.into_iter().map(|(key, value)| (key.to_owned(), value));
    RecordingInfo {
        config_toml: config.text.clone(),
        metadata: entries.chain(format.coding.metadata()).collect::<BTreeMap<_, _>>(),
        bodies: config.bodies.iter().map(|body| body.name.clone()).collect(),
        attachments: Vec::new(),
        views: Vec::new(),
    }
}

/// Returns an unused path in `directory`. The name is the rig, then the first frame's time in UTC if it has a date, then
/// a number from 2 on if that is taken.
pub(super) fn free_path(directory: &Path, rig: &str, stamp_ns: u64) -> PathBuf {
    let name = if is_dated(stamp_ns) { format!("{rig}-{}", format_utc(stamp_ns)) } else { rig.to_owned() };
    let taken = |path: &Path| path.exists() || recording::part_path(path).exists();
    let numbered = |number: u32| match number {
        1 => directory.join(format!("{name}.mcap")),
        _ => directory.join(format!("{name}-{number}.mcap")),
    };
    (1..u32::MAX).map(numbered).find(|path| !taken(path)).unwrap_or_else(|| numbered(u32::MAX))
}

/// Formats a time, ns since the Unix epoch, as UTC to the millisecond: `20261121-083000-123`.
fn format_utc(stamp_ns: u64) -> String {
    let time = DateTime::from_timestamp_nanos(i64::try_from(stamp_ns).unwrap_or(i64::MAX));
    time.format("%Y%m%d-%H%M%S-%3f").to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_become_dates_also_at_leap_days_and_year_ends() {
        let name = |seconds: u64| format_utc(seconds * 1_000_000_000 + 7_000_000);
        assert_eq!(name(0), "19700101-000000-007");
        assert_eq!(name(951_782_400), "20000229-000000-007");
        assert_eq!(name(1_798_761_599), "20261231-235959-007");
    }
}
