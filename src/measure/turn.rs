//! Rotations from rings around a ball's centre.

use super::confirm;
use super::outline::RIM_CLEARANCE;
use crate::dic::{Prepared, Ring};
use crate::motion::RingLimits;
use crate::results::{Circle, RigidStep};

/// Inner radius of a ring where none is given, as a share of the ball's: nearer to the centre pixels tell little of the angle.
const INNER_SHARE: f64 = 0.35;

/// Finds rotations of balls.
#[derive(Default)]
pub(super) struct Turns {
    ring: Ring,
}

impl Turns {
    /// Puts the ring's rotation in the place of the subsets', whose motion carries the centre.
    ///
    /// The subsets' own stays where the ring has no answer or speaks of something else.
    pub(super) fn replace(
        &mut self,
        step: &mut RigidStep,
        circle: &Circle,
        (reference, target): (&Prepared, &Prepared),
        limits: RingLimits,
        frames: f64,
    ) {
        let from = (circle.x_px, circle.y_px);
        let to = (from.0 + frames * step.dx_px, from.1 + frames * step.dy_px);
        let near = Some(frames * step.dtheta_deg);
        let Ok(turn) = self.ring.turn((reference, from), (target, to), radii(circle, limits), near) else { return };
        let turned =
            RigidStep { dtheta_deg: turn.angle_deg / frames, sigma_dtheta_deg: turn.sigma_deg / frames, ..*step };
        if confirm::agree(&turned, step, None) {
            *step = turned;
        }
    }

    /// The motion a frame between two places where a ball was seen, whatever it turned by.
    pub(super) fn between(
        &mut self,
        from: &Circle,
        to: &Circle,
        (reference, target): (&Prepared, &Prepared),
        frames: f64,
    ) -> Option<RigidStep> {
        let (a, b) = ((from.x_px, from.y_px), (to.x_px, to.y_px));
        let radii = radii(from, RingLimits::default());
        let turn = self.ring.turn((reference, a), (target, b), radii, None).ok()?;
        let sigma_px = from.sigma_center_px.hypot(to.sigma_center_px) / frames;
        Some(RigidStep {
            dx_px: (b.0 - a.0) / frames,
            dy_px: (b.1 - a.1) / frames,
            dtheta_deg: turn.angle_deg / frames,
            sigma_dx_px: sigma_px,
            sigma_dy_px: sigma_px,
            sigma_dtheta_deg: turn.sigma_deg / frames,
            points: 0,
        })
    }
}

/// Inner and outer radius of the ring on a ball, px.
fn radii(circle: &Circle, limits: RingLimits) -> (f64, f64) {
    let most_px = circle.radius_px * (1.0 - RIM_CLEARANCE);
    (limits.inner_px.unwrap_or(INNER_SHARE * circle.radius_px), limits.outer_px.unwrap_or(most_px).min(most_px))
}
