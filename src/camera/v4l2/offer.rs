//! Sizes and rates a driver offers.

use super::sys;
use std::fmt;

/// Longest list that is read: drivers are made by others and may never end one.
pub(super) const LIST_MAX: u32 = 256;

/// A rate read back this near, relative, is the one that was set.
const RATE_ROUNDING: f64 = 0.001;

/// Sizes of pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Sizes {
    /// These (width, height), px; empty when the driver does not say.
    List(Vec<(u32, u32)>),
    /// From the first to the second (width, height) in steps of the third, px.
    Range([(u32, u32); 3]),
}

/// Rates of frames.
#[derive(Debug, Clone, PartialEq)]
pub enum Rates {
    /// These, Hz; empty when the driver does not say.
    List(Vec<f64>),
    /// From the first to the second, Hz.
    Range(f64, f64),
}

impl Sizes {
    pub(super) fn from_list(list: impl Iterator<Item = sys::v4l2_frmsizeenum>) -> Self {
        let mut sizes = Vec::new();
        for raw in list {
            // SAFETY: `type_` says which member the kernel filled in; both are plain numbers.
            let (one, range) = unsafe { (raw.__bindgen_anon_1.discrete, raw.__bindgen_anon_1.stepwise) };
            if raw.type_ == sys::V4L2_FRMSIZE_TYPE_DISCRETE {
                sizes.push((one.width, one.height));
                continue;
            }
            let (least, most) = ((range.min_width, range.min_height), (range.max_width, range.max_height));
            return Self::Range([least, most, (range.step_width.max(1), range.step_height.max(1))]);
        }
        Self::List(sizes)
    }

    /// The sizes of the list, or the ends of the range: those for which rates are asked.
    pub(super) fn told(&self) -> Vec<(u32, u32)> {
        match self {
            Self::List(sizes) => sizes.clone(),
            Self::Range([least, most, _]) => vec![*least, *most],
        }
    }

    /// Whether this size is among them, or may be because the driver does not say.
    pub(super) fn may_be(&self, size: (u32, u32)) -> bool {
        match self {
            Self::List(sizes) => sizes.is_empty() || sizes.contains(&size),
            Self::Range([least, most, step]) => {
                let fits = |value: u32, least: u32, most: u32, step: u32| {
                    (least..=most).contains(&value) && (value - least).is_multiple_of(step)
                };
                fits(size.0, least.0, most.0, step.0) && fits(size.1, least.1, most.1, step.1)
            }
        }
    }
}

impl Rates {
    pub(super) fn from_list(list: impl Iterator<Item = sys::v4l2_frmivalenum>) -> Self {
        let mut rates = Vec::new();
        for raw in list {
            // SAFETY: as in `Sizes::from_list`.
            let (one, range) = unsafe { (raw.__bindgen_anon_1.discrete, raw.__bindgen_anon_1.stepwise) };
            if raw.type_ == sys::V4L2_FRMIVAL_TYPE_DISCRETE {
                rates.push(rate_hz((one.numerator, one.denominator)));
                continue;
            }
            let rate = |interval: sys::v4l2_fract| rate_hz((interval.numerator, interval.denominator));
            return Self::Range(rate(range.max), rate(range.min));
        }
        Self::List(rates)
    }

    /// Whether this rate is among them, or may be because the driver does not say.
    pub(super) fn may_be(&self, rate_hz: f64) -> bool {
        match self {
            Self::List(rates) => rates.is_empty() || rates.iter().any(|rate| is_rate(rate_hz, *rate)),
            Self::Range(least, most) => {
                (*least..=*most).contains(&rate_hz) || is_rate(rate_hz, *least) || is_rate(rate_hz, *most)
            }
        }
    }
}

/// Whether a rate is the one that was wanted, but for what is lost in a fraction.
pub(super) fn is_rate(wanted_hz: f64, kept_hz: f64) -> bool {
    (wanted_hz - kept_hz).abs() <= RATE_ROUNDING * wanted_hz
}

