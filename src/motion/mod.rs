//! From displacements in pixels to velocities in metres per second.
//!
//! The only place where y turns from down to up.

mod params;

pub use params::{MotionParams, Scale};
