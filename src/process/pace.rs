//! How long something took, over very many times.

use std::time::Duration;

/// Latencies counted by microsecond.
#[derive(Debug, Default)]
pub(super) struct Latencies {
    /// How often each whole number of microseconds was seen; the last stands for all above.
    counts: Vec<u64>,
    total: u64,
    most: Duration,
}

/// Microseconds that are told apart.
const MOST_US: usize = 20_000;

impl Latencies {
    pub(super) fn add(&mut self, took: Duration) {
        let us = usize::try_from(took.as_micros()).unwrap_or(MOST_US).min(MOST_US);
        if self.counts.len() <= us {
            self.counts.resize(us + 1, 0);
        }
        self.counts[us] += 1;
        self.total += 1;
        self.most = self.most.max(took);
    }

    /// The time that this share of them stayed within, whole microseconds rounded up.
    pub(super) fn quantile_us(&self, share: f64) -> Option<u64> {
        let wanted = (share * self.total as f64).ceil() as u64;
        let mut seen = 0;
        let found = self.counts.iter().position(|count| {
            seen += count;
            seen >= wanted
        });
        found.filter(|_| self.total > 0).map(|us| us as u64 + 1)
    }

    /// Median, 99.9 % and longest in words; `None` when there were none.
    pub(super) fn words(&self) -> Option<String> {
        let (median, high) = (self.quantile_us(0.5)?, self.quantile_us(0.999)?);
        Some(format!(
            "{} frames, median {median} us, 99.9 % within {high} us, longest {} us",
            self.total,
            self.most.as_micros()
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
        assert_eq!(latencies.words().unwrap(), "1001 frames, median 501 us, 99.9 % within 1000 us, longest 9000000 us");
    }
}