/// Frames a second of an interval given as a fraction of a second; 0 for no interval.
pub(super) fn rate_hz((numerator, denominator): (u32, u32)) -> f64 {
    if numerator == 0 { 0.0 } else { f64::from(denominator) / f64::from(numerator) }
}

/// The interval of a rate, as a fraction a driver can hold.
pub(super) fn interval_of_rate(rate_hz: f64) -> (u32, u32) {
    // Film and television rates are exact only over 1001.
    let numerators = [1, 1001, 1000, 1_000_000];
    let fits = |numerator: &u32| {
        let denominator = rate_hz * f64::from(*numerator);
        let off = (denominator - denominator.round()).abs();
        denominator.round() >= 1.0 && denominator < f64::from(u32::MAX) && off <= 1e-6 * denominator
    };
    let numerator = numerators.iter().copied().find(fits).unwrap_or(if rate_hz < 4000.0 { 1_000_000 } else { 1000 });
    (numerator, (rate_hz * f64::from(numerator)).round() as u32)
}

impl fmt::Display for Sizes {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::List(sizes) if sizes.is_empty() => write!(formatter, "not told"),
            Self::List(sizes) => {
                let words: Vec<_> = sizes.iter().map(|(width, height)| format!("{width}x{height}")).collect();
                write!(formatter, "{}", words.join(", "))
            }
            Self::Range([least, most, step]) => {
                write!(formatter, "{}x{} to {}x{}", least.0, least.1, most.0, most.1)?;
                if *step == (1, 1) { Ok(()) } else { write!(formatter, " in steps of {}x{}", step.0, step.1) }
            }
        }
    }
}

impl fmt::Display for Rates {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let round = |rate: f64| (rate * 1000.0).round() / 1000.0;
        match self {
            Self::List(rates) if rates.is_empty() => write!(formatter, "not told"),
            Self::List(rates) => {
                let words: Vec<_> = rates.iter().map(|rate| round(*rate).to_string()).collect();
                write!(formatter, "{}", words.join(", "))
            }
            Self::Range(least, most) => write!(formatter, "{} to {}", round(*least), round(*most)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_becomes_the_fraction_drivers_list() {
        assert_eq!(interval_of_rate(60.0), (1, 60));
        assert_eq!(interval_of_rate(30_000.0 / 1001.0), (1001, 30_000));
        assert_eq!(interval_of_rate(7.5), (1000, 7500));
        assert_eq!(interval_of_rate(200_000.0), (1, 200_000));
        assert_eq!(interval_of_rate(0.25), (1000, 250));
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
    fn a_size_or_a_rate_is_there_when_it_is_listed_or_nothing_is() {
        let list = Sizes::List(vec![(640, 480)]);
        assert!(list.may_be((640, 480)) && !list.may_be((640, 481)) && Sizes::List(Vec::new()).may_be((1, 1)));
        let range = Sizes::Range([(16, 16), (64, 32), (8, 1)]);
        assert!(range.may_be((24, 31)) && !range.may_be((25, 31)) && !range.may_be((72, 31)));
        assert!(Rates::List(vec![29.97]).may_be(29.970_03) && !Rates::List(vec![29.97]).may_be(30.0));
        assert!(Rates::Range(1.0, 60.0).may_be(60.000_01) && !Rates::Range(1.0, 60.0).may_be(61.0));
    }

    #[test]
    fn sizes_and_rates_read_as_a_person_writes_them() {
        assert_eq!(Sizes::List(vec![(640, 480), (320, 240)]).to_string(), "640x480, 320x240");
        assert_eq!(Sizes::Range([(2, 1), (8192, 8192), (2, 1)]).to_string(), "2x1 to 8192x8192 in steps of 2x1");
        assert_eq!(Rates::List(vec![29.970_029_97, 15.0]).to_string(), "29.97, 15");
        assert_eq!(Rates::Range(1.0, 1000.0).to_string(), "1 to 1000");
        assert_eq!(Rates::List(Vec::new()).to_string(), "not told");
    }
}
