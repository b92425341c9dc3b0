//! The sizes of queues and pools in shared memory.

/// The sizes that all processes of a rig agree on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// The number of correlation workers.
    pub workers: u32,
    /// The number of fields per frame: bodies times intervals.
    pub fields: u32,
    /// The number of frames that the queue of each reader can hold: the pre-trigger ring.
    pub ring_frames: usize,
    /// The number of further frames that the recorder may hold while it writes.
    pub held_frames: usize,
    /// The maximum number of subsets of a field.
    pub field_points: usize,
}

impl Limits {
    /// The maximum number of slots that a camera holds at once.
    pub const CAMERA_SLOTS: usize = 64;
    /// The maximum number of readers of the frames besides workers and recorder.
    pub const SPARE_READERS: usize = 4;

    /// Returns the number of frames in shared memory: the ring, the frames that readers and the camera hold, and a
    /// reserve.
    pub fn frame_chunks(&self) -> usize {
        self.ring_frames + self.held_frames + 4 * self.workers as usize + Self::CAMERA_SLOTS + 32
    }

    /// Returns the size of all [`frame_chunks`](Self::frame_chunks) with their headers, bytes, for slots of this size.
    pub fn ring_bytes(&self, slot_bytes: usize) -> u64 {
        // The headers of the library and ours.
        (self.frame_chunks() * (slot_bytes + 192)) as u64
    }

    /// Returns the number of field messages that the queue of a reader can hold.
    pub fn field_depth(&self) -> usize {
        (self.ring_frames + self.held_frames) * self.fields as usize + 64
    }

    /// Returns the number of small messages that the queue of a reader can hold.
    pub const fn small_depth() -> usize {
        4096
    }
}
