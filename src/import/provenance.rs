//! The statements of a file about its frames, in one line.

use super::Orientation;
use super::rate::RateSource;
use super::timeline::Gaps;
use crate::image::PixelFormat;
use std::fmt;

/// The statements of a file about its frames, and their use.
///
/// [`fmt::Display`] prints it in one line.
#[derive(Debug, Clone, PartialEq)]
pub struct Provenance {
    /// Source of the frame rate.
    pub rate: RateSource,
    /// Number of missing frames.
    pub missing: u64,
    /// Number of places where frames are missing.
    pub gaps: u64,
    /// The symmetry from the stored image to the displayed one.
    pub orientation: Orientation,
    /// Width of a stored pixel over its height. Frames whose pixels are not square are resampled.
    pub pixel_aspect: f64,
    /// Significant bits of a grey level.
    pub bits: u32,
    /// The rule that makes grey levels of the stored ones; empty for a grey film.
    pub grey_rule: String,
}

impl Provenance {
    /// Returns the provenance of frames that are stored as they are displayed, in grey and with square pixels.
    pub(super) fn new(rate: RateSource, gaps: Gaps, format: PixelFormat) -> Self {
        Self {
            rate,
            missing: gaps.missing,
            gaps: gaps.places,
            orientation: Orientation::AS_STORED,
            pixel_aspect: 1.0,
            bits: format.bits(),
            grey_rule: String::new(),
        }
    }
}

impl fmt::Display for Provenance {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}, ", self.rate)?;
        match (self.missing, self.gaps) {
            (0, _) => formatter.write_str("no gaps")?,
            (missing, 1) => write!(formatter, "{missing} frames missing in 1 place")?,
            (missing, gaps) => write!(formatter, "{missing} frames missing in {gaps} places")?,
        }
        write!(formatter, ", {}, ", self.orientation)?;
        match (self.pixel_aspect - 1.0).abs() < 1e-6 {
            true => formatter.write_str("square pixels")?,
            false => write!(formatter, "pixels of {:.4} : 1 made square", self.pixel_aspect)?,
        }
        write!(formatter, ", {} bit", self.bits)?;
        match self.grey_rule.is_empty() {
            true => formatter.write_str(" grey"),
            false => write!(formatter, " grey from {}", self.grey_rule),
        }
    }
}
