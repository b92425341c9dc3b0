//! Digital image correlation: how far each subset of an image moved.

mod params;

pub use params::{CorrelationParams, Method, Shape, WindowShape};
