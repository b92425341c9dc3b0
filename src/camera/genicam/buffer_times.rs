//! The completion times of buffers, in the order in which the buffers come out.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Completion times, added by the receiving thread and taken together with the buffers.
///
/// The library hands out a buffer first and calls back then, so a fast consumer may take the buffer before its time.
#[derive(Debug, Default)]
pub(super) struct BufferTimes(Mutex<Queue>);

#[derive(Debug, Default)]
struct Queue {
    times: VecDeque<Instant>,
    /// Number of buffers that were taken before their time was added.
    taken_early: usize,
}

impl BufferTimes {
    /// Records that a buffer is complete now, unless it was taken before this call.
    #[expect(clippy::disallowed_methods, reason = "measures the delivery latency, never the time of a frame")]
    pub fn add(&self) {
        let now = Instant::now();
        let mut queue = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match queue.taken_early.checked_sub(1) {
            Some(taken_early) => queue.taken_early = taken_early,
            None => queue.times.push_back(now),
        }
    }

    /// Returns when the buffer that is taken now was completed; `None` if that is not recorded yet, thus only just.
    pub fn take(&self) -> Option<Instant> {
        let mut queue = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let time = queue.times.pop_front();
        queue.taken_early += usize::from(time.is_none());
        time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_stay_with_their_buffers_when_one_is_taken_before_its_time_was_added() {
        let times = BufferTimes::default();
        times.add();
        times.add();
        let (first, second) = (times.take(), times.take());
        assert!(first.is_some() && first <= second);
        assert_eq!(times.take(), None);
        times.add();
        times.add();
        assert!(times.take() >= second);
        assert_eq!(times.take(), None, "the third was taken before its time was added");
    }
}
