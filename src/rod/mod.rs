//! Rods: the edges of their tapes, their sides and their tilt in one image.
//!
//! An upright rod carries two tapes, one of them speckled. [`projections`] computes the row and column sums of the binary
//! image (Eq. 5 of the paper), which give its edges to whole pixels. [`RodFinder`] starts from these and fits a blurred
//! step to the grey levels, which gives the edges to some thousandths of a pixel.

mod axis;
mod cylinder;
mod dark_sides;
mod edge_fit;
mod edge_lines;
mod edge_model;
mod edge_offsets;
mod finder;
mod level_grid;
mod observation;
mod paint_levels;
mod paint_shading;
mod params;
mod profiles;
pub mod projections;
mod shading;
mod side_levels;
mod side_paints;
mod tape_light;
mod texture;

pub use finder::RodFinder;
pub use observation::{RodObservation, TapeBounds};
pub use params::{MIN_WIDTH_PX, RodError, RodParams};
