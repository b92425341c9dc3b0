//! Motion from outlines alone: the displacement of a ball's centre, without its rotation.
//!
//! It serves plain balls, on which no texture shows the rotation, and pairs of frames in which no texture was matched. The
//! differences of successive outlines add up to the last outline, so their errors do not accumulate.

use super::consistency;
use super::measurer::Measurer;
use super::outline::Outline;
use super::pending_frame::{BodyKey, FoundOutline, Measured, PendingFrame};
use super::surface::Surface;
use crate::image::Frame;
use crate::results::{BodyStep, Circle, MotionMethod, OutlineOrigin, PointStatus, RigidStep};

/// The maximum difference between two radii of one ball, sigmas.
const SAME_RADIUS_SIGMAS: f64 = 8.0;
/// The difference between two radii that is always allowed, as a fraction of the radius.
const SAME_RADIUS_FRACTION: f64 = 0.03;

impl Measurer {
    /// Returns the reason why only the outlines of a ball are measured: it has no texture, or one that repeats. `None` if
    /// its texture is measured.
    pub(super) fn outlines_only(&mut self, key: BodyKey) -> Option<PointStatus> {
        self.states.state_mut(key).surface.and_then(Surface::rotation_status)
    }

    /// Measures the motion of balls and patches to the current frame by their outlines, where no texture was matched.
    ///
    /// Only steps over the shortest interval are measured so.
    pub(super) fn complete_by_outlines(&mut self, frame: &Frame<'_>) {
        let (sequence, intervals) = (frame.meta.sequence, self.params.intervals_frames.len());
        let due = sequence.checked_sub(u64::from(self.params.intervals_frames[0]));
        let mut pending = std::mem::take(&mut self.pending);
        let newest = pending
            .back()
            .filter(|newest| newest.meta.sequence == sequence)
            .map(|newest| (newest.block, newest.outlines.clone()));
        for reference in pending.iter_mut().filter(|reference| Some(reference.meta.sequence) == due) {
            for body in 0..self.finders.len() {
                let is_missing = |measured: &Measured| measured.step.motion.is_none();
                let slot = body * intervals;
                if !reference.done[slot].as_ref().is_some_and(is_missing) {
                    continue;
                }
                let target = match &newest {
                    Some((block, outlines)) if *block == reference.block => outlines[body],
                    // The frame belongs to the next block, which searches it on its own.
                    _ if is_measurable(reference, body) => self.find_outline(body, frame, reference.block),
                    _ => continue,
                };
                self.move_by_outlines(reference, body, target);
            }
        }
        self.pending = pending;
    }

    /// Measures the motion of one ball by its outlines in a reference and in its target, or of one patch by its poses.
    pub(super) fn move_by_outlines(&mut self, reference: &mut PendingFrame, body: usize, found: FoundOutline) {
        let FoundOutline { outline: target, origin } = found;
        let key = BodyKey { body, block: reference.block };
        let (outlines_only, slot) = (self.outlines_only(key), body * self.params.intervals_frames.len());
        let frames = f64::from(self.params.intervals_frames[0]);
        if let (Some(measured), Ok(Outline::Patch(from)), Ok(Outline::Patch(to))) =
            (&mut reference.done[slot], reference.outlines[body].outline, target)
        {
            // The patch was found again in the whole frame.
            let motion = from.step_to(&to, frames);
            let (status, method) = (PointStatus::Valid, MotionMethod::WholeBody);
            measured.step = BodyStep { motion: Some(motion), method, status, ..measured.step };
            let state = self.states.state_mut(key);
            (state.motion, state.center_motion) = (Some(motion), Some(motion));
            return;
        }
        let (Some(measured), Ok(Outline::Ball(from))) = (&mut reference.done[slot], reference.outlines[body].outline)
        else {
            return;
        };
        let is_detected =
            reference.outlines[body].origin == OutlineOrigin::Detected && origin == OutlineOrigin::Detected;
        if let (Ok(Outline::Ball(to)), true) = (target, is_detected && measured.step.status != PointStatus::Ambiguous)
            && has_same_radius(&from, &to)
        {
            let motion = step_between(&from, &to, frames);
            let size = self.size;
            let failure = || {
                let field = measured.field.as_ref();
                field.map_or(PointStatus::LowContrast, |field| consistency::failure_status(&measured.step, field, size))
            };
            let rotation_status = outlines_only.unwrap_or_else(failure);
            measured.step = BodyStep {
                motion: Some(motion),
                method: MotionMethod::Outlines,
                rotation_status,
                light_fraction: measured.step.light_fraction,
                status: PointStatus::Valid,
                ..measured.step.without_motion()
            };
            let state = self.states.state_mut(key);
            (state.motion, state.center_motion) = (Some(motion), Some(motion));
        }
    }
}

/// Whether the outline of a ball or the pose of a patch was found in a reference.
fn is_measurable(reference: &PendingFrame, body: usize) -> bool {
    matches!(reference.outlines[body].outline, Ok(Outline::Ball(_) | Outline::Patch(_)))
        && reference.outlines[body].origin == OutlineOrigin::Detected
}

/// Whether two circles can be the outline of one ball.
fn has_same_radius(from: &Circle, to: &Circle) -> bool {
    let sigma_px = from.sigma_radius_px.hypot(to.sigma_radius_px);
    let tolerance_px = (SAME_RADIUS_SIGMAS * sigma_px).max(SAME_RADIUS_FRACTION * from.radius_px);
    (from.radius_px - to.radius_px).abs() <= tolerance_px
}

/// Returns the motion per frame from one circle to another. Its rotation is unknown.
fn step_between(from: &Circle, to: &Circle, frames: f64) -> RigidStep {
    let sigma_px = from.sigma_center_px.hypot(to.sigma_center_px) / frames;
    RigidStep {
        dx_px: (to.x_px - from.x_px) / frames,
        dy_px: (to.y_px - from.y_px) / frames,
        dtheta_deg: 0.0,
        sigma_dx_px: sigma_px,
        sigma_dy_px: sigma_px,
        sigma_dtheta_deg: RigidStep::ANY_ROTATION_DEG,
        points: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(x_px: f64, radius_px: f64) -> Circle {
        Circle { x_px, y_px: 80.0, radius_px, sigma_center_px: 0.03, sigma_radius_px: 0.02, visible_fraction: 1.0 }
    }

    #[test]
    fn outlines_give_the_motion_of_the_centre_and_no_rotation() {
        let step = step_between(&circle(100.0, 40.0), &circle(106.0, 40.1), 3.0);
        assert!((step.dx_px - 2.0).abs() < 1e-12 && step.dy_px.abs() < 1e-12 && !step.has_rotation());
        assert!((step.sigma_dx_px - 0.03 * 2.0_f64.sqrt() / 3.0).abs() < 1e-12);
    }

    #[test]
    fn outlines_of_another_size_are_not_the_same_ball() {
        assert!(has_same_radius(&circle(100.0, 40.0), &circle(101.0, 40.9)));
        assert!(!has_same_radius(&circle(100.0, 40.0), &circle(101.0, 42.0)));
    }
}
