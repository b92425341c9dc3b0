//! Rods.

use super::{Estimate, PointStatus};

/// The maximum number of tracked edges of a rod: those of two tapes.
///
/// # Examples
///
/// ```
/// use ricochet::results::ROD_EDGES;
/// # use ricochet::results::{Estimate, PointStatus, Rod, RodEdge};
/// # let estimate = |value| Estimate { value, sigma: 0.02 };
/// # let edge = RodEdge { y_px: Some(estimate(80.0)), status: PointStatus::Valid };
/// # let occluded = RodEdge { y_px: None, status: PointStatus::Occluded };
/// # let edges = [Some(edge), Some(occluded), None, None];
/// # let (x_px, y_px, half_width_px, tilt_deg) = (estimate(128.0), estimate(90.0), estimate(20.5), estimate(1.5));
/// # let rod = Rod { x_px, y_px, half_width_px, tilt_deg, edges };
///
/// let tracked = rod.edges.iter().flatten().count();
/// assert!(tracked <= ROD_EDGES);
/// ```
pub const ROD_EDGES: usize = 4;

/// An edge of a tape, across the rod.
///
/// # Examples
///
/// ```
/// # use ricochet::results::{Estimate, PointStatus, Rod, RodEdge};
/// # let estimate = |value| Estimate { value, sigma: 0.02 };
/// # let edge = RodEdge { y_px: Some(estimate(80.0)), status: PointStatus::Valid };
/// # let occluded = RodEdge { y_px: None, status: PointStatus::Occluded };
/// # let edges = [Some(edge), Some(occluded), None, None];
/// # let (x_px, y_px, half_width_px, tilt_deg) = (estimate(128.0), estimate(90.0), estimate(20.5), estimate(1.5));
/// # let rod = Rod { x_px, y_px, half_width_px, tilt_deg, edges };
/// for edge in rod.edges.into_iter().flatten() {
///     match edge.y_px {
///         Some(y) => println!("{} +- {} px", y.value, y.sigma),
///         // An edge that something covers has no position.
///         None => assert_eq!(edge.status, PointStatus::Occluded),
///     }
/// }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RodEdge {
    /// The position where it crosses the middle of the rod, px (down); `None` for the reason in `status`.
    pub y_px: Option<Estimate>,
    /// The status of the edge.
    pub status: PointStatus,
}

/// An upright rod with tapes around it, in one frame.
///
/// # Examples
///
/// ```
/// # use ricochet::results::{Estimate, PointStatus, Rod, RodEdge};
/// # let estimate = |value| Estimate { value, sigma: 0.02 };
/// # let edge = RodEdge { y_px: Some(estimate(80.0)), status: PointStatus::Valid };
/// # let occluded = RodEdge { y_px: None, status: PointStatus::Occluded };
/// # let edges = [Some(edge), Some(occluded), None, None];
/// # let (x_px, y_px, half_width_px, tilt_deg) = (estimate(128.0), estimate(90.0), estimate(20.5), estimate(1.5));
/// # let rod = Rod { x_px, y_px, half_width_px, tilt_deg, edges };
/// // Positions are in px with y down.
/// assert_eq!((rod.x_px.value, rod.y_px.value), (128.0, 90.0));
/// let width_px = 2.0 * rod.half_width_px.value;
/// assert_eq!(width_px, 41.0);
/// // Two edges are tracked, one of them is visible.
/// let visible = rod.edges.iter().flatten().filter(|edge| edge.y_px.is_some()).count();
/// assert_eq!((rod.edges.iter().flatten().count(), visible), (2, 1));
/// ```
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
