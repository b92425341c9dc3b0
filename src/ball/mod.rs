//! Balls: their outline, centre and radius in one image.

mod annulus;
mod boundary;
mod change_search;
mod changed_disc;
mod circle_fit;
mod edge_fit;
mod edge_selection;
mod effort;
mod faint_rim;
mod finder;
mod first_harmonic;
mod foreground;
mod hough;
mod limb_darkening;
mod mirror;
mod paper_hough;
mod params;
mod plain_ground;
mod point;
mod pyramid;
mod ransac;
mod side_light;
mod significance;
mod subpixel_fit;
mod texture_disc;
mod textured;
mod visible_fraction;

pub use finder::BallFinder;
pub use params::{BallError, BallParams, OutlineMethod, Presence};

/// The state of the rim of a ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum RimKind {
    /// Parts of the rim are free of speckles and used alone.
    #[default]
    Clean,
    /// Speckles line the rim, as on a sphere, and all of it is used.
    Speckled,
    /// Light and shade change the contrast along the rim, and its sign, and all of it is used.
    Shaded,
}

/// The brightness of a ball relative to its background.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Polarity {
    Brighter,
    Darker,
}
