//! The sequence numbers for which there are frames.

use std::ops::Range;

/// The sequence numbers of frames, as runs without a gap.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FrameRuns {
    runs: Vec<Range<u64>>,
}

impl FrameRuns {
    /// Adds the next frame. Its sequence number exceeds those added before.
    pub fn push(&mut self, sequence: u64) {
        match self.runs.last_mut() {
            Some(run) if run.end == sequence => run.end += 1,
            _ => self.runs.push(sequence..sequence.saturating_add(1)),
        }
    }

    /// Returns the sequence number of the first frame, 0 without any.
    pub fn first(&self) -> u64 {
        self.runs.first().map_or(0, |run| run.start)
    }

    /// Whether the frame with this sequence number was added.
    pub fn contains(&self, sequence: u64) -> bool {
        let place = self.runs.partition_point(|run| run.end <= sequence);
        self.runs.get(place).is_some_and(|run| run.contains(&sequence))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_a_gap_are_not_contained() {
        let mut frames = FrameRuns::default();
        [3, 4, 7, 8, 20].into_iter().for_each(|sequence| frames.push(sequence));
        let contained: Vec<u64> = (0..30).filter(|sequence| frames.contains(*sequence)).collect();
        assert_eq!((contained, frames.first()), (vec![3, 4, 7, 8, 20], 3));
    }
}
