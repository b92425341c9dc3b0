//! Consistency of a measured motion with the outlines of its body, and the reason for a missing motion.

use super::outline::Outline;
use super::params::ImageSize;
use super::pending_frame::Measured;
use crate::results::{BodyStep, Circle, Estimate, PairField, PointStatus, RigidStep};

/// The minimum tolerance between the motion of the subsets and that of the outlines, px.
const OUTLINE_TOLERANCE_PX: f64 = 0.5;

/// The tolerance in standard uncertainties.
const TOLERANCE_SIGMAS: f64 = 8.0;

/// The maximum change of a motion that nothing else confirms, px/frame.
const MAX_MOTION_CHANGE_PX: f64 = 1.0;

/// The minimum tolerance between the step of the whole body and that of its subsets: px, px and deg.
///
/// If they differ by more, and by more than eight standard uncertainties, one of them follows another object.
const SUBSET_TOLERANCE: [f64; 3] = [0.05, 0.05, 0.1];

/// The maximum difference between whole body and subsets, as a fraction of the out-of-plane drift of the subsets.
const DRIFT_TOLERANCE: f64 = 0.3;

/// The outlines of a body in a reference and its target.
#[derive(Debug, Clone, Copy)]
pub(super) struct OutlinePair<'a> {
    pub(super) reference: &'a Result<Outline, PointStatus>,
    pub(super) target: &'a Result<Outline, PointStatus>,
    /// Whether both were detected, so that they can be compared.
    pub(super) are_detected: bool,
}

/// An outline of a ball that was detected in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DetectedBall {
    pub(super) frame: u64,
    pub(super) circle: Circle,
}

/// The motion of the outline of a ball from the first frame of its block to another, px per frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OutlineMotion {
    /// The sequence number of the other frame.
    to_frame: u64,
    dx_px: f64,
    dy_px: f64,
    sigma_px: f64,
}

/// The way in which the outline of a ball has moved on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Course {
    /// The same as before.
    Even,
    /// Another than before, as where another object was taken for the ball.
    Uneven,
    /// Unknown: it has not moved far enough. A circle that stays in its place may belong to the scene.
    Open,
}

impl OutlineMotion {
    /// Returns the motion between two frames; `None` unless the second is later.
    pub(super) fn between(from: &DetectedBall, to: &DetectedBall) -> Option<Self> {
        let frames = to.frame.checked_sub(from.frame).filter(|frames| *frames > 0)? as f64;
        Some(Self {
            to_frame: to.frame,
            dx_px: (to.circle.x_px - from.circle.x_px) / frames,
            dy_px: (to.circle.y_px - from.circle.y_px) / frames,
            sigma_px: from.circle.sigma_center_px.hypot(to.circle.sigma_center_px) / frames,
        })
    }

    /// Compares the motion with that to an earlier frame.
    pub(super) fn course_since(&self, before: &Self) -> Course {
        let sigma_px = self.sigma_px.hypot(before.sigma_px);
        let change_px = (self.dx_px - before.dx_px).hypot(self.dy_px - before.dy_px);
        let moves = self.dx_px.hypot(self.dy_px) > TOLERANCE_SIGMAS * self.sigma_px;
        match () {
            () if change_px > OUTLINE_TOLERANCE_PX.max(TOLERANCE_SIGMAS * sigma_px) => Course::Uneven,
            () if moves && self.to_frame > before.to_frame => Course::Even,
            () => Course::Open,
        }
    }
}

/// Whether the body found in both frames can have moved this way.
///
/// Subsets follow whatever is in front of most of them. If both outlines of a ball were detected, they must have moved
/// as measured. Otherwise the ball must have been matched as a whole, or continue its motion `before`. Other bodies,
/// and balls without a motion or without both outlines, are consistent.
pub(super) fn is_consistent(
    Measured { step: measured, is_matched, .. }: &Measured,
    before: Option<&RigidStep>,
    outlines: OutlinePair<'_>,
) -> bool {
    let (Ok(Outline::Ball(from)), Ok(Outline::Ball(to)), Some(step)) =
        (outlines.reference, outlines.target, measured.center_motion())
    else {
        return true;
    };
    if outlines.are_detected {
        let frames = f64::from(measured.interval_frames);
        let apart = (to.x_px - from.x_px - frames * step.dx_px).hypot(to.y_px - from.y_px - frames * step.dy_px);
        return apart <= OUTLINE_TOLERANCE_PX.max(TOLERANCE_SIGMAS * from.sigma_center_px.hypot(to.sigma_center_px));
    }
    *is_matched || before.is_some_and(|before| continues_motion(before, &step))
}

