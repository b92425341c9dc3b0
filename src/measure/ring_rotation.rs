//! Rotation of a ball from a ring around its centre.

use super::consistency;
use super::outline::RIM_CLEARANCE;
use super::pending_frame::FramePair;
use crate::dic::{CenteredFrame, Point, PolarCorrelator, PreparedFrame, Radii, RingPattern};
use crate::motion::RingLimits;
use crate::results::{Circle, RigidStep};

/// The default inner radius of the ring, as a fraction of the ball's.
///
/// Pixels closer to the centre hardly constrain the angle.
const INNER_FRACTION: f64 = 0.35;

/// The outer radius of the ring whose marks are examined, as a fraction of the ball's. Shading is steep beyond.
const EXAMINED_FRACTION: f64 = 0.85;

/// The period below which a pattern counts as repeating, deg.
///
/// Rotations up to 20 deg from the predicted one are searched, so two places of a pattern of this period are within reach.
const MAX_PERIOD_DEG: f64 = 40.0;

/// The maximum difference between the rotation of a ball and that of its ring, deg.
const MAX_RING_APART_DEG: f64 = 6.0;

/// The motion of a ball, and the rotation of its ring over the same frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct RingTurn {
    pub(super) motion: RigidStep,
    pub(super) ring_deg: f64,
    pub(super) frames: f64,
}

impl RingTurn {
    /// Returns the motion per frame with the rotation of the ring.
    pub(super) fn motion_of_ring(&self) -> RigidStep {
        RigidStep { dtheta_deg: self.ring_deg / self.frames, ..self.motion }
    }

    /// Whether a motion turns as the ring, but for whole turns.
    pub(super) fn agrees(&self, motion: &RigidStep) -> bool {
        let apart_deg = self.ring_deg - self.frames * motion.dtheta_deg;
        (apart_deg - 360.0 * (apart_deg / 360.0).round()).abs() < MAX_RING_APART_DEG
    }
}

/// The ring correlator for balls.
#[derive(Default)]
pub(super) struct RingCorrelator {
    ring: PolarCorrelator,
}

impl RingCorrelator {
    /// Replaces the rotation per frame in `step` by that of the ring; the translation of the subsets moves the
    /// centre.
    ///
    /// Keeps the rotation of the subsets if the ring gives none or an inconsistent one.
    pub(super) fn replace_rotation(
        &mut self,
        step: &mut RigidStep,
        circle: &Circle,
        frames: FramePair<'_>,
        limits: RingLimits,
        interval_frames: f64,
    ) {
        let from = CenteredFrame { frame: frames.reference, center: Point::new(circle.x_px, circle.y_px) };
        let (dx, dy) = (interval_frames * step.dx_px, interval_frames * step.dy_px);
        let to = CenteredFrame { frame: frames.target, center: Point::new(circle.x_px + dx, circle.y_px + dy) };
        let near = Some(interval_frames * step.dtheta_deg);
        let Ok(turn) = self.ring.rotation(from, to, ring_radii(circle, limits), near) else { return };
        let turned = RigidStep {
            dtheta_deg: turn.angle_deg / interval_frames,
            sigma_dtheta_deg: turn.sigma_deg / interval_frames,
            ..*step
        };
        if consistency::agrees_with_subsets(&turned, step, None) {
            *step = turned;
        }
    }

    /// Examines the marks of a ball, and whether they look the same after a rotation that a match may mistake for
    /// another. `None` if too little of the ball lies in the image.
    pub(super) fn examine(&mut self, frame: &PreparedFrame, circle: &Circle) -> Option<RingPattern> {
        let body = CenteredFrame { frame, center: Point::new(circle.x_px, circle.y_px) };
        let Circle { radius_px, .. } = *circle;
        let radii = Radii { inner_px: INNER_FRACTION * radius_px, outer_px: EXAMINED_FRACTION * radius_px };
        self.ring.examine(body, radii, MAX_PERIOD_DEG)
    }

    /// Returns the rotation between two detected positions of a ball to about a degree, deg; `None` if the ring does not
    /// match.
    pub(super) fn coarse_rotation_deg(&mut self, from: &Circle, to: &Circle, frames: FramePair<'_>) -> Option<f64> {
        let a = CenteredFrame { frame: frames.reference, center: Point::new(from.x_px, from.y_px) };
        let b = CenteredFrame { frame: frames.target, center: Point::new(to.x_px, to.y_px) };
        self.ring.coarse_rotation(a, b, ring_radii(from, RingLimits::default())).ok()
    }

    /// Returns the motion per frame between two detected positions of a ball, with any rotation.
    ///
    /// `None` if the ring does not match.
    pub(super) fn motion_between(
        &mut self,
        from: &Circle,
        to: &Circle,
        frames: FramePair<'_>,
        interval_frames: f64,
    ) -> Option<RigidStep> {
        let radii = ring_radii(from, RingLimits::default());
        let a = CenteredFrame { frame: frames.reference, center: Point::new(from.x_px, from.y_px) };
        let b = CenteredFrame { frame: frames.target, center: Point::new(to.x_px, to.y_px) };
        let turn = self.ring.rotation(a, b, radii, None).ok()?;
        let sigma_px = from.sigma_center_px.hypot(to.sigma_center_px) / interval_frames;
        Some(RigidStep {
            dx_px: (to.x_px - from.x_px) / interval_frames,
            dy_px: (to.y_px - from.y_px) / interval_frames,
            dtheta_deg: turn.angle_deg / interval_frames,
            sigma_dx_px: sigma_px,
            sigma_dy_px: sigma_px,
            sigma_dtheta_deg: turn.sigma_deg / interval_frames,
            points: 0,
        })
    }
}

/// Returns the radii of the ring on a ball, px: by default from 0.35 radii to the margin at the rim, the maximum.
fn ring_radii(circle: &Circle, limits: RingLimits) -> Radii {
    let max_px = circle.radius_px * (1.0 - RIM_CLEARANCE);
    Radii {
        inner_px: limits.inner_px.unwrap_or(INNER_FRACTION * circle.radius_px),
        outer_px: limits.outer_px.unwrap_or(max_px).min(max_px),
    }
}
