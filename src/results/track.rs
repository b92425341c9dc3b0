//! Where a body is.

use super::{PointStatus, Rod};

/// One body's place in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackSample {
    /// Sequence number of the frame.
    pub frame: u64,
    /// Index of the body in the configuration.
    pub body: u32,
    /// Exposure start, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Centre, px.
    pub center_x_px: Option<f64>,
    /// Centre, px (down).
    pub center_y_px: Option<f64>,
    /// Turned since the body's first frame, counter-clockwise on the screen, deg.
    pub angle_deg: Option<f64>,
    /// Radius, px.
    pub radius_px: Option<f64>,
    /// Standard uncertainty of each centre coordinate, px.
    pub sigma_center_px: Option<f64>,
    /// Standard uncertainty of the angle, deg.
    pub sigma_angle_deg: Option<f64>,
    /// Share of the body that is not hidden, 0 to 1.
    pub visible_fraction: Option<f64>,
    /// The rod, where the body is one.
    pub rod: Option<Rod>,
    /// What became of it.
    pub status: PointStatus,
}