/// Whether a motion continues the one before it: their difference is at most 1 px/frame beyond the uncertainty.
fn continues_motion(before: &RigidStep, step: &RigidStep) -> bool {
    let sigma = step.sigma_dx_px.hypot(step.sigma_dy_px).hypot(before.sigma_dx_px.hypot(before.sigma_dy_px));
    (step.dx_px - before.dx_px).hypot(step.dy_px - before.dy_px) <= MAX_MOTION_CHANGE_PX + TOLERANCE_SIGMAS * sigma
}

/// Whether the whole body moved as its subsets did; both motions are per frame.
///
/// The two weight a rotating front differently. They differ by a fraction of its motion relative to the rim, `drift`.
pub(super) fn agrees_with_subsets(rigid: &RigidStep, field: &RigidStep, drift: Option<[Estimate; 3]>) -> bool {
    let drift_px = drift.map_or(0.0, |[x, y, _]| DRIFT_TOLERANCE * x.value.hypot(y.value));
    let tolerances = [SUBSET_TOLERANCE[0] + drift_px, SUBSET_TOLERANCE[1] + drift_px, SUBSET_TOLERANCE[2]];
    let apart = [rigid.dx_px - field.dx_px, rigid.dy_px - field.dy_px, rigid.dtheta_deg - field.dtheta_deg];
    let sigma = [
        rigid.sigma_dx_px.hypot(field.sigma_dx_px),
        rigid.sigma_dy_px.hypot(field.sigma_dy_px),
        rigid.sigma_dtheta_deg.hypot(field.sigma_dtheta_deg),
    ];
    apart.iter().zip(sigma).zip(tolerances).all(|((apart, sigma), tolerance)| apart.abs() <= tolerance.max(8.0 * sigma))
}

/// Returns the status of a step after its subsets were matched: valid with a motion, else the reason why it has none.
///
/// `size` is that of the image.
pub(super) fn matched_status(step: &BodyStep, field: &PairField, size: ImageSize) -> PointStatus {
    match (step.motion, step.status) {
        (Some(_), _) => PointStatus::Valid,
        // The position is no measurement either.
        (None, PointStatus::Predicted) => PointStatus::Predicted,
        (None, _) => failure_status(step, field, size),
    }
}

/// Returns the most frequent reason why subsets of a field have no displacement.
///
/// If no subset fits into the body at all, the body is not in the image as a whole. A ball that is may be too small for them,
/// which is low contrast, and the tapes of a rod that is are none.
pub(super) fn failure_status(step: &BodyStep, field: &PairField, size: ImageSize) -> PointStatus {
    let count = |status: PointStatus| field.points.iter().filter(|point| point.status == status).count();
    let invalid = PointStatus::ALL.into_iter().filter(|status| *status != PointStatus::Valid);
    let most = invalid.max_by_key(|status| count(*status)).filter(|status| count(*status) > 0);
    most.unwrap_or(match (is_inside(step, size), step.circle()) {
        (false, _) => PointStatus::OutOfFrame,
        (true, Some(_)) => PointStatus::LowContrast,
        (true, None) => PointStatus::Lost,
    })
}

