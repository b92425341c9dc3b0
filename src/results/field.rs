//! Displacement fields.

use super::PointStatus;

/// How far one point moved, with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displacement {
    /// Along x (right), px.
    pub u_px: f32,
    /// Along y (down), px.
    pub v_px: f32,
    /// Standard uncertainty of `u_px`, px.
    pub sigma_u_px: f32,
    /// Standard uncertainty of `v_px`, px.
    pub sigma_v_px: f32,
}

/// One subset's answer: where it was in the reference and how far it moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldPoint {
    /// Subset centre in the reference frame, px.
    pub x_px: f32,
    /// Subset centre in the reference frame, px.
    pub y_px: f32,
    /// The displacement to the target frame; `None` where `status` says why.
    pub displacement: Option<Displacement>,
    /// Zero-mean normalised cross-correlation at the answer, -1 to 1.
    pub zncc: Option<f32>,
    /// Highest correlation peak over the second highest.
    pub peak_ratio: Option<f32>,
    /// What became of it.
    pub status: PointStatus,
}

/// The displacement field of one body from one frame to a later one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PairField {
    /// Sequence number of the reference frame.
    pub frame: u64,
    /// Sequence number of the target frame.
    pub target_frame: u64,
    /// Exposure start of the reference frame, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Index of the body in the configuration.
    pub body: u32,
    /// The subsets, row by row.
    pub points: Vec<FieldPoint>,
}
