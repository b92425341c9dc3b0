//! A histogram of latencies, from which quantiles are read.

use std::time::Duration;

/// A histogram of latencies in bins of 1 us.
#[derive(Debug)]
pub(super) struct LatencyHistogram {
    /// Count of each whole number of microseconds; the last bin collects everything above.
    counts: Vec<u32>,
    total: u64,
    max: Duration,
}

/// Upper limit of the histogram, us.
const MAX_US: usize = 20_000;

impl Default for LatencyHistogram {
    fn default() -> Self {
        // Allocated at once, since adding must not allocate.
        Self { counts: vec![0; MAX_US + 1], total: 0, max: Duration::ZERO }
    }
}

impl LatencyHistogram {
    /// Adds a latency, rounded down to whole microseconds.
    pub(super) fn add(&mut self, latency: Duration) {
        let us = usize::try_from(latency.as_micros()).unwrap_or(MAX_US).min(MAX_US);
        self.counts[us] += 1;
        self.total += 1;
        self.max = self.max.max(latency);
    }

    /// Returns the upper edge of the bin with the quantile of this probability (0 to 1), us; `None` if nothing was
    /// added. Latencies above [`MAX_US`] count as [`MAX_US`].
    pub(super) fn quantile_us(&self, probability: f64) -> Option<u64> {
        let rank = (probability * self.total as f64).ceil() as u64;
        let mut count_so_far = 0;
        let found = self.counts.iter().position(|count| {
            count_so_far += u64::from(*count);
            count_so_far >= rank
        });
        found.filter(|_| self.total > 0).map(|us| us as u64 + 1)
    }

    /// Returns the count of latencies of a millisecond or longer.
    fn count_beyond_ms(&self) -> u64 {
        self.counts[1000..].iter().map(|count| u64::from(*count)).sum()
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
    }
}
