//! The standard uncertainty of a displacement: image noise, gradients, patterns fixed to the sensor.

mod fixed_pattern;
mod gradient_gain;
mod noise;

pub use fixed_pattern::FixedPattern;
pub(in crate::dic) use gradient_gain::GradientGain;
pub(in crate::dic) use noise::{
    GradientNoise, GreyLevelFit, Lags, NoisePool, POOLED, ROUNDING, VarianceFactor, count_pairs,
};
