//! The reconciliation of motions with the outlines of their bodies, as soon as both frames are known.

use super::consistency::{self, Course, OutlinePair};
use super::measurer::Measurer;
use super::outline::Outline;
use super::pending_frame::{BodyKey, FramePair, Measured, PendingFrame, Target};
use super::ring_rotation::RingTurn;
use super::surface::Surface;
use crate::results::{PointStatus, RigidStep};

/// The number of contradictions in a row after which a body is no longer followed.
const MAX_DOUBTS: u32 = 2;
/// The number of frames for which the rotation of a ball needs no comparison with its ring after one that agreed.
const ROTATION_CHECK_FRAMES: u64 = 16;

impl Measurer {
    /// Compares the motions to the newest frame with the outlines found there; withdraws inconsistent motions.
    pub(super) fn check_consistency(&mut self) {
        let Some(target) = self.pending.pop_back() else { return };
        let intervals = self.params.intervals_frames.len();
        let mut pending = std::mem::take(&mut self.pending);
        for reference in pending.iter_mut().filter(|reference| reference.block == target.block) {
            self.retry_with_ring(reference, &target);
            self.check_rotation(reference, &target);
            let frames = target.meta.sequence - reference.meta.sequence;
            for slot in 0..reference.done.len() {
                let (body, interval_index) = (slot / intervals, slot % intervals);
                let is_detected = reference.is_comparable(&target, body);
                let Some(measured) =
                    reference.done[slot].as_mut().filter(|_| self.params.is_interval(interval_index, frames))
                else {
                    continue;
                };
                let outlines = OutlinePair {
                    reference: &reference.outlines[body].outline,
                    target: &target.outlines[body].outline,
                    are_detected: is_detected,
                };
                if consistency::is_consistent(measured, reference.before[slot].as_ref(), outlines) {
                    let state = self.states.state_mut(BodyKey { body, block: target.block });
                    if interval_index == 0 && is_detected && measured.step.motion.is_some() {
                        state.doubts = 0;
                    }
                    // After a contradiction, only outlines make a motion credible again.
                    if state.doubts == 0 || measured.step.motion.is_none() {
                        continue;
                    }
                    measured.withdraw_motion(PointStatus::Ambiguous);
                    continue;
                }
                measured.withdraw_motion(PointStatus::Ambiguous);
                if interval_index == 0 {
                    self.record_contradiction(BodyKey { body, block: target.block }, target.meta.sequence);
                }
            }
        }
        self.pending = pending;
        self.pending.push_back(target);
    }

    /// Measures balls again that turned too far to be matched, now that they were detected in the newest frame.
    fn retry_with_ring(&mut self, reference: &mut PendingFrame, target: &PendingFrame) {
        let intervals = self.params.intervals_frames.len();
        let frames = target.meta.sequence - reference.meta.sequence;
        for body in 0..self.finders.len() {
            let slot = body * intervals;
            let is_detected = reference.is_comparable(target, body) && self.params.is_interval(0, frames);
            let is_lost = |measured: &Measured| measured.step.motion.is_none() && measured.field.is_some();
            if !is_detected || !reference.done[slot].as_ref().is_some_and(is_lost) {
                continue;
            }
            let (Ok(Outline::Ball(from)), Ok(Outline::Ball(to))) =
                (&reference.outlines[body].outline, &target.outlines[body].outline)
            else {
                continue;
            };
            let pair = FramePair { reference: &reference.prepared, target: &target.prepared };
            let Some(rate) = self.ring_rotation.motion_between(from, to, pair, frames as f64) else { continue };
            let state = self.states.state_mut(BodyKey { body, block: reference.block });
            (state.motion, state.center_motion) = (Some(rate), Some(rate));
            let target = Target { sequence: target.meta.sequence, prepared: &target.prepared, is_narrow: false };
            let retried = self.measure_body(reference, slot, Some(target));
            if retried.as_ref().is_some_and(|retried| retried.step.motion.is_some()) {
                reference.done[slot] = retried;
            }
        }
    }

