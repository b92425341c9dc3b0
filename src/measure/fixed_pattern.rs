//! The bias of short steps by the fixed pattern of the sensor, estimated within blocks.

use super::outline::Outline;
use super::params::MeasureParams;
use super::pending_frame::{BodyKey, PendingFrame};
use crate::dic::FixedPattern;

/// The minimum shift of a body, px; an unmoved body looks like a fixed pattern itself.
const MIN_SHIFT_PX: f64 = 0.3;
/// The number of frames per block that are compared with its first.
const SAMPLES_PER_BLOCK: u64 = 4;

/// The first frame of a block in which a body was measured.
#[derive(Debug)]
struct FirstFrame {
    key: BodyKey,
    frame: u64,
    center_px: (f64, f64),
    pattern: FixedPattern,
}

/// The fixed patterns of the current blocks, estimated at the bodies.
#[derive(Debug)]
pub(super) struct FixedPatterns {
    /// The distance from one compared frame to the next.
    every_frames: u64,
    firsts: Vec<FirstFrame>,
    spare: Vec<FixedPattern>,
}

impl FixedPatterns {
    pub(super) fn new(params: &MeasureParams) -> Self {
        let every_frames = (u64::from(params.block_frames) / SAMPLES_PER_BLOCK).max(1);
        Self { every_frames, firsts: Vec::new(), spare: Vec::new() }
    }

    /// Estimates the fraction by which short steps are too short, from a frame and the first of its block.
    ///
    /// Most frames are not compared and give `None`.
    pub(super) fn bias_fraction(&mut self, body: usize, reference: &PendingFrame, outline: &Outline) -> Option<f64> {
        let key = BodyKey { body, block: reference.block };
        let (frame, center_px) = (reference.meta.sequence, outline.center_px());
        let Some(first) = self.firsts.iter_mut().find(|first| first.key == key) else {
            let mut pattern = self.spare.pop().unwrap_or_default();
            pattern.begin(&reference.prepared, &outline.interior_rectangles());
            self.firsts.push(FirstFrame { key, frame, center_px, pattern });
            return None;
        };
        let since = frame - first.frame;
        let is_due = since > 0 && since.is_multiple_of(self.every_frames);
        let moved_px = (center_px.0 - first.center_px.0).hypot(center_px.1 - first.center_px.1);
        if !is_due || moved_px < MIN_SHIFT_PX {
            return None;
        }
        first.pattern.bias_fraction(&reference.prepared, &outline.interior_rectangles())
    }

    /// Discards the blocks before this one.
    pub(super) fn forget_before(&mut self, block: u64) {
        self.spare.extend(self.firsts.extract_if(.., |first| first.key.block < block).map(|first| first.pattern));
    }

    /// Discards everything.
    pub(super) fn clear(&mut self) {
        self.forget_before(u64::MAX);
    }
}
