//! The places and shapes of subsets: grids, regions, patches, masks, warps.

pub mod grid;
mod mask;
mod patch;
mod region;
mod shape;
mod warp;

pub use grid::GridPoint;
pub(in crate::dic) use mask::{Block, SubsetMask};
pub use patch::Patch;
pub use region::Region;
pub use shape::{Shape, WindowShape};
pub(in crate::dic) use warp::{Second, Warp};
