//! Rods: the edges of their tapes, their sides and their tilt in one image.
//!
//! An upright rod with two tapes around it, one of them speckled. [`sums`] holds
//! the black-and-white row and column sums of the method's Eq. 5, which give its
//! edges to whole pixels; [`RodFinder`] starts from them and fits a blurred step
//! to the grey levels, which gives the same edges to some thousandths.

mod axis;
mod edge;
mod finder;
mod light;
mod outline;
mod params;
mod sight;
pub mod sums;

pub use finder::RodFinder;
pub use outline::{Segment, segments};
pub use params::{LEAST_WIDTH_PX, RodError, RodParams};
pub use sight::Sight;
