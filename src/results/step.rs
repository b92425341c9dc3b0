//! Steps: one body in one frame, and its motion to a later one.

use super::named::named_enum;
use super::{Estimate, MotionSample, PointStatus, Rod};

/// The outline of a ball in one frame; for a patch, a disc of the same area around its reported point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// The centre along x, px.
    pub x_px: f64,
    /// The centre along y (down), px.
    pub y_px: f64,
    /// The radius, px.
    pub radius_px: f64,
    /// The standard uncertainty of each centre coordinate, px.
    pub sigma_center_px: f64,
    /// The standard uncertainty of the radius, px.
    pub sigma_radius_px: f64,
    /// The visible share of the disc's area, 0 to 1.
    pub visible_fraction: f64,
}

/// The motion of a body per frame: the displacement of its centre and its rotation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RigidStep {
    /// The displacement of the centre along x, px/frame.
    pub dx_px: f64,
    /// The displacement of the centre along y (down), px/frame.
    pub dy_px: f64,
    /// The rotation, counter-clockwise as seen on the screen, deg/frame.
    pub dtheta_deg: f64,
    /// The standard uncertainty of `dx_px`, px/frame.
    pub sigma_dx_px: f64,
    /// The standard uncertainty of `dy_px`, px/frame.
    pub sigma_dy_px: f64,
    /// The standard uncertainty of `dtheta_deg`, deg/frame; [`Self::ANY_ROTATION_DEG`] if it was not measured.
    pub sigma_dtheta_deg: f64,
    /// The number of subsets or pixels it rests on.
    pub points: u32,
}

/// The standard uncertainty from which a rotation is not known at all, deg/frame.
const UNKNOWN_ROTATION_DEG: f64 = 90.0;

impl RigidStep {
    /// The standard uncertainty of a rotation that was not measured, deg/frame: any is possible.
    pub const ANY_ROTATION_DEG: f64 = 1e4;

    /// Whether the rotation was measured: its standard uncertainty is below 90 deg/frame.
    #[must_use]
    pub fn has_rotation(&self) -> bool {
        self.sigma_dtheta_deg < UNKNOWN_ROTATION_DEG
    }

    /// No motion, with no uncertainty.
    pub const STILL: Self = Self {
        dx_px: 0.0,
        dy_px: 0.0,
        dtheta_deg: 0.0,
        sigma_dx_px: 0.0,
        sigma_dy_px: 0.0,
        sigma_dtheta_deg: 0.0,
        points: 0,
    };

    /// Adds the uncertainty of rotating about a centre with the standard uncertainty `center_sigma_px`, px.
    ///
    /// It is the rotation in rad times that uncertainty, added in quadrature to those of both displacements.
    #[must_use]
    pub fn about(self, center_sigma_px: f64) -> Self {
        let sigma_px = self.dtheta_deg.to_radians() * center_sigma_px;
        Self { sigma_dx_px: self.sigma_dx_px.hypot(sigma_px), sigma_dy_px: self.sigma_dy_px.hypot(sigma_px), ..self }
    }

    /// Adds an error of the rotation, as a fraction of it.
    #[must_use]
    pub fn with_rotation_error(self, fraction: f64) -> Self {
        Self { sigma_dtheta_deg: self.sigma_dtheta_deg.hypot(fraction * self.dtheta_deg), ..self }
    }

    /// Multiplies the standard uncertainties: x, y and the rotation.
    #[must_use]
    pub fn with_sigmas(self, factors: [f64; 3]) -> Self {
        let [x, y, rotation] = factors;
        Self {
            sigma_dx_px: x * self.sigma_dx_px,
            sigma_dy_px: y * self.sigma_dy_px,
            sigma_dtheta_deg: rotation * self.sigma_dtheta_deg,
            ..self
        }
    }
}

