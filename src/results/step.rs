//! What one pair of frames says of one body.

use super::{Estimate, PointStatus, RigidStep, Rod};

/// A ball's outline in one frame; of a patch, a disc of its area about the point that is told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Centre, px.
    pub x_px: f64,
    /// Centre, px (down).
    pub y_px: f64,
    /// Radius, px.
    pub radius_px: f64,
    /// Standard uncertainty of each centre coordinate, px.
    pub sigma_center_px: f64,
    /// Standard uncertainty of the radius, px.
    pub sigma_radius_px: f64,
    /// Share of the disc's area that is not hidden, 0 to 1.
    pub visible_fraction: f64,
}

impl RigidStep {
    /// No motion, of which nothing is known.
    pub const STILL: Self = Self {
        dx_px: 0.0,
        dy_px: 0.0,
        dtheta_deg: 0.0,
        sigma_dx_px: 0.0,
        sigma_dy_px: 0.0,
        sigma_dtheta_deg: 0.0,
        points: 0,
    };

    /// The same about a centre that is known to `center_sigma_px` only.
    #[must_use]
    pub fn about(self, center_sigma_px: f64) -> Self {
        let whirl = self.dtheta_deg.to_radians() * center_sigma_px;
        Self { sigma_dx_px: self.sigma_dx_px.hypot(whirl), sigma_dy_px: self.sigma_dy_px.hypot(whirl), ..self }
    }
}

/// One body in one frame, and its motion to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyStep {
    /// Whether the outline was not found in this frame, or not looked for, but is where the motion leads.
    pub is_carried: bool,
    /// Whether `step` is a match of the whole body with a reference that was kept, not of its subsets from frame to frame.
    pub is_whole: bool,
    /// Share of the body in sight by its rim, where the circle has what a match of the whole body told.
    pub rim_fraction: Option<f64>,
    /// By which share steps of far less than a pixel come out short because the sensor's pixels differ, as this frame
    /// shows it beside an earlier one; it scatters about its mean, below zero as well. `None` where it was not looked for.
    pub fixed_fraction: Option<f64>,
    /// By which share a frame the body grows in the picture from this frame on, as its subsets show it: it comes nearer to
    /// the camera, or goes to where the lens draws it larger.
    pub growth_fraction: Option<Estimate>,
    /// By how much a frame a ball moves beside what `step` says: its centre along x and y, px, and its rotation, deg. Its
    /// pattern moves with its front, which goes another way where the ball turns about an axis in the picture's plane.
    pub drift: Option<[Estimate; 3]>,
    /// Sequence number of the frame.
    pub frame: u64,
    /// Exposure start of the frame, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Index of the body in the configuration.
    pub body: u32,
    /// The interval the motion was measured over, frames.
    pub interval_frames: u32,
    /// The outline found in this frame, where the body is a ball or a patch.
    pub circle: Option<Circle>,
    /// The rod found in this frame, where the body is one.
    pub rod: Option<Rod>,
    /// The motion from this frame on; `None` in the last frames of a stream and where it could not be measured.
    pub step: Option<RigidStep>,
    /// What became of it.
    pub status: PointStatus,
}

/// A drift of more than so many sigmas is no chance.
const SURE_SIGMAS: f64 = 5.0;

impl BodyStep {
    /// Whether the centre surely moves otherwise than the step says.
    #[must_use]
    pub fn drifts(&self) -> bool {
        self.drift.is_some_and(|[x, y, _]| (x.value / x.sigma).hypot(y.value / y.sigma) > SURE_SIGMAS)
    }

    /// The motion of the ball a frame: the step's, with the drift where that is no chance.
    #[must_use]
    pub fn center_step(&self) -> Option<RigidStep> {
        let step = self.step?;
        let Some([x, y, turn]) = self.drift.filter(|_| self.drifts()) else { return Some(step) };
        Some(RigidStep {
            dx_px: step.dx_px + x.value,
            dy_px: step.dy_px + y.value,
            sigma_dx_px: step.sigma_dx_px.hypot(x.sigma),
            sigma_dy_px: step.sigma_dy_px.hypot(y.sigma),
            dtheta_deg: step.dtheta_deg + turn.value,
            sigma_dtheta_deg: step.sigma_dtheta_deg.hypot(turn.sigma),
            ..step
        })
    }

    /// The same without its motion, and without what a match of the whole body told of the share in sight.
    #[must_use]
    pub fn without_motion(self) -> Self {
        let by_rim = |circle: Circle| {
            let visible_fraction = self.rim_fraction.unwrap_or(circle.visible_fraction);
            Circle { visible_fraction, ..circle }
        };
        Self {
            circle: self.circle.map(by_rim),
            rim_fraction: None,
            fixed_fraction: None,
            growth_fraction: None,
            drift: None,
            is_whole: false,
            step: None,
            ..self
        }
    }
}
