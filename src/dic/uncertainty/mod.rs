//! The standard uncertainty of a displacement: image noise, gradients, patterns fixed to the sensor.

mod fixed_pattern;
mod gradient_gain;
mod noise;

pub use fixed_pattern::FixedPattern;
pub(in crate::dic) use gradient_gain::Sharpness;
pub(in crate::dic) use noise::{Factor, Fit, Lags, POOLED, Pool, ROUNDING, Slopes, pairs_of};
