//! One camera's part of a recording.

use super::Extent;
use crate::results::{BodyStep, PairField, PointStatus};
use crate::synth::World;
use crate::track::OrderedTracker;
use crate::track::TrackerParams;
use std::rc::Rc;

/// What is known of one camera's frames and steps so far.
pub(super) struct Take {
    /// `None` when nothing is measured of this camera.
    pub(super) ordered: Option<OrderedTracker>,
    /// The interval whose displacements are drawn, frames.
    pub(super) shortest_frames: u32,
    pub(super) extent: Extent,
    pub(super) truth: Option<Rc<World>>,
    pub(super) next_frame: u64,
    /// Frames that are missing between the first and the newest.
    pub(super) lost: u64,
    /// Frames that came.
    pub(super) frames: u64,
}

impl Take {
    pub(super) fn new(params: Option<&TrackerParams>, extent: Extent) -> Self {
        let ordered = |params| OrderedTracker::new(params, extent.first, extent.patience_frames);
        Self {
            ordered: params.map(ordered),
            shortest_frames: params.and_then(|params| params.intervals_frames().next()).unwrap_or(1),
            extent,
            truth: None,
            next_frame: extent.first,
            lost: 0,
            frames: 0,
        }
    }

    /// Takes note of the next frame.
    pub(super) fn count(&mut self, sequence: u64) {
        self.lost += sequence.saturating_sub(self.next_frame);
        self.next_frame = sequence + 1;
        self.frames += 1;
    }

    /// The step as far as it belongs to this recording; `None` when it does not at all.
    pub(super) fn within(&self, step: BodyStep, field: Option<PairField>) -> Option<(BodyStep, Option<PairField>)> {
        let target = step.frame + u64::from(step.interval_frames);
        if step.frame < self.extent.first || self.extent.last.is_some_and(|last| step.frame > last) {
            return None;
        }
        if self.extent.last.is_some_and(|last| target > last) {
            // The recording does not hold the frame this motion leads to.
            return Some((cut_off(step), None));
        }
        Some((step, field))
    }

    pub(super) fn has_steps_before(&self, end: u64) -> bool {
        self.ordered.as_ref().is_none_or(|ordered| ordered.has_all_before(end))
    }
}

/// The same body in the same frame, its motion unknown: what is measured of the last frames of a recording.
fn cut_off(step: BodyStep) -> BodyStep {
    let is_seen = step.circle.is_some() || step.rod.is_some();
    let status = if is_seen { PointStatus::Valid } else { step.status };
    BodyStep { status, ..step.without_motion() }
}
