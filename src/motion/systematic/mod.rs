//! Systematic errors of a motion, one file a correction: rotation and translation out of the plane, rolling shutter,
//! patterns fixed to the sensor.

mod cumulative;
mod fixed_pattern;
mod out_of_plane_rotation;
mod out_of_plane_translation;
mod rolling_shutter;
mod rotation_prior;

pub use cumulative::Sums;
pub use fixed_pattern::{RunningShare, Shortening, Spans};
pub use out_of_plane_rotation::{Drift, Here};
pub use out_of_plane_translation::{Growth, Seen, surely};
pub use rolling_shutter::{Rolling, Shutter};
