//! How much of everything a rig may hold.

/// Sizes that all processes of a rig agree on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Correlation workers.
    pub workers: u32,
    /// Fields that are measured of a frame: bodies times intervals.
    pub fields: u32,
    /// Frames every reader's queue can hold: the pre-trigger ring.
    pub ring_frames: usize,
    /// Frames the recorder may hold on top while it writes.
    pub held_frames: usize,
    /// Most subsets a field may have.
    pub field_points: usize,
}

impl Limits {
    /// Slots a camera may hold at once.
    pub const CAMERA_SLOTS: usize = 64;
    /// Readers of the frames beside workers and recorder.
    pub const SPARE_READERS: usize = 4;

    /// Frames that exist in shared memory at once.
    pub fn frame_chunks(&self) -> usize {
        self.ring_frames + self.held_frames + 4 * self.workers as usize + Self::CAMERA_SLOTS + 32
    }

    /// Entries a reader's queue of field messages can hold.
    pub fn field_depth(&self) -> usize {
        (self.ring_frames + self.held_frames) * self.fields as usize + 64
    }

    /// Entries a reader's queue of small messages can hold.
    pub const fn small_depth() -> usize {
        4096
    }
}
