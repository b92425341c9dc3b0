//! How fast a body moves and turns.

use super::{Phase, PointStatus, RigidStep};

/// Smoothed physical velocity of one body at one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyVelocity {
    /// Along x (right), m/s.
    pub vx_m_s: f64,
    /// Along y (**up**), m/s.
    pub vy_m_s: f64,
    /// Along the outward normal of the struck surface, m/s.
    pub vn_m_s: f64,
    /// Along the surface's tangent, m/s.
    pub vt_m_s: f64,
    /// Spin, counter-clockwise positive, rad/s.
    pub omega_rad_s: f64,
    /// Standard uncertainty of each velocity component, m/s.
    pub sigma_v_m_s: f64,
    /// Standard uncertainty of the spin, rad/s.
    pub sigma_omega_rad_s: f64,
    /// Frames the local fit spanned.
    pub window_frames: u32,
    /// Order of the polynomial fitted to the positions.
    pub order: u32,
}

/// One row of the `velocity` table: one body in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocitySample {
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
    /// Radius, px.
    pub radius_px: Option<f64>,
    /// Unsmoothed motion from this frame to the next.
    pub step: Option<RigidStep>,
    /// Smoothed physical velocity.
    pub velocity: Option<BodyVelocity>,
    /// Share of the body that is not hidden, 0 to 1.
    pub visible_fraction: Option<f64>,
    /// Flight, contact or rebound, as known when the sample was published.
    pub phase: Phase,
    /// What became of it.
    pub status: PointStatus,
}