/// Whether the outline of a step lies within an image of this size.
fn is_inside(step: &BodyStep, size: ImageSize) -> bool {
    let reach_px = step.circle().map_or(0.0, |circle| circle.radius_px);
    let is_within = |at_px: f64, length: usize| at_px >= reach_px && at_px + reach_px <= length as f64 - 1.0;
    step.center_px().is_some_and(|[x, y]| is_within(x, size.width) && is_within(y, size.height))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_px: f64) -> Result<Outline, PointStatus> {
        Ok(Outline::Ball(Circle {
            x_px,
            y_px: 80.0,
            radius_px: 60.0,
            sigma_center_px: 0.03,
            sigma_radius_px: 0.03,
            visible_fraction: 0.6,
        }))
    }

    fn pair<'a>(
        reference: &'a Result<Outline, PointStatus>,
        target: &'a Result<Outline, PointStatus>,
        are_detected: bool,
    ) -> OutlinePair<'a> {
        OutlinePair { reference, target, are_detected }
    }

    fn step(dx_px: f64) -> RigidStep {
        RigidStep {
            dx_px,
            dy_px: 0.0,
            dtheta_deg: 0.0,
            sigma_dx_px: 0.002,
            sigma_dy_px: 0.002,
            sigma_dtheta_deg: 0.003,
            points: 40,
        }
    }

    fn moved(is_matched: bool, interval_frames: u32) -> Measured {
        let motion = Some(step(7.8));
        let step = BodyStep { frame: 3, stamp_ns: 3, interval_frames, motion, ..BodyStep::default() };
        Measured { step, field: None, is_matched }
    }

    #[test]
    fn a_motion_that_outlines_do_not_share_is_not_the_bodys() {
        assert!(is_consistent(&moved(false, 1), None, pair(&at(100.0), &at(107.9), true)));
        assert!(is_consistent(&moved(false, 3), None, pair(&at(100.0), &at(123.3), true)));
        assert!(!is_consistent(&moved(true, 1), Some(&step(7.8)), pair(&at(100.0), &at(100.6), true)));
    }

    #[test]
    fn a_centre_moves_with_its_outlines_whatever_its_pattern_does() {
        let mut turning = moved(false, 1);
        assert!(!is_consistent(&turning, None, pair(&at(100.0), &at(107.1), true)));
        turning.step.drift = Some([-0.7, 0.0, 0.0].map(|value| Estimate { value, sigma: 0.02 }));
        assert!(is_consistent(&turning, None, pair(&at(100.0), &at(107.1), true)));
        assert!(!is_consistent(&turning, None, pair(&at(100.0), &at(107.8), true)));
        assert!(
            !agrees_with_subsets(&step(7.65), &step(7.8), None)
                && agrees_with_subsets(&step(7.65), &step(7.8), turning.step.drift)
        );
    }

    #[test]
    fn a_motion_between_outlines_that_were_not_detected_needs_other_evidence() {
        let (from, to) = (at(100.0), at(107.8));
        let outlines = pair(&from, &to, false);
        assert!(!is_consistent(&moved(false, 1), None, outlines));
        assert!(!is_consistent(&moved(false, 1), Some(&step(0.6)), outlines));
        assert!(is_consistent(&moved(false, 1), Some(&step(7.1)), outlines));
        assert!(is_consistent(&moved(true, 1), None, outlines));
        assert!(
            is_consistent(&moved(false, 1), None, pair(&from, &Err(PointStatus::Lost), false)),
            "nothing contradicts it"
        );
    }

    #[test]
    fn an_outline_goes_on_or_jumps_or_stays() {
        let ball = |frame: u64, x_px: f64| {
            let Ok(Outline::Ball(circle)) = at(x_px) else { panic!("a ball") };
            DetectedBall { frame, circle }
        };
        let first = ball(16, 100.0);
        let to = |frame: u64, x_px: f64| OutlineMotion::between(&first, &ball(frame, x_px)).unwrap();
        assert_eq!(to(19, 104.6).course_since(&to(18, 103.0)), Course::Even);
        assert_eq!(to(19, 110.0).course_since(&to(18, 103.0)), Course::Uneven);
        assert_eq!(to(19, 100.1).course_since(&to(18, 100.0)), Course::Open);
        assert_eq!(to(18, 103.0).course_since(&to(18, 103.0)), Course::Open);
        assert!(OutlineMotion::between(&first, &first).is_none());
    }

    #[test]
    fn a_small_ball_is_not_out_of_frame() {
        let field = PairField { frame: 0, target_frame: 1, stamp_ns: 0, body: 0, points: Vec::new() };
        let size = ImageSize { width: 240, height: 160 };
        let status = |x_px: f64| {
            let Ok(Outline::Ball(circle)) = at(x_px) else { panic!("a ball") };
            let outline = Some(circle.into());
            failure_status(&BodyStep { outline, ..BodyStep::default() }, &field, size)
        };
        assert_eq!((status(100.0), status(50.0)), (PointStatus::LowContrast, PointStatus::OutOfFrame));
    }
}
