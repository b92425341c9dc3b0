//! Prepared frames that are not in use, kept for reuse of their memory.

use crate::dic::PreparedFrame;

/// A store of prepared frames, for reuse of their memory.
///
/// It is bounded. A block in which a ball is lost has many frames in use, and their memory is freed after it. The largest
/// are kept, so that the memory is the same after such a block as before it.
#[derive(Debug, Default)]
pub(super) struct SpareFrames {
    frames: Vec<PreparedFrame>,
}

impl SpareFrames {
    /// The number of frames that are kept: as many as are in use at a time between blocks and while one begins.
    pub(super) const MAX_FRAMES: usize = 4;

    /// Returns a frame with unspecified content, with the memory of an earlier one if there is any.
    pub(super) fn take(&mut self) -> PreparedFrame {
        self.frames.pop().unwrap_or_default()
    }

    /// Keeps the memory of a frame. If there are too many, the smallest one is freed.
    pub(super) fn put(&mut self, frame: PreparedFrame) {
        if frame.reserved_px() > 0 {
            self.frames.push(frame);
        }
        if self.frames.len() > Self::MAX_FRAMES {
            self.frames.sort_by_key(|frame| std::cmp::Reverse(frame.reserved_px()));
            self.frames.pop();
        }
    }
}
