//! Frame sizes and rates that a driver lists.

use super::sys;
use std::fmt;

/// Maximum length of a driver's lists, since a faulty driver may never end one.
pub(super) const MAX_LIST: u32 = 256;

/// Maximum relative difference between a rate and its read-back.
const MAX_RATE_ROUNDING: f64 = 0.001;

/// Width and height of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameSize {
    /// Width, px.
    pub width_px: u32,
    /// Height, px.
    pub height_px: u32,
}

/// The frame sizes of a pixel format.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Sizes {
    /// Single sizes; empty if the driver lists none.
    List(Vec<FrameSize>),
    /// All sizes from `min` to `max` in steps of `step`.
    Range {
        /// Minimum.
        min: FrameSize,
        /// Maximum.
        max: FrameSize,
        /// Increment from the minimum.
        step: FrameSize,
    },
}

/// The frame rates of a pixel format and size.
#[derive(Debug, Clone, PartialEq)]
pub enum Rates {
    /// Single rates, Hz; empty if the driver lists none.
    List(Vec<f64>),
    /// All rates from the first to the second, Hz.
    Range(f64, f64),
}

impl Sizes {
    /// Reads a driver's list: single sizes, or one range. An increment of 0 counts as 1.
    pub(super) fn from_list(list: impl Iterator<Item = sys::v4l2_frmsizeenum>) -> Self {
        let mut sizes = Vec::new();
        for raw in list {
            // SAFETY: `type_` says which member the kernel filled in; both are plain numbers.
            let (one, range) = unsafe { (raw.__bindgen_anon_1.discrete, raw.__bindgen_anon_1.stepwise) };
            if raw.type_ == sys::V4L2_FRMSIZE_TYPE_DISCRETE {
                sizes.push(FrameSize { width_px: one.width, height_px: one.height });
                continue;
            }
            return Self::Range {
                min: FrameSize { width_px: range.min_width, height_px: range.min_height },
                max: FrameSize { width_px: range.max_width, height_px: range.max_height },
                step: FrameSize { width_px: range.step_width.max(1), height_px: range.step_height.max(1) },
            };
        }
        Self::List(sizes)
    }

    /// Returns the sizes of the list, or the ends of the range.
    pub(super) fn listed(&self) -> Vec<FrameSize> {
        match self {
            Self::List(sizes) => sizes.clone(),
            Self::Range { min, max, .. } => vec![*min, *max],
        }
    }

    /// Whether this size is supported, or may be because the driver lists none.
    pub(super) fn may_include(&self, size: FrameSize) -> bool {
        match self {
            Self::List(sizes) => sizes.is_empty() || sizes.contains(&size),
            Self::Range { min, max, step } => {
                let fits = |side: fn(&FrameSize) -> u32| {
                    let (value, min, max) = (side(&size), side(min), side(max));
                    (min..=max).contains(&value) && (value - min).is_multiple_of(side(step))
                };
                fits(|size| size.width_px) && fits(|size| size.height_px)
            }
        }
    }
}

impl Rates {
    /// Reads a driver's list of frame intervals, single ones or one range, and returns their rates.
    pub(super) fn from_list(list: impl Iterator<Item = sys::v4l2_frmivalenum>) -> Self {
        let mut rates = Vec::new();
        for raw in list {
            // SAFETY: as in `Sizes::from_list`.
            let (one, range) = unsafe { (raw.__bindgen_anon_1.discrete, raw.__bindgen_anon_1.stepwise) };
            if raw.type_ == sys::V4L2_FRMIVAL_TYPE_DISCRETE {
                rates.push(rate_hz(one));
                continue;
            }
            return Self::Range(rate_hz(range.max), rate_hz(range.min));
        }
        Self::List(rates)
    }

    /// Whether this rate, Hz, is supported up to the rounding of its fraction, or may be because the driver lists none.
    pub(super) fn may_include(&self, rate_hz: f64) -> bool {
        match self {
            Self::List(rates) => rates.is_empty() || rates.iter().any(|rate| is_same_rate(rate_hz, *rate)),
            Self::Range(min, max) => {
                (*min..=*max).contains(&rate_hz) || is_same_rate(rate_hz, *min) || is_same_rate(rate_hz, *max)
            }
        }
    }
}

/// Whether a rate that was read back equals the requested one to within [`MAX_RATE_ROUNDING`] of it.
pub(super) fn is_same_rate(wanted_hz: f64, kept_hz: f64) -> bool {
    (wanted_hz - kept_hz).abs() <= MAX_RATE_ROUNDING * wanted_hz
}

/// Returns the frame rate of a frame interval, s, in Hz; 0 for an interval with the numerator 0.
pub(super) fn rate_hz(interval: sys::v4l2_fract) -> f64 {
    if interval.numerator == 0 { 0.0 } else { f64::from(interval.denominator) / f64::from(interval.numerator) }
}

