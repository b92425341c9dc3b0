//! A histogram of latencies, from which quantiles are read.

use std::time::Duration;

/// A histogram of latencies.
///
/// Its bins are 1 us wide up to [`FINE_US`], and above that at most [`FINE_US`] / 2 of them span each factor of two. A
/// quantile is therefore exact to 1 us or 0.2 %.
#[derive(Debug)]
pub(super) struct LatencyHistogram {
    /// Count of each bin; the last one collects everything above.
    counts: Vec<u32>,
    total: u64,
    max: Duration,
    /// Sums of the latencies, s, and of their squares, s^2.
    sum_s: f64,
    sum_s2: f64,
}

/// Latencies below this have bins of 1 us, us. A power of two.
const FINE_US: u64 = 1024;
/// The longest latency that is distinguished, us: half an hour.
const MAX_US: u64 = 1 << 31;

impl Default for LatencyHistogram {
    fn default() -> Self {
        // Allocated at once, since adding must not allocate.
        Self { counts: vec![0; bin(MAX_US) + 1], total: 0, max: Duration::ZERO, sum_s: 0.0, sum_s2: 0.0 }
    }
}

/// Returns the bin of a latency, us.
fn bin(us: u64) -> usize {
    let us = us.min(MAX_US);
    // Above the fine bins, the width doubles with each power of two.
    let doublings = u64::from((us / FINE_US).checked_ilog2().map_or(0, |power| power + 1));
    (doublings * FINE_US / 2 + (us >> doublings)) as usize
}

/// Returns the upper edge of a bin, us.
fn upper_edge_us(bin: usize) -> u64 {
    let half = FINE_US / 2;
    let doublings = (bin as u64 / half).saturating_sub(1);
    (bin as u64 - doublings * half + 1) << doublings
}

impl LatencyHistogram {
    /// Adds a latency.
    pub(super) fn add(&mut self, latency: Duration) {
        let us = u64::try_from(latency.as_micros()).unwrap_or(MAX_US);
        self.counts[bin(us)] += 1;
        self.total += 1;
        self.max = self.max.max(latency);
        let seconds = latency.as_secs_f64();
        self.sum_s += seconds;
        self.sum_s2 += seconds * seconds;
    }

    /// Forgets all latencies.
    pub(super) fn clear(&mut self) {
        self.counts.fill(0);
        (self.total, self.max, self.sum_s, self.sum_s2) = (0, Duration::ZERO, 0.0, 0.0);
    }

    /// Returns the upper edge of the bin with the quantile of this probability (0 to 1), us; `None` if nothing was
    /// added.
    pub(super) fn quantile_us(&self, probability: f64) -> Option<u64> {
        let rank = (probability * self.total as f64).ceil() as u64;
        let mut count_so_far = 0;
        let found = self.counts.iter().position(|count| {
            count_so_far += u64::from(*count);
            count_so_far >= rank
        });
        found.filter(|_| self.total > 0).map(upper_edge_us)
    }

    /// Returns the longest latency; zero if nothing was added.
    pub(super) fn max(&self) -> Duration {
        self.max
    }

    /// Returns the standard deviation of the latencies, s; 0 if nothing was added.
    pub(super) fn deviation_s(&self) -> f64 {
        let count = self.total.max(1) as f64;
        let mean_s = self.sum_s / count;
        (self.sum_s2 / count - mean_s * mean_s).max(0.0).sqrt()
    }

    /// Returns the count of latencies of a millisecond or longer.
    fn count_beyond_ms(&self) -> u64 {
        self.counts[bin(1000)..].iter().map(|count| u64::from(*count)).sum()
    }

    /// Describes the latencies in words: their number, one per frame, median, 99.9 % quantile, maximum and the number
    /// of 1 ms or longer. `None` if nothing was added.
    pub(super) fn description(&self) -> Option<String> {
        let (median, high) = (self.quantile_us(0.5)?, self.quantile_us(0.999)?);
        Some(format!(
            "{} frames, median {median} us, 99.9 % within {high} us, longest {} us, {} of 1 ms or longer",
            self.total,
            self.max.as_micros(),
            self.count_beyond_ms()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_sorted_times() {
        let mut latencies = LatencyHistogram::default();
        assert_eq!(latencies.description(), None);
        (0..1000).for_each(|us| latencies.add(Duration::from_micros(us)));
        latencies.add(Duration::from_secs(9));
        assert_eq!((latencies.quantile_us(0.5), latencies.quantile_us(0.999)), (Some(501), Some(1000)));
        let text = "1001 frames, median 501 us, 99.9 % within 1000 us, longest 9000000 us, 1 of 1 ms or longer";
        assert_eq!(latencies.description().unwrap(), text);
        latencies.clear();
        assert_eq!((latencies.quantile_us(0.5), latencies.max(), latencies.deviation_s()), (None, Duration::ZERO, 0.0));
    }

    #[test]
    fn a_quantile_of_any_length_is_at_most_a_500th_too_long() {
        let lengths_us = (0..31).flat_map(|power| [(1_u64 << power) - 1, 1 << power, (1 << power) + (1 << power) / 3]);
        for us in lengths_us {
            let mut latencies = LatencyHistogram::default();
            latencies.add(Duration::from_micros(us));
            let found = latencies.quantile_us(0.5).unwrap();
            assert!(found > us && found - us <= 1 + us / 500, "{us} us: {found} us");
        }
    }

    #[test]
    fn the_deviation_is_that_about_the_mean() {
        let mut latencies = LatencyHistogram::default();
        [1, 2, 3, 4].iter().for_each(|ms| latencies.add(Duration::from_millis(*ms)));
        assert!((latencies.deviation_s() - 1.25_f64.sqrt() * 1e-3).abs() < 1e-9);
    }
}
