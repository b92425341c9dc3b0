//! Frame rates and their sources.

use super::ImportError;
use std::fmt;
use std::ops::RangeInclusive;
use std::path::Path;

/// Rates of a header that can be meant, frames per second: others are damaged or empty fields.
const RATES_HZ: RangeInclusive<f64> = 1e-3..=1e12;

/// The source of a frame rate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RateSource {
    /// The user.
    Option,
    /// The times that the file stores with each frame.
    FrameTimes,
    /// A field of the file, by its name there.
    Header(String),
    /// The rate at which the film plays, which slow motion does not share with the scene.
    Playback,
}

impl fmt::Display for RateSource {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Option => formatter.write_str("by --fps"),
            Self::FrameTimes => formatter.write_str("by the times of the frames"),
            Self::Header(field) => write!(formatter, "by the file's {field}"),
            Self::Playback => formatter.write_str("of playback"),
        }
    }
}

/// A frame rate and its source.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rate {
    pub(super) hz: f64,
    pub(super) source: RateSource,
}

impl Rate {
    /// Returns the rate that a field of the file states; `None` when it lies outside [`RATES_HZ`].
    pub(super) fn from_header(hz: f64, field: &str) -> Option<Self> {
        RATES_HZ.contains(&hz).then(|| Self { hz, source: RateSource::Header(field.to_owned()) })
    }

    /// Returns the rate of the user, or else that of the file.
    ///
    /// # Errors
    ///
    /// [`ImportError::FrameRate`] when neither states one.
    pub(super) fn known(path: &Path, fps: Option<f64>, from_file: Option<Self>) -> Result<Self, ImportError> {
        fps.map(|hz| Self { hz, source: RateSource::Option }).or(from_file).ok_or_else(|| ImportError::FrameRate {
            reason: format!("{} does not record it; pass --fps", path.display()),
        })
    }
}
