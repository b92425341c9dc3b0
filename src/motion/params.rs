//! What the motion of a body is computed with.

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

/// `walk_share` of steps measured from frame to frame.
///
/// Positions are sums of steps, and every step is measured over subsets of its own: a little of its error is not that
/// of the frames it shares with its neighbours, and adds up. On rendered balls successive steps correlate by -0.47
/// instead of -0.5, at noise of 0.5 to 4 grey levels. Over a flight of 40 frames this makes up nearly all of the
/// velocity's uncertainty.
pub const PAIRWISE_WALK_SHARE: f64 = 0.36;

/// Everything the motion of a body is computed with.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionParams {
    /// Pixels to millimetres.
    pub scale: Scale,
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
    /// The interval each step was measured over, frames.
    pub interval_frames: u32,
    /// Noise of a step that the next step does not take back, as a share of the white noise of a pose.
    pub walk_share: f64,
    /// How long a frame was exposed, ns; what a frame shows is the moment half of it after its stamp. 0 when unknown.
    pub exposure_ns: f64,
    /// Nominal time from frame to frame, ns; only for gaps, times come from the stamps.
    pub frame_period_ns: f64,
}
