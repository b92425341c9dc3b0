//! Systematic errors of a motion, one file a correction: rotation and translation out of the plane, rolling shutter,
//! patterns fixed to the sensor.

mod cumulative;
mod fixed_pattern;
mod out_of_plane_rotation;
mod out_of_plane_translation;
mod rolling_shutter;
mod rotation_prior;

pub use cumulative::CumulativeSums;
pub use fixed_pattern::{Intervals, PlanarRates, RunningBias, SpeedBias};
pub use out_of_plane_rotation::{LocalDrift, OutlineDrift};
pub use out_of_plane_translation::{SizeChange, ViewPosition, shrink_insignificant};
pub use rolling_shutter::RollingShutter;
