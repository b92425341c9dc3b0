//! The paint of a body.

use serde::{Deserialize, Serialize};

/// The paint of a body: round speckles and straight lines, placed at random without overlap, or a regular pattern.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatternSetup {
    /// Minimum area of a speckle, at least 0.5 px^2.
    pub area_min_px2: f64,
    /// Maximum area of a speckle, at most a twentieth of the ball.
    pub area_max_px2: f64,
    /// Covered fraction of the ball, 0 to 0.6.
    pub coverage: f64,
    /// Number of straight lines of random direction, 0 to 20.
    #[serde(default)]
    pub lines: u32,
    /// Width of the lines, 0.5 to 10 px.
    #[serde(default = "default_line_width_px")]
    pub line_width_px: f64,
    /// Arrangement, default `random`.
    #[serde(default)]
    pub layout: Layout,
    /// Number of equal parts of a regular pattern, 1 to 64; default 6.
    #[serde(default = "default_repeats")]
    pub repeats: u32,
}

/// The arrangement of the paint. A regular one looks the same again after a part of a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// Speckles and lines at random.
    #[default]
    Random,
    /// `repeats` parallel stripes over the diameter.
    Stripes,
    /// `repeats` sectors around the middle, as on a beach ball.
    Sectors,
    /// A ring of `repeats` dots, each of `area_max_px2`, at 0.6 of the radius.
    Dots,
    /// Twelve round panels, as on a football, in a random orientation. Spheres only.
    Football,
}

impl Default for PatternSetup {
    fn default() -> Self {
        Self {
            area_min_px2: 2.0,
            area_max_px2: 40.0,
            coverage: 0.45,
            lines: 0,
            line_width_px: default_line_width_px(),
            layout: Layout::Random,
            repeats: default_repeats(),
        }
    }
}

fn default_line_width_px() -> f64 {
    2.0
}

fn default_repeats() -> u32 {
    6
}
