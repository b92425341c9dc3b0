//! The places and shapes of subsets: grids, regions, patches, masks, warps.

pub mod grid;
mod mask;
mod patch;
mod point;
mod region;
mod shape;
mod warp;

pub use grid::GridPoint;
pub(in crate::dic) use mask::{Block, SubsetMask};
pub use patch::Patch;
pub use point::Point;
pub(in crate::dic) use point::{Pixel, Size};
pub use region::Region;
pub use shape::{Shape, WindowShape};
pub use warp::PlanarMotion;
pub(in crate::dic) use warp::{Second, Warp};
