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
    /// Ground truth of a simulated camera.
    pub(super) truth: Option<Rc<SimulatedFilm>>,
    /// One past the newest frame.
    pub(super) next_frame: u64,
    /// Number of frames missing between the first and the newest.
    pub(super) lost: u64,
    /// Number of frames.
    pub(super) frames: u64,
}

impl CameraPart {
    /// Begins the part, with a tracker if anything is measured.
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

    /// Counts a frame, and the frames missing between it and the previous one as lost.
    pub(super) fn count(&mut self, sequence: u64) {
        self.lost += sequence.saturating_sub(self.next_frame);
        self.next_frame = sequence + 1;
        self.frames += 1;
    }

    /// Returns a step and its field as far as they belong to this recording: without the motion if it leads out of it,
    /// `None` if the step's frame is outside.
    pub(super) fn clip(&self, step: BodyStep, field: Option<PairField>) -> Option<(BodyStep, Option<PairField>)> {
        let target = step.frame + u64::from(step.interval_frames);
        if step.frame < self.range.first || self.range.last.is_some_and(|last| step.frame > last) {
            return None;
        }
        if self.range.last.is_some_and(|last| target > last) {
            // The recording does not contain the target frame of this motion.
            return Some((without_motion(step), None));
        }
        Some((step, field))
    }

    /// Whether the steps of every frame before `end` have come, or nothing is measured.
    pub(super) fn has_steps_before(&self, end: u64) -> bool {
        self.ordered.as_ref().is_none_or(|ordered| ordered.has_all_before(end))
    }
}

/// Returns a step without its motion, as it would be measured in the last frames of a recording: valid if the body was
/// detected.
fn without_motion(step: BodyStep) -> BodyStep {
    let is_seen = step.outline.is_some();
    let status = if is_seen { PointStatus::Valid } else { step.status };
    BodyStep { status, ..step.without_motion() }
}
