//! The folder of the recordings: whether it is writable, and whether the next recording fits.

use super::clock::PeriodicTimer;
use crate::bus::Limits;
use crate::camera::StreamFormat;
use crate::config::{Config, Record, TriggerMode};
use crate::recording::RecordingError;
use rustix::fs::{Access, access, statvfs};
use std::path::PathBuf;
use std::time::Duration;

/// Interval of checking the folder.
const PERIOD: Duration = Duration::from_secs(1);
/// Required free space for a stream without an end, s of recording.
const STREAM_S: f64 = 10.0;
/// Size of a frame in a file without its pixels, bytes: headers, index entries, rows.
const FRAME_BYTES: u64 = 1024;
/// Size of a subset in a file, bytes, including the arrow for viewers.
const POINT_BYTES: u64 = 64;

/// Creates the folder of the recordings and checks that it is writable.
///
/// # Errors
///
/// [`RecordingError::Io`] if it cannot be created or written into.
pub(super) fn prepare_directory(record: &Record) -> Result<(), RecordingError> {
    let path = &record.directory;
    let fail = |action, source| RecordingError::Io { action, path: path.clone(), source };
    std::fs::create_dir_all(path).map_err(|source| fail("create", source))?;
    access(path, Access::WRITE_OK | Access::EXEC_OK).map_err(|error| fail("write into", error.into()))
}

/// The state of the folder at the last check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// The next recording fits.
    Enough,
    /// It may not fit.
    Scarce,
    /// The folder cannot be written into.
    Unusable,
}

/// Monitors the free space in the folder of the recordings.
#[derive(Debug)]
pub(super) struct Storage {
    directory: PathBuf,
    /// Size of all cameras' data per frame of the main camera; an upper estimate with uncompressed pixels.
    frame_bytes: u64,
    /// Frames of a whole shot including its pre-trigger time; for a stream, of the next seconds.
    shot_frames: u64,
    frames_per_second: u64,
    timer: PeriodicTimer,
    state: State,
}

impl Storage {
    /// Creates the monitor for these cameras, the main one first.
    pub(super) fn new<'a>(
        config: &Config,
        record: &Record,
        cameras: impl Iterator<Item = (&'a StreamFormat, &'a Limits)>,
    ) -> Self {
        let (mut rate_hz, mut bytes_per_second) = (0.0, 0.0);
        for (format, limits) in cameras {
            let pixels = if record.raw_frames { format.slot_bytes() as u64 } else { 0 };
            let points = u64::from(limits.fields) * limits.field_points as u64;
            if rate_hz <= 0.0 {
                rate_hz = format.frame_rate_hz;
            }
            bytes_per_second += (pixels + FRAME_BYTES + POINT_BYTES * points) as f64 * format.frame_rate_hz;
        }
        let shot_frames = match config.trigger.mode {
            // The duration of a hardware-triggered burst is unknown.
            TriggerMode::Off | TriggerMode::Hardware => (STREAM_S * rate_hz).ceil() as u64,
            // A shot begins with a block, so it may be one block longer than requested.
            _ => {
                let post = (config.trigger.post_s * rate_hz).ceil() as u64;
                config.pre_trigger_frames(rate_hz) + post + u64::from(config.workers.block_frames)
            }
        };
        Self {
            directory: record.directory.clone(),
            frame_bytes: (bytes_per_second / rate_hz).ceil() as u64,
            shot_frames,
            frames_per_second: rate_hz.ceil() as u64,
            timer: PeriodicTimer::new(PERIOD),
            state: State::Enough,
        }
    }

    /// Checks the folder once per period; returns a message if its state has changed.
    ///
    /// `left_frames` is the number of frames that the open shot still has to write; a whole shot if `None`.
    pub(super) fn check(&mut self, left_frames: Option<u64>) -> Option<String> {
        if !self.timer.restart_if_due() {
            return None;
        }
        let needed_bytes = left_frames.unwrap_or(self.shot_frames).saturating_mul(self.frame_bytes);
        let (state, text) = self.examine(needed_bytes);
        let is_news = state != self.state;
        self.state = state;
        is_news.then_some(text)
    }

    /// Returns the state of the folder if this number of bytes is needed, and its description for the operator.
    fn examine(&self, needed_bytes: u64) -> (State, String) {
        let name = self.directory.display();
        match self.free_bytes() {
            Err(error) => (State::Unusable, format!("{name} cannot be written into: {error}")),
            Ok(free_bytes) if free_bytes < needed_bytes => {
                (State::Scarce, format!("{free_bytes} bytes are free in {name}, a recording may need {needed_bytes}"))
            }
            Ok(free_bytes) => (State::Enough, format!("{free_bytes} bytes are free in {name} again")),
        }
    }

    /// Returns the space available to an ordinary user, bytes.
    ///
    /// # Errors
    ///
    /// If the folder is gone or cannot be written into.
    fn free_bytes(&self) -> std::io::Result<u64> {
        access(&self.directory, Access::WRITE_OK | Access::EXEC_OK)?;
        let stat = statvfs(&self.directory)?;
        Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
    }

    /// Whether a recording would not fit, or cannot be written at all.
    pub(super) fn has_problem(&self) -> bool {
        self.state != State::Enough
    }

    /// Whether there is room for a second of a stream, so that it is worth starting.
    pub(super) fn has_room_to_begin(&self) -> bool {
        let needed_bytes = self.frames_per_second.saturating_mul(self.frame_bytes);
        self.free_bytes().is_ok_and(|free_bytes| free_bytes >= needed_bytes)
    }
}
