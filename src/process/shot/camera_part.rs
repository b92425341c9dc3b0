//! One camera's part of a recording.

use super::FrameRange;
use crate::results::{BodyStep, PairField, PointStatus};
use crate::synth::SimulatedFilm;
use crate::track::OrderedTracker;
use crate::track::TrackerParams;
use std::rc::Rc;

/// The frames and steps of one camera so far.
pub(super) struct CameraPart {
    /// `None` if nothing is measured of this camera.
    pub(super) ordered: Option<OrderedTracker>,
    /// The interval whose displacements are drawn, frames.
    pub(super) shortest_frames: u32,
    pub(super) range: FrameRange,
    pub(super) truth: Option<Rc<SimulatedFilm>>,
    pub(super) next_frame: u64,
    /// Number of frames missing between the first and the newest.
    pub(super) lost: u64,
    /// Number of frames.
    pub(super) frames: u64,
}

impl CameraPart {
    pub(super) fn new(params: Option<&TrackerParams>, range: FrameRange) -> Self {
        let ordered = |params| OrderedTracker::new(params, range.first, range.max_delay_frames);
        Self {
            ordered: params.map(ordered),
            shortest_frames: params.and_then(|params| params.intervals_frames().next()).unwrap_or(1),
            range,
            truth: None,
            next_frame: range.first,
            lost: 0,
            frames: 0,
        }
    }

    /// Counts the next frame.
    pub(super) fn count(&mut self, sequence: u64) {
        self.lost += sequence.saturating_sub(self.next_frame);
        self.next_frame = sequence + 1;
        self.frames += 1;
    }

    /// Returns the part of a step that belongs to this recording, if any.
    pub(super) fn within(&self, step: BodyStep, field: Option<PairField>) -> Option<(BodyStep, Option<PairField>)> {
        let target = step.frame + u64::from(step.interval_frames);
        if step.frame < self.range.first || self.range.last.is_some_and(|last| step.frame > last) {
            return None;
        }
        if self.range.last.is_some_and(|last| target > last) {
            // The recording does not contain the target frame of this motion.
            return Some((cut_off(step), None));
        }
        Some((step, field))
    }

    pub(super) fn has_steps_before(&self, end: u64) -> bool {
        self.ordered.as_ref().is_none_or(|ordered| ordered.has_all_before(end))
    }
}

/// Removes the motion of a step, as for the last frames of a recording.
fn cut_off(step: BodyStep) -> BodyStep {
    let is_seen = step.outline.is_some();
    let status = if is_seen { PointStatus::Valid } else { step.status };
    BodyStep { status, ..step.without_motion() }
}
