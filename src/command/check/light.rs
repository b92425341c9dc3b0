//! Detection of flicker in the illumination.

/// Maximum number of frames and of frequencies in the search.
const MAX_FRAMES: usize = 2048;
const MAX_FREQUENCIES: usize = 1024;
/// Minimum relative amplitude for which a frequency is reported.
const MIN_AMPLITUDE: f64 = 0.003;
/// Minimum fraction of the amplitude at that frequency.
const MIN_EXPLAINED: f64 = 0.7;
/// Minimum number of observed periods.
const MIN_PERIODS: f64 = 1.5;

/// The flicker of the illumination.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Flicker {
    /// Half of the difference between the brightest and the darkest frame, relative to the mean.
    pub(super) share: f64,
    /// The frequency, Hz, if it can be determined.
    pub(super) frequency_hz: Option<f64>,
    /// The observation time, s.
    pub(super) seen_s: f64,
}

/// Estimates the flicker from times (s) and mean grey levels; returns `None` for fewer than three frames or black
/// ones.
pub(super) fn estimate_flicker(means: &[(f64, f64)]) -> Option<Flicker> {
    let mean = means.iter().map(|(_, level)| level).sum::<f64>() / means.len() as f64;
    if means.len() < 3 || mean <= 0.0 {
        return None;
    }
    let (low, high) = means.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), (_, v)| (low.min(*v), high.max(*v)));
    let share = 0.5 * (high - low) / mean;
    let seen_s = means[means.len() - 1].0 - means[0].0;
    let frequency_hz =
        (share > MIN_AMPLITUDE && seen_s > 0.0).then(|| strongest_frequency_hz(means, mean, share)).flatten();
    Some(Flicker { share, frequency_hz, seen_s })
}

/// Returns the frequency of the strongest oscillation, Hz, from one and a half periods up to half the frame rate.
///
/// It is the maximum of the Fourier transform at the given times, over at most [`MAX_FREQUENCIES`] frequencies a
/// quarter of the inverse duration apart, or farther. `share` is half of the range of the levels relative to their
/// `mean`. `None` for a slow drift, or if no single frequency explains most of it.
fn strongest_frequency_hz(means: &[(f64, f64)], mean: f64, share: f64) -> Option<f64> {
    let means = &means[..means.len().min(MAX_FRAMES)];
    let seen_s = means[means.len() - 1].0 - means[0].0;
    let highest = 0.5 * (means.len() - 1) as f64 / seen_s;
    let lowest = MIN_PERIODS / seen_s;
    let count = ((4.0 * (highest - lowest) * seen_s).ceil().max(1.0) as usize).min(MAX_FREQUENCIES);
    let power = |hz: f64| {
        let (mut cos, mut sin) = (0.0, 0.0);
        for (at, level) in means {
            let turn = std::f64::consts::TAU * hz * at;
            cos += (level / mean - 1.0) * turn.cos();
            sin += (level / mean - 1.0) * turn.sin();
        }
        cos.hypot(sin)
    };
    let at = |k: usize| lowest + (highest - lowest) * k as f64 / count as f64;
    let best = (0..=count).max_by(|a, b| power(at(*a)).total_cmp(&power(at(*b))))?;
    // A maximum at the lowest frequency, or a small part of the amplitude, means a drift that is too slow to resolve.
    let explains = 2.0 * power(at(best)) / means.len() as f64 >= MIN_EXPLAINED * share;
    (highest > lowest && best > 0 && explains).then(|| at(best))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lamp(rate_hz: f64, frames: u32, share: f64, hz: f64) -> Vec<(f64, f64)> {
        let at = |k: u32| f64::from(k) / rate_hz;
        (0..frames).map(|k| (at(k), 100.0 * (1.0 + share * (std::f64::consts::TAU * hz * at(k)).sin()))).collect()
    }

    #[test]
    fn a_lamp_on_the_mains_has_its_amplitude_and_frequency() {
        let flicker = estimate_flicker(&lamp(1000.0, 300, 0.08, 100.0)).unwrap();
        assert!((flicker.share - 0.08).abs() < 0.005, "{flicker:?}");
        assert!((flicker.frequency_hz.unwrap() - 100.0).abs() < 2.0, "{flicker:?}");
    }

    #[test]
    fn a_swing_seen_for_less_than_a_period_has_no_such_frequency() {
        let flicker = estimate_flicker(&lamp(10_000.0, 30, 0.08, 100.0)).unwrap();
        assert_eq!(flicker.frequency_hz, None);
    }

    #[test]
    fn a_steady_lamp_does_not_swing() {
        let flicker = estimate_flicker(&lamp(1000.0, 100, 0.0, 1.0)).unwrap();
        assert_eq!((flicker.share, flicker.frequency_hz), (0.0, None));
    }
}
