//! Sizes and rates a driver offers.

use super::sys;
use std::fmt;

/// Longest list that is read: drivers are made by others and may never end one.
pub(super) const LIST_MAX: u32 = 256;

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

    /// A size of the list or the range, for what depends on one.
    pub(super) fn any(&self) -> Option<(u32, u32)> {
        match self {
            Self::List(sizes) => sizes.first().copied(),
            Self::Range([_, most, _]) => Some(*most),
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
    fn sizes_and_rates_read_as_a_person_writes_them() {
        assert_eq!(Sizes::List(vec![(640, 480), (320, 240)]).to_string(), "640x480, 320x240");
        assert_eq!(Sizes::Range([(2, 1), (8192, 8192), (2, 1)]).to_string(), "2x1 to 8192x8192 in steps of 2x1");
        assert_eq!(Rates::List(vec![29.970_029_97, 15.0]).to_string(), "29.97, 15");
        assert_eq!(Rates::Range(1.0, 1000.0).to_string(), "1 to 1000");
        assert_eq!(Rates::List(Vec::new()).to_string(), "not told");
    }
}
