//! What the motion of a body is computed with.

use super::{Center, Rectifier, Shutter, Spans, Walk};
use crate::results::BodyStep;

/// How far from a picture's middle a camera may look straight ahead, as a share of the picture: lenses sit a little beside
/// it, and a part that is read out of the sensor need not be its middle.
const UNSURE_MIDDLE: f64 = 0.05;
/// The same of a calibrated lens.
const CALIBRATED_MIDDLE: f64 = 0.005;

/// How many millimetres a pixel is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Not known: results stay in pixels.
    Unknown,
    /// Given by the user.
    MmPerPx(f64),
    /// From the ball's true diameter in mm and its measured radius.
    BallDiameterMm(f64),
}

/// What the motion of a body, its rotation and that of its centre, is taken from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Rotation {
    /// One match of all its pixels in sight against a reference that is kept; the subsets where that fails.
    #[default]
    Rigid,
    /// The displacement field: least squares over all valid subsets.
    Field,
    /// The displacement field at the centre, and the mean of its subsets' rotations about it: the paper's way.
    Center,
    /// A ring of pixels around the centre, unwrapped and correlated along the angle; the centre is carried by the field.
    Ring(RingLimits),
}

/// Radii between which a ring lies; those left out follow from the ball's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RingLimits {
    /// Inner radius, px.
    pub inner_px: Option<f64>,
    /// Outer radius, px; never more than the ball's.
    pub outer_px: Option<f64>,
}

/// What kind of body it is, as far as its motion goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// It spins, and touches the surface at a radius from its centre.
    Ball,
    /// It stays upright and strikes with its end: it has no spin and no radius.
    Rod,
    /// It turns, but where it touches is not known: it has no radius.
    Patch,
}

/// Where the camera looks straight ahead: what comes nearer grows about it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct View {
    /// In the rectified picture, px.
    pub middle_px: [f64; 2],
    /// How well it is known, px.
    pub sigma_px: f64,
}

impl View {
    /// Of pictures of this size: their middle, where nothing else is known.
    pub fn of([width_px, height_px]: [u32; 2], rectifier: Option<&Rectifier>) -> Self {
        let size = [width_px, height_px].map(f64::from);
        let longest_px = size[0].max(size[1]);
        match rectifier {
            None => Self { middle_px: size.map(|length| 0.5 * (length - 1.0)), sigma_px: UNSURE_MIDDLE * longest_px },
            // What leaves a plane that is seen aslant grows about the foot of the camera, wherever that is.
            Some(rectifier) if rectifier.mm_per_px().is_some() => {
                Self { middle_px: rectifier.middle_px(), sigma_px: longest_px }
            }
            Some(rectifier) => Self { middle_px: rectifier.middle_px(), sigma_px: CALIBRATED_MIDDLE * longest_px },
        }
    }
}

/// Everything the motion of a body is computed with.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionParams {
    /// Pixels to millimetres.
    pub scale: Scale,
    /// From the recorded picture to one without lens and perspective, where the camera was calibrated; scale, surface and
    /// gravity are those of that picture.
    pub rectifier: Option<Rectifier>,
    /// Where the camera looks straight ahead.
    pub view: View,
    /// Direction of the struck surface's tangent, counter-clockwise from x, deg.
    pub surface_angle_deg: f64,
    /// Strength of gravity, m/s^2; 0 switches it off.
    pub gravity_m_s2: f64,
    /// Direction in which things fall, counter-clockwise from x (y up), deg; -90 for a level camera.
    pub gravity_angle_deg: f64,
    /// Frames the local velocity fit spans, odd; `None` lets the fit choose.
    pub window_frames: Option<u32>,
    /// Order of the local fit to the positions: 1 to 4.
    pub order: u32,
    /// Mass of the body, kg, where it is known.
    pub mass_kg: Option<f64>,
    /// Whether it is a ball or a rod.
    pub form: Form,
    /// The interval each step was measured over, frames; the shortest of several.
    pub interval_frames: u32,
    /// Noise of a step that the next step does not take back.
    pub walk: Walk,
    /// Over how many frames motion is measured.
    pub spans: Spans,
    /// How long a frame was exposed, ns; what a frame shows is the moment half of it after its stamp. 0 when unknown.
    pub exposure_ns: f64,
    /// When the rows of a frame were exposed.
    pub shutter: Shutter,
    /// Nominal time from frame to frame, ns; only for gaps, times come from the stamps.
    pub frame_period_ns: f64,
}

impl MotionParams {
    /// What was measured in the recorded picture, as the rectified one shows it; without numbers beyond the calibration.
    pub fn rectified(&self, step: &BodyStep) -> BodyStep {
        let Some(rectifier) = &self.rectifier else { return *step };
        rectifier.step(step, self.form == Form::Ball).unwrap_or(BodyStep {
            circle: None,
            rod: None,
            step: None,
            ..*step
        })
    }

    /// Where a centre in the rectified picture lies in the recorded one.
    pub fn recorded(&self, center: Center) -> Option<Center> {
        let Some(rectifier) = &self.rectifier else { return Some(center) };
        let [x_px, y_px] = rectifier.pixel([center.x_px, center.y_px])?;
        Some(Center { x_px, y_px, ..center })
    }
}
