//! Whether a motion that was measured is that of the body that was seen; why there is none.

use super::block::Measured;
use super::outline::Outline;
use crate::results::{Estimate, PairField, PointStatus, RigidStep};

/// Two outlines of one body are not further from the motion of its subsets than this, px.
const MOST_APART_PX: f64 = 0.5;

/// Nor from that of a match of the whole body, which cannot be another's, px: here only the outlines may err.
const WHOLE_MOST_APART_PX: f64 = 1.5;

/// Nor than so many of their uncertainties.
const MOST_SIGMAS: f64 = 8.0;

/// A motion that nothing else speaks for differs from the one before by less than this, px/frame.
const MOST_SUDDEN_PX: f64 = 1.0;

/// How far apart the whole body's step and its subsets' may be at least, px, px and deg.
///
/// Beyond this and eight sigma one of the two follows something else.
const WHOLE_APART: [f64; 3] = [0.05, 0.05, 0.1];

/// Share of the drift of subsets by which that of the whole body differs at most.
const OTHER_PART: f64 = 0.3;

/// Whether the body that was seen in both frames can have moved so.
///
/// Subsets follow whatever is in front of most of them. Where both outlines were `seen`, they must have moved as far;
/// where not, the body must have been matched as a whole, or go on much as it did `before`.
pub(super) fn holds(
    Measured { step: measured, is_matched, .. }: &Measured,
    before: Option<&RigidStep>,
    (from, to): (&Result<Outline, PointStatus>, &Result<Outline, PointStatus>),
    seen: bool,
) -> bool {
    let (Ok(Outline::Ball(from)), Ok(Outline::Ball(to)), Some(step)) = (from, to, measured.center_step()) else {
        return true;
    };
    if seen {
        let frames = f64::from(measured.interval_frames);
        let apart = (to.x_px - from.x_px - frames * step.dx_px).hypot(to.y_px - from.y_px - frames * step.dy_px);
        let most = if *is_matched { WHOLE_MOST_APART_PX } else { MOST_APART_PX };
        return apart <= most.max(MOST_SIGMAS * from.sigma_center_px.hypot(to.sigma_center_px));
    }
    *is_matched || before.is_some_and(|before| goes_on(before, &step))
}

/// Whether a motion is much like the one before it.
fn goes_on(before: &RigidStep, step: &RigidStep) -> bool {
    let sigma = step.sigma_dx_px.hypot(step.sigma_dy_px).hypot(before.sigma_dx_px.hypot(before.sigma_dy_px));
    (step.dx_px - before.dx_px).hypot(step.dy_px - before.dy_px) <= MOST_SUDDEN_PX + MOST_SIGMAS * sigma
}

/// Whether the whole body moved as its subsets did.
///
/// Of a front that turns they see other parts: they differ by a share of how much farther than the rim it moves.
pub(super) fn agree(whole: &RigidStep, field: &RigidStep, drift: Option<[Estimate; 3]>) -> bool {
    let turns = drift.map_or(0.0, |[x, y, _]| OTHER_PART * x.value.hypot(y.value));
    let most = [WHOLE_APART[0] + turns, WHOLE_APART[1] + turns, WHOLE_APART[2]];
    let apart = [whole.dx_px - field.dx_px, whole.dy_px - field.dy_px, whole.dtheta_deg - field.dtheta_deg];
    let sigma = [
        whole.sigma_dx_px.hypot(field.sigma_dx_px),
        whole.sigma_dy_px.hypot(field.sigma_dy_px),
        whole.sigma_dtheta_deg.hypot(field.sigma_dtheta_deg),
    ];
    apart.iter().zip(sigma).zip(most).all(|((apart, sigma), most)| apart.abs() <= most.max(8.0 * sigma))
}

/// The most frequent reason why the subsets of a field give no motion.
pub(super) fn why_not(field: &PairField) -> PointStatus {
    let count = |status: PointStatus| field.points.iter().filter(|point| point.status == status).count();
    let invalid = PointStatus::ALL.into_iter().filter(|status| *status != PointStatus::Valid);
    let most = invalid.max_by_key(|status| count(*status)).filter(|status| count(*status) > 0);
    // No subset fits into the body at all.
    most.unwrap_or(PointStatus::OutOfFrame)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{BodyStep, Circle};

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
        let (circle, rod, step, status) = (None, None, Some(step(7.8)), PointStatus::Valid);
        let (rim_fraction, fixed_fraction) = (None, None);
        let step = BodyStep {
            is_whole: is_matched,
            rim_fraction,
            fixed_fraction,
            growth_fraction: None,
            is_carried: false,
            drift: None,
            frame: 3,
            stamp_ns: 3,
            body: 0,
            interval_frames,
            circle,
            rod,
            step,
            status,
        };
        Measured { step, field: None, is_matched }
    }

    #[test]
    fn a_motion_that_outlines_do_not_share_is_not_the_bodys() {
        assert!(holds(&moved(false, 1), None, (&at(100.0), &at(107.9)), true));
        assert!(holds(&moved(false, 3), None, (&at(100.0), &at(123.3)), true));
        assert!(!holds(&moved(true, 1), Some(&step(7.8)), (&at(100.0), &at(100.6)), true));
    }

    #[test]
    fn a_centre_moves_with_its_outlines_whatever_its_pattern_does() {
        let mut turning = moved(false, 1);
        assert!(!holds(&turning, None, (&at(100.0), &at(107.1)), true));
        turning.step.drift = Some([-0.7, 0.0, 0.0].map(|value| Estimate { value, sigma: 0.02 }));
        assert!(holds(&turning, None, (&at(100.0), &at(107.1)), true));
        assert!(!holds(&turning, None, (&at(100.0), &at(107.8)), true));
        assert!(!agree(&step(7.65), &step(7.8), None) && agree(&step(7.65), &step(7.8), turning.step.drift));
    }

    #[test]
    fn a_motion_between_outlines_that_were_not_seen_needs_other_evidence() {
        let pair = (&at(100.0), &at(107.8));
        assert!(!holds(&moved(false, 1), None, pair, false));
        assert!(!holds(&moved(false, 1), Some(&step(0.6)), pair, false));
        assert!(holds(&moved(false, 1), Some(&step(7.1)), pair, false));
        assert!(holds(&moved(true, 1), None, pair, false));
        assert!(holds(&moved(false, 1), None, (&at(100.0), &Err(PointStatus::Lost)), false), "nothing contradicts it");
    }
}
