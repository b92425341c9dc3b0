//! Match of the texture of one body in a pair of frames: its subsets, and the body as a whole.

use super::body_motion::{
    fit_center_step, fit_rigid_step, predicted_start, search_motion, set_drift, write_dilatation,
};
use super::consistency;
use super::measurer::Measurer;
use super::outline::{Finder, Outline};
use super::patch_finder::FrameKey;
use super::pending_frame::{FramePair, Interval, Measured, Span, Target};
use super::rigid_match::RigidMatch;
use crate::dic::Start;
use crate::motion::Rotation;
use crate::results::{BodyStep, Estimate, PairField, RigidStep};

impl Measurer {
    /// Correlates the subsets of a body and matches it as a whole, from a motion per frame that is `known`.
    ///
    /// Completes the `step` that holds its outline. Returns `None` if more of the target has to be prepared first.
    pub(super) fn match_textures(
        &mut self,
        span: Span<'_>,
        outline: &Outline,
        mut step: BodyStep,
        known: Option<RigidStep>,
    ) -> Option<Measured> {
        let Span { body, reference, target } = span;
        if target.is_narrow && known.is_none() {
            return None;
        }
        let points = self.finders[body].grid_points(outline, &self.params.correlation, self.size);
        self.correlator.set_region(self.finders[body].correlated_region(outline, &self.params.correlation));
        let mut rigid = known
            .or_else(|| search_motion(&mut self.correlator, &self.params, reference, &target, outline, &points))
            .and_then(|rate| self.match_whole_body(span, outline, &rate));
        let known = rigid.map(|rigid| rigid.step).or(known);
        let frames = f64::from(step.interval_frames);
        let start = known.map_or(Start::Search, |step| predicted_start(&step, outline, frames));
        let BodyStep { frame, stamp_ns, body: row_body, .. } = step;
        let mut field =
            PairField { frame, target_frame: target.sequence, stamp_ns, body: row_body, points: Vec::new() };
        self.correlator.correlate(&reference.prepared, target.prepared, &points, start, &mut field.points);
        if target.is_narrow && (rigid.is_none() || self.correlator.has_searched()) {
            return None;
        }
        self.mask_occluded(span, &mut field);
        let mut ball_motion = self.fit_subsets(span, outline, &mut field, &mut step, start);
        if let (None, Some(rate)) = (rigid, step.motion) {
            rigid = self.match_whole_body(span, outline, &rate);
            // The match shows what occludes the body.
            if self.mask_occluded(span, &mut field) {
                ball_motion = self.fit_subsets(span, outline, &mut field, &mut step, start);
            }
        }
        // Light that keeps the body from being matched holds the rotations before it back as well.
        step.light_fraction = self.rigid_matcher.rotation_error(span.key());
        let rigid = self.confirm_match(span, outline, &mut step, rigid);
        set_drift(&mut step, ball_motion);
        step.status = consistency::matched_status(&step, &field, self.size);
        Some(Measured { step, field: Some(field), is_matched: rigid.is_some() })
    }

    /// Discards a match of the whole body that contradicts its subsets, and writes another one into the step where it
    /// is reported.
    fn confirm_match(
        &mut self,
        span: Span<'_>,
        outline: &Outline,
        step: &mut BodyStep,
        rigid: Option<RigidMatch>,
    ) -> Option<RigidMatch> {
        let mut rigid = rigid;
        if let Outline::Patch(_) = outline {
            // Subsets follow whatever occludes the patch. If they led astray, the patch itself may not have moved.
            rigid = rigid.or_else(|| self.match_whole_body(span, outline, &RigidStep::STILL));
            step.motion = None;
        }
        let rigid = rigid.filter(|rigid| {
            let agrees =
                step.motion.is_none_or(|field| consistency::agrees_with_subsets(&rigid.step, &field, step.drift));
            // A pattern that moves over the body soon differs from that of its reference.
            if !agrees || step.drifts() {
                self.rigid_matcher.forget(span.key());
            }
            agrees
        });
        let is_reported = self.params.rotation == Rotation::Rigid || matches!(outline, Outline::Patch(_));
        if let Some(rigid) = rigid.as_ref().filter(|_| is_reported && !step.drifts()) {
            rigid.write_to(step);
        }
        rigid
    }

    /// Marks the subsets that show an occluder, according to the match of the whole body; returns whether any does.
    fn mask_occluded(&self, span: Span<'_>, field: &mut PairField) -> bool {
        let subset_px = self.params.correlation.subset_size_px;
        let frames = Interval { from: span.reference.meta.sequence, to: span.target.sequence };
        self.rigid_matcher.mask_occluded(span.key(), frames, &mut field.points, subset_px)
    }

    /// Fits the step to the subsets and writes its dilatation and drift.
    ///
    /// Returns the motion of the centre, px, and the rotation, deg, per frame, of a ball that rotates about any axis.
    fn fit_subsets(
        &mut self,
        span: Span<'_>,
        outline: &Outline,
        field: &mut PairField,
        step: &mut BodyStep,
        start: Start,
    ) -> Option<[Estimate; 3]> {
        let (frames, correlation) = (f64::from(step.interval_frames), &self.params.correlation);
        step.motion = fit_rigid_step(field, outline, frames, correlation.subset_size_px, start);
        let ball_motion = write_dilatation(field, step, outline, correlation.subset_size_px);
        let circle = step.circle();
        if let (Rotation::Center, Some(_)) = (self.params.rotation, &circle) {
            step.motion = step.motion.and_then(|_| fit_center_step(field, outline, frames, correlation));
        }
        if let (Rotation::Ring(limits), Some(found), Some(circle)) = (self.params.rotation, &mut step.motion, &circle) {
            let pair = FramePair { reference: &span.reference.prepared, target: span.target.prepared };
            self.ring_rotation.replace_rotation(found, circle, pair, limits, frames);
        }
        set_drift(step, ball_motion);
        ball_motion
    }

    /// Matches the whole body near a motion per frame; `None` if it has no reference or does not match.
    fn match_whole_body(&mut self, span: Span<'_>, outline: &Outline, rate: &RigidStep) -> Option<RigidMatch> {
        let Span { body, reference, target } = span;
        let frames = (target.sequence - reference.meta.sequence) as f64;
        match (outline, &mut self.finders[body]) {
            (Outline::Ball(circle), _) => {
                let (sequence, prepared) = (reference.meta.sequence, &reference.prepared);
                let from = Target { sequence, prepared, is_narrow: false };
                self.rigid_matcher.measure_step(span.key(), from, target, circle, rate)
            }
            (Outline::Patch(pose), Finder::Patch(finder)) => {
                let near = pose.predicted(rate, frames);
                let found = finder
                    .follow(FrameKey { block: reference.block, frame: target.sequence }, target.prepared, &near)
                    .ok()?;
                Some(RigidMatch {
                    step: pose.step_to(&found, frames),
                    visible_fraction: None,
                    lever: None,
                    light_fraction: None,
                    pull_px: None,
                })
            }
            _ => None,
        }
    }
}