    /// Compares the rotation of each ball with that of its ring, which is found from any start, until both agree, and
    /// again after [`ROTATION_CHECK_FRAMES`].
    ///
    /// A match that starts too far from the right rotation may settle where light that stays in the room fits best. If
    /// the ring turned otherwise, the pair is measured again from there. If that fails, only the outlines move the ball.
    fn check_rotation(&mut self, reference: &mut PendingFrame, target: &PendingFrame) {
        let frames = target.meta.sequence - reference.meta.sequence;
        if !self.params.is_interval(0, frames) {
            return;
        }
        for body in 0..self.finders.len() {
            let key = BodyKey { body, block: reference.block };
            let is_fresh = |checked: u64| target.meta.sequence < checked + ROTATION_CHECK_FRAMES;
            if self.states.state_mut(key).rotation_checked.is_some_and(is_fresh) {
                continue;
            }
            let Some(turn) = self.ring_turn(reference, target, body) else { continue };
            let is_checked = turn.agrees(&turn.motion) || self.turn_as_ring(reference, target, body, turn);
            self.states.state_mut(key).rotation_checked = is_checked.then_some(target.meta.sequence);
        }
    }

    /// Returns the motion of a ball to the next frame, with rotation, and the rotation of its ring.
    fn ring_turn(&mut self, reference: &PendingFrame, target: &PendingFrame, body: usize) -> Option<RingTurn> {
        let measured = reference.done[body * self.params.intervals_frames.len()].as_ref()?;
        let motion = measured.step.motion.filter(RigidStep::has_rotation)?;
        let (Ok(Outline::Ball(from)), Ok(Outline::Ball(to))) =
            (&reference.outlines[body].outline, &target.outlines[body].outline)
        else {
            return None;
        };
        let pair = FramePair { reference: &reference.prepared, target: &target.prepared };
        let ring_deg = self.ring_rotation.coarse_rotation_deg(from, to, pair)?;
        let frames = (target.meta.sequence - reference.meta.sequence) as f64;
        Some(RingTurn { motion, ring_deg, frames })
    }

    /// Measures the motion of a ball again from the rotation of its ring. Returns whether it then turns as the ring.
    ///
    /// Otherwise the motion is withdrawn.
    fn turn_as_ring(
        &mut self,
        reference: &mut PendingFrame,
        target: &PendingFrame,
        body: usize,
        turn: RingTurn,
    ) -> bool {
        let slot = body * self.params.intervals_frames.len();
        let key = BodyKey { body, block: reference.block };
        let start = turn.motion_of_ring();
        self.rigid_matcher.forget_frame(key, target.meta.sequence);
        let state = self.states.state_mut(key);
        (state.motion, state.center_motion) = (Some(start), Some(start));
        let target = Target { sequence: target.meta.sequence, prepared: &target.prepared, is_narrow: false };
        let retried = self.measure_body(reference, slot, Some(target));
        let moved = retried.as_ref().and_then(|retried| retried.step.motion);
        if moved.is_some_and(|motion| turn.agrees(&motion)) {
            reference.done[slot] = retried;
            return true;
        }
        if let Some(measured) = &mut reference.done[slot] {
            measured.withdraw_motion(PointStatus::LowCorrelation);
        }
        self.states.state_mut(key).motion = None;
        self.rigid_matcher.forget(key);
        false
    }

    /// Discards the motion of a body after a contradiction to its outlines.
    ///
    /// Another object may be taken for it, and one contradiction may be chance. After the second one, a ball whose
    /// outlines moved evenly is followed by these alone, and any other body no longer, until it is searched again.
    fn record_contradiction(&mut self, key: BodyKey, frame: u64) {
        self.rigid_matcher.forget(key);
        let state = self.states.state_mut(key);
        state.doubts += 1;
        state.contradicted = Some(frame);
        state.motion = None;
        let moved = state.outline_motion;
        let course = moved.zip(state.doubted_motion).map(|(moved, before)| moved.course_since(&before));
        match (moved, course) {
            _ if state.doubts < MAX_DOUBTS => {}
            (_, Some(Course::Even)) => (state.surface, state.doubts) = (Some(Surface::Misleading), 0),
            // The next frame shows more.
            (_, Some(Course::Open)) | (Some(_), None) => {}
            _ => state.is_ambiguous = true,
        }
        state.doubted_motion = moved;
    }
}
