//! Balls: their outline, centre and radius in one image.

mod chance;
mod circle;
mod coarse;
mod edge;
mod finder;
mod gates;
mod harmonic;
mod light;
mod limb;
mod marked;
mod params;
mod rays;
mod refine;
mod rim;
mod shrink;
mod visible;

pub use finder::BallFinder;
pub use params::{BallError, BallParams, OutlineMethod};

/// The brightness of a ball relative to its background.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Polarity {
    Brighter,
    Darker,
}
