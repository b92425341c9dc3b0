//! Frames prepared for correlation: padding, B-spline interpolation, samples at sub-pixel positions.

mod interpolation;
mod padded_image;
mod prepared_frame;
mod sampler;

pub(in crate::dic) use interpolation::Splined;
pub(in crate::dic) use padded_image::{MARGIN, Plane};
pub use prepared_frame::Prepared;
pub(in crate::dic) use prepared_frame::gain;
pub(in crate::dic) use sampler::{ShiftedColumn, Taps, along, sample_lanes, widened};
