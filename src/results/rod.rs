//! What is seen of a rod.

use super::{Estimate, PointStatus};

/// Most edges that are followed on a rod: those of two tapes.
pub const ROD_EDGES: usize = 4;

/// An edge of a tape, across the rod.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RodEdge {
    /// Where it crosses the middle of the rod, px (down); `None` where `status` says why.
    pub y_px: Option<Estimate>,
    /// What became of it.
    pub status: PointStatus,
}

/// An upright rod with tapes around it, in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rod {
    /// Middle between its sides, at the height of `y_px`.
    pub x_px: Estimate,
    /// A point that moves with it: the middle of the speckled tape, or of all edges where that tape shows only one.
    pub y_px: Estimate,
    /// Half the distance between its sides.
    pub half_width_px: Estimate,
    /// How far it leans from upright, counter-clockwise on the screen, deg.
    pub tilt_deg: Estimate,
    /// The edges followed, from the top downwards; `None` beyond their number.
    pub edges: [Option<RodEdge>; ROD_EDGES],
}
