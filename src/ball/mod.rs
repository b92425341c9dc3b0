//! Balls: their outline, centre and radius in one image.

mod params;

pub use params::BallParams;
