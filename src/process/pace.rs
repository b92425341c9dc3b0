//! How long something took, over very many times.

use std::time::Duration;

/// Latencies counted by microsecond.
#[derive(Debug)]
pub(super) struct Latencies {
    /// How often each whole number of microseconds was seen; the last stands for all above.
    counts: Vec<u32>,
    total: u64,
    most: Duration,
}

/// Microseconds that are told apart.
const MOST_US: usize = 20_000;

impl Default for Latencies {
    fn default() -> Self {
        // As long as it gets: whoever counts has no time to look for memory.
        Self { counts: vec![0; MOST_US + 1], total: 0, most: Duration::ZERO }
    }
}

impl Latencies {
    pub(super) fn add(&mut self, took: Duration) {
        let us = usize::try_from(took.as_micros()).unwrap_or(MOST_US).min(MOST_US);
        self.counts[us] += 1;
        self.total += 1;
        self.most = self.most.max(took);
    }

    /// The time that this share of them stayed within, whole microseconds rounded up.
    pub(super) fn quantile_us(&self, share: f64) -> Option<u64> {
        let wanted = (share * self.total as f64).ceil() as u64;
        let mut seen = 0;
        let found = self.counts.iter().position(|count| {
            seen += u64::from(*count);
            seen >= wanted
        });
        found.filter(|_| self.total > 0).map(|us| us as u64 + 1)
    }

    /// How many took a millisecond or longer.
    fn beyond_ms(&self) -> u64 {
        self.counts[1000..].iter().map(|count| u64::from(*count)).sum()
    }

    /// Median, 99.9 %, longest and how many took a millisecond, in words; `None` when there were none.
    pub(super) fn words(&self) -> Option<String> {
        let (median, high) = (self.quantile_us(0.5)?, self.quantile_us(0.999)?);
        Some(format!(
            "{} frames, median {median} us, 99.9 % within {high} us, longest {} us, {} of 1 ms or longer",
            self.total,
            self.most.as_micros(),
            self.beyond_ms()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_sorted_times() {
        let mut latencies = Latencies::default();
        assert_eq!(latencies.words(), None);
        (0..1000).for_each(|us| latencies.add(Duration::from_micros(us)));
        latencies.add(Duration::from_secs(9));
        assert_eq!((latencies.quantile_us(0.5), latencies.quantile_us(0.999)), (Some(501), Some(1000)));
        let words = "1001 frames, median 501 us, 99.9 % within 1000 us, longest 9000000 us, 1 of 1 ms or longer";
        assert_eq!(latencies.words().unwrap(), words);
    }
}