named_enum! {
    /// The origin of an outline.
    OutlineOrigin: "origin" {
        /// Detected in the frame.
        Detected = 0 "detected",
        /// Searched in vain, and predicted by a motion that was measured up to this frame.
        Predicted = 1 "predicted",
        /// Not searched, since the whole body was visible, and predicted by its motion.
        Reused = 2 "reused",
        /// Searched in vain, and predicted by the motion between earlier outlines: not a measurement.
        Coasted = 3 "coasted",
    }
}

/// The shape of an outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OutlineShape {
    /// A ball or a patch.
    Circle(Circle),
    /// A rod.
    Rod(Rod),
}

/// The outline of a body in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outline {
    /// The shape.
    pub shape: OutlineShape,
    /// The origin.
    pub origin: OutlineOrigin,
    /// The visible share of the body by its rim, 0 to 1, if a match of the whole body replaced it in the circle.
    pub rim_fraction: Option<f64>,
}

impl Outline {
    /// Returns an outline of this shape and origin, without a visible share by its rim.
    #[must_use]
    pub fn new(shape: OutlineShape, origin: OutlineOrigin) -> Self {
        Self { shape, origin, rim_fraction: None }
    }
}

impl From<RigidStep> for MotionSample {
    /// Returns the motion as a row holds it, without a rotation that was not measured.
    fn from(step: RigidStep) -> Self {
        let rotation = Some(step).filter(RigidStep::has_rotation);
        Self {
            dx_px: step.dx_px,
            dy_px: step.dy_px,
            dtheta_deg: rotation.map(|step| step.dtheta_deg),
            sigma_dx_px: step.sigma_dx_px,
            sigma_dy_px: step.sigma_dy_px,
            sigma_dtheta_deg: rotation.map(|step| step.sigma_dtheta_deg),
            points: step.points,
        }
    }
}

impl From<Circle> for Outline {
    /// Returns an outline that was detected in the frame.
    fn from(circle: Circle) -> Self {
        Self::new(OutlineShape::Circle(circle), OutlineOrigin::Detected)
    }
}

impl From<Rod> for Outline {
    /// Returns an outline that was detected in the frame.
    fn from(rod: Rod) -> Self {
        Self::new(OutlineShape::Rod(rod), OutlineOrigin::Detected)
    }
}

named_enum! {
    /// The method that measured a motion.
    #[derive(Default)]
    MotionMethod: "method" {
        /// The subsets of the body, matched from frame to frame.
        #[default]
        Subsets = 1 "subsets",
        /// A rigid match of the whole body with a stored reference.
        WholeBody = 2 "whole-body",
        /// The outlines of the body in both frames, which leave its rotation open.
        Outlines = 3 "outlines",
    }
}

/// One body in one frame, and its motion to a later one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyStep {
    /// The sequence number of the frame.
    pub frame: u64,
    /// The start of the frame's exposure, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// The index of the body in the configuration.
    pub body: u32,
    /// The interval that the motion is measured over, frames.
    pub interval_frames: u32,
    /// The outline in this frame.
    pub outline: Option<Outline>,
    /// The rotation of a patch since the image that it was drawn in, deg; full turns are not counted.
    pub angle_deg: Option<Estimate>,
    /// The motion from this frame on; `None` in the last frames of a stream and where it could not be measured.
    pub motion: Option<RigidStep>,
    /// The method that measured `motion`.
    pub method: MotionMethod,
    /// The share by which steps much shorter than a pixel are underestimated because of the sensor's fixed pattern. It is
    /// measured against an earlier frame and scatters about its mean, also below zero. `None` where it was not measured.
    pub fixed_fraction: Option<f64>,
    /// The share by which light that stays in the room may have held back the rotation. `None` where there is none.
    pub light_fraction: Option<f64>,
    /// The distance from the centre of the point that light or stripes may hold in place while the body turns, px. `None`
    /// where there is none.
    pub pull_px: Option<f64>,
    /// The relative growth of the body's image per frame from this frame on, measured from its subsets. The body comes
    /// nearer to the camera, or moves to where the lens draws it larger.
    pub growth_fraction: Option<Estimate>,
    /// The motion of a ball per frame relative to `motion`: its centre along x and y, px, and its rotation, deg. The
    /// pattern moves with the front of the ball, which moves differently when the ball turns about an axis in the image
    /// plane.
    pub drift: Option<[Estimate; 3]>,
    /// The reason why the rotation of `motion` was not measured; valid if it was, or if there is no motion.
    pub rotation_status: PointStatus,
    /// The status of the measurement.
    pub status: PointStatus,
}

