//! The folder of the recordings: whether files can be written into it, and whether what is to come has room.

use super::clock::Every;
use crate::bus::Limits;
use crate::camera::StreamFormat;
use crate::config::{Config, Record, TriggerMode};
use crate::recording::RecordingError;
use rustix::fs::{Access, access, statvfs};
use std::path::PathBuf;
use std::time::Duration;

const PERIOD: Duration = Duration::from_secs(1);
/// Of a stream without an end, this much must have room, s.
const STREAM_S: f64 = 10.0;
/// Bytes a frame takes beside its pixels: headers, index entries, rows.
const FRAME_BYTES: u64 = 1024;
/// Bytes a subset takes in a file, with the arrow that viewers draw.
const POINT_BYTES: u64 = 64;

/// Makes the folder of the recordings and sees that files can be written into it.
pub(super) fn prepare_directory(record: &Record) -> Result<(), RecordingError> {
    let path = &record.directory;
    let fail = |action, source| RecordingError::Io { action, path: path.clone(), source };
    std::fs::create_dir_all(path).map_err(|source| fail("create", source))?;
    access(path, Access::WRITE_OK | Access::EXEC_OK).map_err(|error| fail("write into", error.into()))
}

/// How the folder was when last looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Enough,
    Scarce,
    Unusable,
}

/// Watches the room in the folder of the recordings.
#[derive(Debug)]
pub(super) struct Storage {
    directory: PathBuf,
    /// Of all cameras for each frame of the first; estimate from above, pixels as they are.
    frame_bytes: u64,
    /// Frames of a whole shot, its time before the trigger included; of a stream, of the next seconds.
    shot_frames: u64,
    frames_a_second: u64,
    every: Every,
    state: State,
}

impl Storage {
    /// For these cameras, the first one first: what each delivers, and what is measured of it.
    pub(super) fn new<'a>(
        config: &Config,
        record: &Record,
        cameras: impl Iterator<Item = (&'a StreamFormat, &'a Limits)>,
    ) -> Self {
        let (mut rate_hz, mut bytes_a_second) = (0.0, 0.0);
        for (format, limits) in cameras {
            let pixels = if record.raw_frames { format.slot_bytes() as u64 } else { 0 };
            let points = u64::from(limits.fields) * limits.field_points as u64;
            if rate_hz <= 0.0 {
                rate_hz = format.frame_rate_hz;
            }
            bytes_a_second += (pixels + FRAME_BYTES + POINT_BYTES * points) as f64 * format.frame_rate_hz;
        }
        let shot_frames = match config.trigger.mode {
            // How long a line fires is not known.
            TriggerMode::Off | TriggerMode::Hardware => (STREAM_S * rate_hz).ceil() as u64,
            // It begins with a block, so up to one more than asked for.
            _ => {
                let post = (config.trigger.post_s * rate_hz).ceil() as u64;
                config.pre_trigger_frames(rate_hz) + post + u64::from(config.workers.block_frames)
            }
        };
        Self {
            directory: record.directory.clone(),
            frame_bytes: (bytes_a_second / rate_hz).ceil() as u64,
            shot_frames,
            frames_a_second: rate_hz.ceil() as u64,
            every: Every::new(PERIOD),
            state: State::Enough,
        }
    }

    /// Looks, when it is time again; gives what changed, in words.
    ///
    /// `left_frames` are those that the shot under way still has to write; a whole shot when `None`.
    pub(super) fn look(&mut self, left_frames: Option<u64>) -> Option<String> {
        if !self.every.due() {
            return None;
        }
        let needed_bytes = left_frames.unwrap_or(self.shot_frames).saturating_mul(self.frame_bytes);
        let (state, text) = self.find(needed_bytes);
        let is_news = state != self.state;
        self.state = state;
        is_news.then_some(text)
    }

    fn find(&self, needed_bytes: u64) -> (State, String) {
        let name = self.directory.display();
        match self.free_bytes() {
            Err(error) => (State::Unusable, format!("{name} cannot be written into: {error}")),
            Ok(free_bytes) if free_bytes < needed_bytes => {
                (State::Scarce, format!("{free_bytes} bytes are free in {name}, a recording may need {needed_bytes}"))
            }
            Ok(free_bytes) => (State::Enough, format!("{free_bytes} bytes are free in {name} again")),
        }
    }

    /// What an ordinary user may still write there, bytes.
    fn free_bytes(&self) -> std::io::Result<u64> {
        access(&self.directory, Access::WRITE_OK | Access::EXEC_OK)?;
        let stat = statvfs(&self.directory)?;
        Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
    }

    /// Whether a recording would not fit, or cannot be written at all.
    pub(super) fn is_troubled(&self) -> bool {
        self.state != State::Enough
    }

    /// Whether a second of a stream has room, so that it is worth beginning.
    pub(super) fn has_room_to_begin(&self) -> bool {
        let needed_bytes = self.frames_a_second.saturating_mul(self.frame_bytes);
        self.free_bytes().is_ok_and(|free_bytes| free_bytes >= needed_bytes)
    }
}
