//! What the motion of a body is computed with.

use super::{Center, Rectifier};
use crate::results::BodyStep;

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

/// [`WalkShare`] of steps measured from frame to frame.
///
/// Positions are sums of steps, and every step is measured over subsets of its own: a little of its error is not that
/// of the frames it shares with its neighbours, and adds up. On rendered balls successive steps correlate by -0.47
/// instead of -0.5, at noise of 0.5 to 4 grey levels. Over a flight of 40 frames this makes up nearly all of the
/// velocity's uncertainty.
pub const PAIRWISE_WALK_SHARE: f64 = 0.36;

/// [`WalkShare`] of steps that are differences of poses against one reference: 0, but for its renewals.
///
/// Each leaves 0.26 of the white noise of a pose for good, seen on rendered balls over 320 frames at 0 to 1 deg/frame,
/// with 5 to 107 renewals. One every eight frames is assumed: a block has 16 by default, and 3 deg turn a reference
/// stale.
const KEPT_WALK_SHARE: f64 = 0.26 * 0.353_553_39;

/// How far a pose follows the step that led to it over a longer interval, from where shorter steps led: 0 to 1.
///
/// 0 drifts as the shorter steps alone, 1 lets neighbouring frames drift apart; from 0.3 to 0.85 velocities are
/// about equally sure.
pub(super) const TRUST_IN_LONGER: f64 = 0.5;

/// Noise of a step that the next step does not take back, as a share of the white noise of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WalkShare {
    /// Of steps whose subsets are taken from frame to frame.
    pub subsets: f64,
    /// Of steps that match the whole body with a reference that is kept.
    pub whole: f64,
}

impl WalkShare {
    /// That of steps measured over one interval or several at once, the shortest first.
    ///
    /// Sums of steps drift, and each longer interval ties a pose to one further back. With trust g in a step over n
    /// times as many frames, errors of the pose follow E(i) = (1 - g) (E(i-1) + a(i)) + g (E(i-n) + b(i)), whose part
    /// that never fades moves by [(1 - g) a + g b] / [1 - g + g n] a frame; a and b are alike, whatever the interval.
    /// Poses against a kept reference drift less whatever the intervals.
    pub fn of(intervals_frames: &[u32]) -> Self {
        let shortest = intervals_frames.first().map_or(1.0, |interval| f64::from((*interval).max(1)));
        let g = TRUST_IN_LONGER;
        let mut variance = 1.0;
        for interval in intervals_frames.iter().skip(1) {
            let n = f64::from(*interval) / shortest;
            variance = ((1.0 - g).powi(2) * variance + g * g) / (1.0 - g + g * n).powi(2);
        }
        Self { subsets: PAIRWISE_WALK_SHARE * variance.sqrt(), whole: KEPT_WALK_SHARE }
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
    pub walk_share: WalkShare,
    /// How long a frame was exposed, ns; what a frame shows is the moment half of it after its stamp. 0 when unknown.
    pub exposure_ns: f64,
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
