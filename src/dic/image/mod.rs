//! Frames prepared for correlation: padding, B-spline interpolation, samples at sub-pixel positions.

mod interpolation;
mod padded_image;
mod prepared_frame;
mod sampler;
mod scattered;

pub(in crate::dic) use interpolation::InterpolatedImage;
pub use interpolation::Interpolation;
pub(in crate::dic) use padded_image::{MARGIN, PaddedImage};
pub use prepared_frame::PreparedFrame;
pub(in crate::dic) use prepared_frame::relative_gain;
pub(in crate::dic) use sampler::{ShiftedRows, Taps, lane_positions, sample_lanes, widened_weights};
pub(in crate::dic) use scattered::sample_points;
