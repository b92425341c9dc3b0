//! From pixels to the plane of motion: lens distortion, perspective, the edges of a rod.

mod lens;
mod linear_map;
mod rectifier;
mod rod;

pub use lens::{Distortion, Lens};
pub use rectifier::{Calibration, Rectifier, RectifierError};