/// Returns the frame interval of a rate, s, as a fraction of two 32-bit numbers.
///
/// It has the first of four usual numerators that represents the rate to within 1e-6 of it, else a large one.
pub(super) fn interval_of_rate(rate_hz: f64) -> sys::v4l2_fract {
    // Film and television rates are exact only over 1001.
    let numerators = [1, 1001, 1000, 1_000_000];
    let fits = |numerator: &u32| {
        let denominator = rate_hz * f64::from(*numerator);
        let rounding = (denominator - denominator.round()).abs();
        denominator.round() >= 1.0 && denominator < f64::from(u32::MAX) && rounding <= 1e-6 * denominator
    };
    let numerator = numerators.iter().copied().find(fits).unwrap_or(if rate_hz < 4000.0 { 1_000_000 } else { 1000 });
    sys::v4l2_fract { numerator, denominator: (rate_hz * f64::from(numerator)).round() as u32 }
}

impl fmt::Display for FrameSize {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}x{}", self.width_px, self.height_px)
    }
}

impl fmt::Display for Sizes {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::List(sizes) => write_list(formatter, sizes),
            Self::Range { min, max, step: FrameSize { width_px: 1, height_px: 1 } } => {
                write!(formatter, "{min} to {max}")
            }
            Self::Range { min, max, step } => write!(formatter, "{min} to {max} in steps of {step}"),
        }
    }
}

impl fmt::Display for Rates {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let round = |rate: f64| (rate * 1000.0).round() / 1000.0;
        match self {
            Self::List(rates) => write_list(formatter, &rates.iter().map(|rate| round(*rate)).collect::<Vec<_>>()),
            Self::Range(min, max) => write!(formatter, "{} to {}", round(*min), round(*max)),
        }
    }
}

/// Writes the entries of a list, separated by commas; `not listed` for an empty one.
fn write_list(formatter: &mut fmt::Formatter<'_>, list: &[impl fmt::Display]) -> fmt::Result {
    if list.is_empty() {
        return write!(formatter, "not listed");
    }
    let entries: Vec<_> = list.iter().map(ToString::to_string).collect();
    write!(formatter, "{}", entries.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn size(width_px: u32, height_px: u32) -> FrameSize {
        FrameSize { width_px, height_px }
    }

    fn range(min: FrameSize, max: FrameSize, step: FrameSize) -> Sizes {
        Sizes::Range { min, max, step }
    }

    #[test]
    fn a_rate_becomes_the_fraction_drivers_list() {
        let fraction = |rate_hz| {
            let interval = interval_of_rate(rate_hz);
            (interval.numerator, interval.denominator)
        };
        assert_eq!(fraction(60.0), (1, 60));
        assert_eq!(fraction(30_000.0 / 1001.0), (1001, 30_000));
        assert_eq!(fraction(7.5), (1000, 7500));
        assert_eq!(fraction(200_000.0), (1, 200_000));
        assert_eq!(fraction(0.25), (1000, 250));
    }

    #[test]
    fn every_rate_up_to_a_million_survives_as_a_fraction_to_a_ten_thousandth() {
        for step in 1..2000_u32 {
            let rate = 1.01_f64.powi(step.cast_signed()) * 0.01;
            if rate > 1e6 {
                break;
            }
            let back = rate_hz(interval_of_rate(rate));
            assert!((back - rate).abs() <= 1e-4 * rate, "{rate} Hz became {back} Hz");
        }
    }

    #[test]
    fn a_size_or_a_rate_is_supported_when_it_is_listed_or_nothing_is() {
        let list = Sizes::List(vec![size(640, 480)]);
        assert!(list.may_include(size(640, 480)) && !list.may_include(size(640, 481)));
        assert!(Sizes::List(Vec::new()).may_include(size(1, 1)));
        let range = range(size(16, 16), size(64, 32), size(8, 1));
        assert!(range.may_include(size(24, 31)));
        assert!(!range.may_include(size(25, 31)) && !range.may_include(size(72, 31)));
        assert!(Rates::List(vec![29.97]).may_include(29.970_03) && !Rates::List(vec![29.97]).may_include(30.0));
        assert!(Rates::Range(1.0, 60.0).may_include(60.000_01) && !Rates::Range(1.0, 60.0).may_include(61.0));
    }

    #[test]
    fn sizes_and_rates_read_as_a_person_writes_them() {
        assert_eq!(Sizes::List(vec![size(640, 480), size(320, 240)]).to_string(), "640x480, 320x240");
        let range = range(size(2, 1), size(8192, 8192), size(2, 1));
        assert_eq!(range.to_string(), "2x1 to 8192x8192 in steps of 2x1");
        assert_eq!(Rates::List(vec![29.970_029_97, 15.0]).to_string(), "29.97, 15");
        assert_eq!(Rates::Range(1.0, 1000.0).to_string(), "1 to 1000");
        assert_eq!(Rates::List(Vec::new()).to_string(), "not listed");
    }
}
