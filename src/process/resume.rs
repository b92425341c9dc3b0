//! The state from which a restarted process continues.

use super::frame_stamp::FrameStamp;
use crate::camera::v4l2::monotonic_ns;
use std::fs::{File, OpenOptions};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;

/// The last known state of a process that died.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resume {
    /// Its last published frame.
    pub published: u64,
    /// The same; for a camera process, the frame that is due by now.
    pub sequence: u64,
    /// Stamp of that frame, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Number of times the camera was reopened so far.
    pub epoch: u32,
}

impl Resume {
    /// Returns the state after this time in a stream of this rate. A part of a frame counts as a frame; at a rate of 0
    /// the frame stays the same.
    #[must_use]
    pub fn after(self, seconds: f64, frame_rate_hz: f64) -> Self {
        // A conversion from a float saturates.
        let frames = (seconds * frame_rate_hz).ceil() as u64;
        let ns = (seconds * 1e9).round() as u64;
        let (sequence, stamp_ns) = (self.sequence.saturating_add(frames), self.stamp_ns.saturating_add(ns));
        Self { sequence, stamp_ns, ..self }
    }

    /// Returns the sequence number of the first frame after the restart, which has this stamp, ns. `frame_rate_hz` is 0
    /// for a camera without a rate of its own.
    ///
    /// Numbers count the frames that were missed meanwhile. The result begins a block, so that its measurement does
    /// not depend on the loss.
    pub fn first_frame(&self, stamp_ns: u64, frame_rate_hz: f64, block_frames: u32) -> u64 {
        let frames = stamp_ns.saturating_sub(self.stamp_ns) as f64 * 1e-9 * frame_rate_hz;
        let due = self.sequence.saturating_add(1).max(self.sequence.saturating_add(frames.round() as u64));
        due.next_multiple_of(u64::from(block_frames))
    }
}

/// The newest frame of a process, in a file that outlives the process.
///
/// The system keeps what was written when the process is killed, so its successor knows the very last frame.
#[derive(Debug)]
pub(super) struct NewestFrameFile(File);

impl NewestFrameFile {
    /// Opens the file, or creates it. Also returns the state that a predecessor left in it, and the time since that was
    /// saved, s; `None` if the file is new or was cleared.
    pub(super) fn open(path: &Path) -> std::io::Result<(Self, Option<(Resume, f64)>)> {
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(path)?;
        let file = Self(file);
        let previous = file.read();
        Ok((file, previous))
    }

    /// Reads the state that was written last, and the time since then, s; `None` if the file is new or was cleared.
    pub(super) fn read(&self) -> Option<(Resume, f64)> {
        let mut bytes = [0; 40];
        self.0.read_exact_at(&mut bytes, 0).ok()?;
        let number =
            |at: usize| bytes[8 * at..8 * at + 8].iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
        let epoch = u32::try_from(number(2)).unwrap_or(u32::MAX);
        let resume = Resume { published: number(4), sequence: number(0), stamp_ns: number(1), epoch };
        Some((resume, monotonic_ns().saturating_sub(number(3)) as f64 * 1e-9))
    }

    /// Writes the newest published frame. Errors are ignored.
    pub(super) fn save(&self, frame: FrameStamp, epoch: u32) {
        let FrameStamp { sequence, stamp_ns } = frame;
        self.save_state(&Resume { published: sequence, sequence, stamp_ns, epoch });
    }

    /// Writes a state. Errors are ignored.
    pub(super) fn save_state(&self, state: &Resume) {
        let numbers = [state.sequence, state.stamp_ns, u64::from(state.epoch), monotonic_ns(), state.published];
        let mut bytes = [0; 40];
        bytes.chunks_exact_mut(8).zip(numbers).for_each(|(part, number)| part.copy_from_slice(&number.to_le_bytes()));
        // Without it a successor only counts fewer of the lost frames.
        let _ = self.0.write_all_at(&bytes, 0);
    }

    /// Empties the file, so that no frame of a previous stream is left.
    pub(super) fn clear(&self) {
        let _ = self.0.set_len(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_frame_outlives_its_process() {
        let path = std::env::temp_dir().join(format!("ricochet-reached-{}", std::process::id()));
        let (first, none) = NewestFrameFile::open(&path).unwrap();
        assert_eq!(none, None);
        first.save(FrameStamp { sequence: 7, stamp_ns: 9 }, 1);
        let frame = FrameStamp { sequence: 1234, stamp_ns: 1_767_225_600_000_000_007 };
        first.save(frame, 3);
        drop(first);
        let (second, left) = NewestFrameFile::open(&path).unwrap();
        let (resume, age_s) = left.unwrap();
        let FrameStamp { sequence, stamp_ns } = frame;
        assert_eq!(resume, Resume { published: sequence, sequence, stamp_ns, epoch: 3 });
        // A successor that dies before it films leaves the frame that its own successor counts the loss from.
        let due = resume.after(2.0, 100.0);
        second.save_state(&due);
        assert_eq!(second.read().unwrap().0, Resume { sequence: sequence + 200, ..due });
        assert_eq!(due.published, sequence);
        assert!((0.0..60.0).contains(&age_s), "{age_s}");
        second.clear();
        assert_eq!(NewestFrameFile::open(&path).unwrap().1, None);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn numbers_continue_after_the_missed_frames_with_the_start_of_a_block() {
        let resume = Resume { published: 100, sequence: 100, stamp_ns: 5_000_000_000, epoch: 1 }.after(0.1, 500.0);
        assert_eq!((resume.sequence, resume.stamp_ns), (150, 5_100_000_000));
        // 0.3 s later 150 more frames were due.
        assert_eq!(resume.first_frame(5_400_000_000, 500.0, 16), 304);
        assert_eq!(resume.first_frame(5_400_000_000, 500.0, 4), 300);
        // A stamp that stepped back, or a camera without a rate of its own, never repeats a number.
        assert_eq!(resume.first_frame(0, 500.0, 1), 151);
        assert_eq!(resume.first_frame(9_000_000_000, 0.0, 1), 151);
    }
}
