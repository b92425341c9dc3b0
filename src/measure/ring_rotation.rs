//! Rotation of a ball from a ring around its centre.

use super::consistency;
use super::outline::RIM_CLEARANCE;
use super::pending_frame::FramePair;
use crate::dic::PolarCorrelator;
use crate::motion::RingLimits;
use crate::results::{Circle, RigidStep};

/// The default inner radius of the ring, as a fraction of the ball's.
///
/// Pixels closer to the centre hardly constrain the angle.
const INNER_FRACTION: f64 = 0.35;

/// The ring correlator for balls.
#[derive(Default)]
pub(super) struct RingRotation {
    ring: PolarCorrelator,
}

impl RingRotation {
    /// Replaces the rotation of the subsets by that of the ring; the subsets' translation moves the centre.
    ///
    /// Keeps the rotation of the subsets if the ring gives none or an inconsistent one.
    pub(super) fn replace(
        &mut self,
        step: &mut RigidStep,
        circle: &Circle,
        frames: FramePair<'_>,
        limits: RingLimits,
        interval_frames: f64,
    ) {
        let from = (circle.x_px, circle.y_px);
        let to = (from.0 + interval_frames * step.dx_px, from.1 + interval_frames * step.dy_px);
        let near = Some(interval_frames * step.dtheta_deg);
        let Ok(turn) =
            self.ring.rotation((frames.reference, from), (frames.target, to), ring_radii(circle, limits), near)
        else {
            return;
        };
        let turned = RigidStep {
            dtheta_deg: turn.angle_deg / interval_frames,
            sigma_dtheta_deg: turn.sigma_deg / interval_frames,
            ..*step
        };
        if consistency::agrees_with_subsets(&turned, step, None) {
            *step = turned;
        }
    }

    /// Returns the motion per frame between two detected positions of a ball, whatever its rotation.
    pub(super) fn motion_between(
        &mut self,
        from: &Circle,
        to: &Circle,
        frames: FramePair<'_>,
        interval_frames: f64,
    ) -> Option<RigidStep> {
        let (a, b) = ((from.x_px, from.y_px), (to.x_px, to.y_px));
        let radii = ring_radii(from, RingLimits::default());
        let turn = self.ring.rotation((frames.reference, a), (frames.target, b), radii, None).ok()?;
        let sigma_px = from.sigma_center_px.hypot(to.sigma_center_px) / interval_frames;
        Some(RigidStep {
            dx_px: (b.0 - a.0) / interval_frames,
            dy_px: (b.1 - a.1) / interval_frames,
            dtheta_deg: turn.angle_deg / interval_frames,
            sigma_dx_px: sigma_px,
            sigma_dy_px: sigma_px,
            sigma_dtheta_deg: turn.sigma_deg / interval_frames,
            points: 0,
        })
    }
}

/// Returns the inner and outer radius of the ring on a ball, px.
fn ring_radii(circle: &Circle, limits: RingLimits) -> (f64, f64) {
    let max_px = circle.radius_px * (1.0 - RIM_CLEARANCE);
    (limits.inner_px.unwrap_or(INNER_FRACTION * circle.radius_px), limits.outer_px.unwrap_or(max_px).min(max_px))
}
