//! What the sensor's own pattern takes from short steps, looked for within blocks.

use super::outline::Outline;
use super::params::MeasureParams;
use super::reference::Reference;
use crate::dic::FixedPattern;

/// A body has moved when it is so far from where it was, px; one that has not looks like a pattern itself.
const MOVED_PX: f64 = 0.3;
/// Frames of a block that are looked at beside its first.
const LOOKS: u64 = 4;

/// The first frame of a block in which one of the bodies was measured.
#[derive(Debug)]
struct First {
    body: usize,
    block: u64,
    frame: u64,
    center_px: (f64, f64),
    pattern: FixedPattern,
}

/// The sensor's pattern, as the bodies of the blocks at hand show it.
#[derive(Debug)]
pub(super) struct Patterns {
    /// From one frame that is looked at to the next.
    every_frames: u64,
    firsts: Vec<First>,
    spare: Vec<FixedPattern>,
}

impl Patterns {
    pub(super) fn new(params: &MeasureParams) -> Self {
        let every_frames = (u64::from(params.block_frames) / LOOKS).max(1);
        Self { every_frames, firsts: Vec::new(), spare: Vec::new() }
    }

    /// By which share short steps come out short, as a frame of the block and its first together show it; `None` in most.
    pub(super) fn share(&mut self, (body, reference): (usize, &Reference), outline: &Outline) -> Option<f64> {
        let (block, frame, center_px) = (reference.block, reference.meta.sequence, outline.center_px());
        let Some(first) = self.firsts.iter_mut().find(|first| (first.body, first.block) == (body, block)) else {
            let mut pattern = self.spare.pop().unwrap_or_default();
            pattern.begin(&reference.prepared, &outline.inside());
            self.firsts.push(First { body, block, frame, center_px, pattern });
            return None;
        };
        let since = frame - first.frame;
        let is_due = since > 0 && since.is_multiple_of(self.every_frames);
        let moved_px = (center_px.0 - first.center_px.0).hypot(center_px.1 - first.center_px.1);
        if !is_due || moved_px < MOVED_PX {
            return None;
        }
        first.pattern.share(&reference.prepared, &outline.inside())
    }

    /// Forgets the blocks before this one.
    pub(super) fn forget_before(&mut self, block: u64) {
        self.spare.extend(self.firsts.extract_if(.., |first| first.block < block).map(|first| first.pattern));
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.forget_before(u64::MAX);
    }
}
