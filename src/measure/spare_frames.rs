//! Prepared frames that are not in use, kept for reuse of their memory.

use crate::dic::PreparedFrame;

/// A store of prepared frames, for reuse of their memory.
///
/// It is bounded. A block in which a ball is lost has many frames in use, and their memory is freed after it.
#[derive(Debug, Default)]
pub(super) struct SpareFrames {
    frames: Vec<PreparedFrame>,
}

impl SpareFrames {
    /// The number of frames that are kept: one for the next frame, and one since each block begins with a frame that waits
    /// for its successor, or for a search in a whole frame.
    pub(super) const MAX_FRAMES: usize = 2;

    /// Returns a frame with unspecified content, with the memory of an earlier one if there is any.
    pub(super) fn take(&mut self) -> PreparedFrame {
        self.frames.pop().unwrap_or_default()
    }

    /// Keeps the memory of a frame, or frees it if enough frames are kept.
    pub(super) fn put(&mut self, frame: PreparedFrame) {
        let has_memory = frame.width() > 0;
        if has_memory && self.frames.len() < Self::MAX_FRAMES {
            self.frames.push(frame);
        }
    }
}
