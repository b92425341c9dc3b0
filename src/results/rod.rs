//! Rods.

use super::{Estimate, PointStatus};

/// The maximum number of tracked edges of a rod: those of two tapes.
pub const ROD_EDGES: usize = 4;

/// An edge of a tape, across the rod.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RodEdge {
    /// The position where it crosses the middle of the rod, px (down); `None` for the reason in `status`.
    pub y_px: Option<Estimate>,
    /// The status of the edge.
    pub status: PointStatus,
}

/// An upright rod with tapes around it, in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rod {
    /// The middle between its sides, at the height of `y_px`, px.
    pub x_px: Estimate,
    /// A point that moves with it, px: the middle of the speckled tape, or of all edges if that tape shows only one.
    pub y_px: Estimate,
    /// Half of the distance between its sides, px.
    pub half_width_px: Estimate,
    /// The tilt from upright, counter-clockwise on the screen, deg.
    pub tilt_deg: Estimate,
    /// The tracked edges, from the top downwards; `None` beyond their number.
    pub edges: [Option<RodEdge>; ROD_EDGES],
}
