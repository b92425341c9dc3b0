//! Whether a motion that was measured is that of the body that was seen.

use super::outline::Outline;
use crate::results::{PointStatus, RigidStep};

/// Two outlines of one body are not further from its motion than this, px; deformed balls in contact reach half of it.
const MOST_APART_PX: f64 = 1.5;

/// Nor than so many of their uncertainties.
const MOST_SIGMAS: f64 = 8.0;

/// A motion that nothing else speaks for differs from the one before by less than this, px/frame.
const MOST_SUDDEN_PX: f64 = 1.0;

/// How far apart the whole body's step and its subsets' may be at least, px, px and deg.
///
/// Beyond this and eight sigma one of the two follows something else.
const WHOLE_APART: [f64; 3] = [0.05, 0.05, 0.1];

/// What speaks for a motion besides the subsets it may come from.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Evidence {
    /// It is a match of the whole body with a picture of it kept from before.
    pub(super) is_whole: bool,
    /// The motion before it.
    pub(super) before: Option<RigidStep>,
}

/// Whether the body that was seen in both frames can have moved so.
///
/// Subsets follow whatever is in front of most of them. Where both outlines were `seen`, they must have moved as far;
/// where not, the body must have been matched as a whole, or go on much as it did.
pub(super) fn holds(
    step: &RigidStep,
    frames: u64,
    (from, to): (&Result<Outline, PointStatus>, &Result<Outline, PointStatus>),
    seen: bool,
    evidence: &Evidence,
) -> bool {
    let (Ok(Outline::Ball(from)), Ok(Outline::Ball(to))) = (from, to) else { return true };
    if seen {
        let moved = frames as f64;
        let apart = (to.x_px - from.x_px - moved * step.dx_px).hypot(to.y_px - from.y_px - moved * step.dy_px);
        return apart <= MOST_APART_PX.max(MOST_SIGMAS * from.sigma_center_px.hypot(to.sigma_center_px));
    }
    evidence.is_whole || evidence.before.is_some_and(|before| goes_on(&before, step))
}

/// Whether a motion is much like the one before it.
fn goes_on(before: &RigidStep, step: &RigidStep) -> bool {
    let sigma = step.sigma_dx_px.hypot(step.sigma_dy_px).hypot(before.sigma_dx_px.hypot(before.sigma_dy_px));
    (step.dx_px - before.dx_px).hypot(step.dy_px - before.dy_px) <= MOST_SUDDEN_PX + MOST_SIGMAS * sigma
}

/// Whether the whole body moved as its subsets did.
pub(super) fn agree(whole: &RigidStep, field: &RigidStep) -> bool {
    let apart = [whole.dx_px - field.dx_px, whole.dy_px - field.dy_px, whole.dtheta_deg - field.dtheta_deg];
    let sigma = [
        whole.sigma_dx_px.hypot(field.sigma_dx_px),
        whole.sigma_dy_px.hypot(field.sigma_dy_px),
        whole.sigma_dtheta_deg.hypot(field.sigma_dtheta_deg),
    ];
    apart.iter().zip(sigma).zip(WHOLE_APART).all(|((apart, sigma), most)| apart.abs() <= most.max(8.0 * sigma))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Circle;

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

    #[test]
    fn a_motion_that_outlines_do_not_share_is_not_the_bodys() {
        let nothing = Evidence::default();
        assert!(holds(&step(7.8), 1, (&at(100.0), &at(107.9)), true, &nothing));
        assert!(holds(&step(7.8), 3, (&at(100.0), &at(123.3)), true, &nothing));
        assert!(!holds(&step(7.8), 1, (&at(100.0), &at(100.6)), true, &nothing));
    }

    #[test]
    fn a_motion_between_outlines_that_were_not_seen_needs_other_evidence() {
        let pair = (&at(100.0), &at(107.8));
        assert!(!holds(&step(7.8), 1, pair, false, &Evidence::default()));
        assert!(!holds(&step(7.8), 1, pair, false, &Evidence { is_whole: false, before: Some(step(0.6)) }));
        assert!(holds(&step(7.8), 1, pair, false, &Evidence { is_whole: false, before: Some(step(7.1)) }));
        assert!(holds(&step(7.8), 1, pair, false, &Evidence { is_whole: true, before: None }));
        let out = Err(PointStatus::Lost);
        assert!(holds(&step(7.8), 1, (&at(100.0), &out), false, &Evidence::default()), "nothing contradicts it");
    }
}
