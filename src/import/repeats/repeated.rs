//! The frames that were left out as repeats.

use super::numbers::FrameNumbers;
use std::collections::BTreeMap;
use std::fmt;

/// Maximum number of distances that are counted.
const MAX_DISTANCES: usize = 64;

/// The frames that were left out as repeats.
#[derive(Debug, Clone, Default)]
pub(super) struct RepeatedFrames {
    pub(super) numbers: FrameNumbers,
    /// Number of repeats since the last picture.
    pub(super) run: usize,
    /// Number of times that a repeat follows another at a distance.
    distances: BTreeMap<u64, u64>,
}

impl RepeatedFrames {
    /// Counts the frame with this number, and its distance from the repeat before.
    pub(super) fn push(&mut self, number: u64) {
        let distance = number.saturating_sub(self.numbers.last);
        if self.numbers.count > 0 && (self.distances.len() < MAX_DISTANCES || self.distances.contains_key(&distance)) {
            *self.distances.entry(distance).or_default() += 1;
        }
        self.numbers.push(number);
        self.run += 1;
    }

    /// Returns the distance, frames, at which more than half of the repeats follow each other; `None` without one, for
    /// fewer than three repeats, and for a distance of 1.
    fn period(&self) -> Option<u64> {
        let (distance, times) = self.distances.iter().max_by_key(|(_, times)| **times)?;
        let count = self.numbers.count;
        (count > 2 && *distance > 1 && 2 * times > count).then_some(*distance)
    }
}

impl fmt::Display for RepeatedFrames {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers = &self.numbers;
        match numbers.count {
            1 => write!(formatter, "1 frame repeats the one before and counts as missing: {numbers}")?,
            count => write!(formatter, "{count} frames repeat the one before and count as missing: {numbers}")?,
        }
        self.period().map_or(Ok(()), |period| write!(formatter, ", mostly {period} apart"))
    }
}
