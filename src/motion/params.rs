//! Parameters of the motion of a body.

use super::{Center, Form, Intervals, RandomWalk, Rectifier, Shutter};
use crate::results::{BodyStep, FrameCoding};

/// Uncertainty of the principal point as a share of the image: lenses are slightly decentred, and a sensor's readout
/// window need not be centred.
const PRINCIPAL_POINT_SHARE: f64 = 0.05;
/// The same for a calibrated lens.
const CALIBRATED_POINT_SHARE: f64 = 0.005;

/// The scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Unknown: results stay in pixels.
    Unknown,
    /// Given by the user.
    MmPerPx(f64),
    /// From the ball's true diameter in mm and its measured radius.
    BallDiameterMm(f64),
}

/// The source of a body's motion, its rotation and its centre's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Rotation {
    /// One match of all visible pixels against a kept reference, and the subsets where that fails.
    #[default]
    Rigid,
    /// The displacement field: least squares over all valid subsets.
    Field,
    /// The displacement field at the centre, and the mean rotation of its subsets about it: the paper's method.
    Center,
    /// A ring of pixels around the centre, unwrapped and correlated along the angle; the field moves the centre.
    Ring(RingLimits),
}

/// The radii of a ring; missing ones follow from the ball's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RingLimits {
    /// Inner radius, px.
    pub inner_px: Option<f64>,
    /// Outer radius, px; at most the ball's.
    pub outer_px: Option<f64>,
}

/// The principal point: the image magnifies about it when a body comes closer.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct View {
    /// The principal point in the rectified image, px.
    pub principal_point_px: [f64; 2],
    /// Its standard uncertainty, px.
    pub sigma_px: f64,
}

impl View {
    /// Returns the principal point for images of this width and height, px: of the calibration if there is one, else
    /// the centre of the image.
    pub fn new(size_px: [u32; 2], rectifier: Option<&Rectifier>) -> Self {
        let size = size_px.map(f64::from);
        let longest_px = size[0].max(size[1]);
        match rectifier {
            None => Self {
                principal_point_px: size.map(|length| 0.5 * (length - 1.0)),
                sigma_px: PRINCIPAL_POINT_SHARE * longest_px,
            },
            // Motion out of a plane that is seen obliquely magnifies about the foot of the camera, whose position is
            // unknown.
            Some(rectifier) if rectifier.mm_per_px().is_some() => {
                Self { principal_point_px: rectifier.principal_point_px(), sigma_px: longest_px }
            }
            Some(rectifier) => Self {
                principal_point_px: rectifier.principal_point_px(),
                sigma_px: CALIBRATED_POINT_SHARE * longest_px,
            },
        }
    }
}

/// All parameters of a body's motion.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionParams {
    /// Pixels to millimetres.
    pub scale: Scale,
    /// From the recorded image to one without lens distortion and perspective, for a calibrated camera. Scale, surface
    /// and gravity refer to that image.
    pub rectifier: Option<Rectifier>,
    /// The principal point.
    pub view: View,
    /// Direction of the struck surface's tangent, counter-clockwise from x, deg.
    pub surface_angle_deg: f64,
    /// The radius that diameter and scale predict, px, where both are given.
    pub radius_px: Option<f64>,
    /// Gravity, m/s^2; 0 switches it off.
    pub gravity_m_s2: f64,
    /// The direction of free fall, counter-clockwise from x (y up), deg; -90 for a level camera.
    pub gravity_angle_deg: f64,
    /// Frames of the local velocity fit, odd; `None` lets the fit choose.
    pub window_frames: Option<u32>,
    /// The number of frames after a frame that its rates may use: the lag of its row.
    pub lag_frames: u64,
    /// Order of the local fit to the positions: 1 to 4.
    pub order: u32,
    /// Mass of the body, kg, where it is known.
    pub mass_kg: Option<f64>,
    /// The kind of body.
    pub form: Form,
    /// The interval of each step, frames; the shortest of several.
    pub interval_frames: u32,
    /// The noise of a step that the next step does not cancel.
    pub walk: RandomWalk,
    /// The intervals over which motion is measured.
    pub spans: Intervals,
    /// Exposure time, ns; a frame shows the moment half of it after its stamp. 0 when unknown.
    pub exposure_ns: f64,
    /// The coding of the film.
    pub coding: FrameCoding,
    /// The timing of a frame's rows.
    pub shutter: Shutter,
    /// Nominal frame period, ns. It is used for gaps alone; times come from the stamps.
    pub frame_period_ns: f64,
}

impl MotionParams {
    /// Converts a step from the recorded to the rectified image. Outline and motion are `None` beyond the calibration.
    pub fn rectified(&self, step: &BodyStep) -> BodyStep {
        let Some(rectifier) = &self.rectifier else { return *step };
        rectifier.rectify_step(step, self.form).unwrap_or(BodyStep { outline: None, motion: None, ..*step })
    }

    /// Converts a centre from the rectified to the recorded image, px; `None` beyond the calibration.
    pub fn recorded(&self, center: Center) -> Option<Center> {
        let Some(rectifier) = &self.rectifier else { return Some(center) };
        let [x_px, y_px] = rectifier.pixel([center.x_px, center.y_px])?;
        Some(Center { x_px, y_px, ..center })
    }
}
