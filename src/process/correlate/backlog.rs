//! The frames that wait for a worker, and the frames that it has lost.

use crate::bus::Bus;
use crate::message::Role;
use crate::process::resume::NewestFrameFile;

/// The share of its queue that waits for a worker that is far behind, and the share below which it has caught up.
const BEHIND_SHARE: f64 = 0.5;
const CAUGHT_UP_SHARE: f64 = 0.25;

/// The distance of a worker to the camera.
#[derive(Debug)]
pub(super) struct Backlog {
    /// The newest frame of the camera.
    newest: NewestFrameFile,
    /// The number of frames that the queue of the worker can hold.
    pub(super) capacity: u64,
    is_behind: bool,
    /// The losses that were reported.
    lost: u64,
}

impl Backlog {
    /// Opens the file in which the camera's process notes its newest frame.
    ///
    /// # Errors
    ///
    /// If the file cannot be opened.
    pub(super) fn open(bus: &Bus, capacity: u64) -> std::io::Result<Self> {
        let (newest, _) = NewestFrameFile::open(&bus.private_file(Role::Acquire.as_str()))?;
        Ok(Self { newest, capacity, is_behind: false, lost: 0 })
    }

    /// Returns the number of frames in the queue of a worker whose next frame is `next`; 0 before its first frame.
    pub(super) fn waiting(&self, next: Option<u64>) -> u64 {
        let newest = self.newest.read().map_or(0, |(newest, _)| newest.sequence);
        next.map_or(0, |next| (newest + 1).saturating_sub(next).min(self.capacity))
    }

    /// Returns a warning when a worker falls far behind; `waiting` is the number of its waiting frames.
    pub(super) fn note_waiting(&mut self, waiting: u64) -> Option<String> {
        let share = waiting as f64 / self.capacity.max(1) as f64;
        let was_behind = self.is_behind;
        self.is_behind = share >= if was_behind { CAUGHT_UP_SHARE } else { BEHIND_SHARE };
        (self.is_behind && !was_behind)
            .then(|| format!("{waiting} of at most {} frames wait; then frames are lost", self.capacity))
    }

    /// Returns the number of frames lost since the last call, if there are any. `lost` is their number since the start.
    pub(super) fn note_lost(&mut self, lost: u64) -> Option<u64> {
        let new = lost.saturating_sub(std::mem::replace(&mut self.lost, lost));
        (new > 0).then_some(new)
    }
}