/// The number of standard uncertainties from which a drift is significant.
const SIGNIFICANT_DRIFT_SIGMAS: f64 = 5.0;

impl BodyStep {
    /// Returns the circle of a ball or patch; `None` for a rod and without an outline.
    #[must_use]
    pub fn circle(&self) -> Option<Circle> {
        match self.outline?.shape {
            OutlineShape::Circle(circle) => Some(circle),
            OutlineShape::Rod(_) => None,
        }
    }

    /// Returns the rod; `None` for other bodies and without an outline.
    #[must_use]
    pub fn rod(&self) -> Option<Rod> {
        match self.outline?.shape {
            OutlineShape::Rod(rod) => Some(rod),
            OutlineShape::Circle(_) => None,
        }
    }

    /// Returns the visible centre of the body, (x, y) in px with y down; `None` without an outline.
    ///
    /// It is the centre of the circle, or the point that moves with the rod.
    #[must_use]
    pub fn center_px(&self) -> Option<[f64; 2]> {
        Some(match self.outline?.shape {
            OutlineShape::Circle(circle) => [circle.x_px, circle.y_px],
            OutlineShape::Rod(rod) => [rod.x_px.value, rod.y_px.value],
        })
    }

    /// Whether the outline was detected in this frame, and not predicted; `false` without an outline.
    #[must_use]
    pub fn is_detected(&self) -> bool {
        self.outline.is_some_and(|outline| outline.origin == OutlineOrigin::Detected)
    }

    /// Whether the drift of the centre, in units of its standard uncertainties along x and y, is longer than 5.
    ///
    /// `false` where no drift was measured. The drift of the rotation does not matter.
    #[must_use]
    pub fn drifts(&self) -> bool {
        self.drift.is_some_and(|[x, y, _]| (x.value / x.sigma).hypot(y.value / y.sigma) > SIGNIFICANT_DRIFT_SIGMAS)
    }

    /// Returns the motion of the body's centre per frame: `motion`, plus the whole drift if it is significant.
    ///
    /// Its rotation is then added too, and standard uncertainties add in quadrature. `None` without a motion.
    #[must_use]
    pub fn center_motion(&self) -> Option<RigidStep> {
        let motion = self.motion?;
        let Some([x, y, turn]) = self.drift.filter(|_| self.drifts()) else { return Some(motion) };
        Some(RigidStep {
            dx_px: motion.dx_px + x.value,
            dy_px: motion.dy_px + y.value,
            sigma_dx_px: motion.sigma_dx_px.hypot(x.sigma),
            sigma_dy_px: motion.sigma_dy_px.hypot(y.sigma),
            dtheta_deg: motion.dtheta_deg + turn.value,
            sigma_dtheta_deg: motion.sigma_dtheta_deg.hypot(turn.sigma),
            ..motion
        })
    }

    /// Returns the step without its motion and all that was measured with it.
    ///
    /// The circle's visible share becomes that by its rim, where a match of the whole body had replaced it. Status,
    /// rotation status and angle stay.
    #[must_use]
    pub fn without_motion(self) -> Self {
        let by_rim = |outline: Outline| match (outline.shape, outline.rim_fraction) {
            (OutlineShape::Circle(circle), Some(visible_fraction)) => {
                Outline::new(OutlineShape::Circle(Circle { visible_fraction, ..circle }), outline.origin)
            }
            _ => outline,
        };
        Self {
            outline: self.outline.map(by_rim),
            motion: None,
            method: MotionMethod::default(),
            fixed_fraction: None,
            light_fraction: None,
            pull_px: None,
            growth_fraction: None,
            drift: None,
            ..self
        }
    }
}
