//! The frames that were left out as repeats.

use std::collections::BTreeMap;
use std::fmt;

/// The maximum number of frames that are named.
const MAX_NAMED: usize = 4;
/// Maximum number of distances that are counted.
const MAX_DISTANCES: usize = 64;

/// The frames that were left out as repeats.
#[derive(Debug, Clone, Default)]
pub(super) struct Repeated {
    pub(super) count: u64,
    /// Number of repeats since the last picture.
    pub(super) run: usize,
    first: Vec<u64>,
    last: u64,
    /// Number of times that a repeat follows another at a distance.
    distances: BTreeMap<u64, u64>,
}

impl Repeated {
    /// Adds the frame with this number.
    pub(super) fn push(&mut self, number: u64) {
        let distance = number.saturating_sub(self.last);
        if self.count > 0 && (self.distances.len() < MAX_DISTANCES || self.distances.contains_key(&distance)) {
            *self.distances.entry(distance).or_default() += 1;
        }
        if self.first.len() < MAX_NAMED {
            self.first.push(number);
        }
        self.last = number;
        self.count += 1;
        self.run += 1;
    }

    /// Returns the distance at which most repeats follow each other; `None` without one.
    fn period(&self) -> Option<u64> {
        let (distance, times) = self.distances.iter().max_by_key(|(_, times)| **times)?;
        (self.count > 2 && *distance > 1 && 2 * times > self.count).then_some(*distance)
    }
}

impl fmt::Display for Repeated {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.first.iter().map(u64::to_string).collect();
        let numbers = numbers.join(", ");
        match self.count {
            1 => return write!(formatter, "1 frame repeats the one before and counts as missing: number {numbers}"),
            count => write!(formatter, "{count} frames repeat the one before and count as missing: numbers {numbers}")?,
        }
        if self.count > self.first.len() as u64 {
            write!(formatter, " ... {}", self.last)?;
        }
        self.period().map_or(Ok(()), |period| write!(formatter, ", mostly {period} apart"))
    }
}
