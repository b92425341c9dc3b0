//! When each buffer was filled, in the order in which they come out.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Moments told by the receiving thread, taken by whoever takes the buffers.
///
/// The library hands a buffer out first and tells of it then: whoever is quick takes it before.
#[derive(Debug, Default)]
pub(super) struct Completions(Mutex<Told>);

#[derive(Debug, Default)]
struct Told {
    moments: VecDeque<Instant>,
    /// Buffers that were taken before they were told of.
    ahead: usize,
}

impl Completions {
    /// A buffer is filled.
    #[expect(clippy::disallowed_methods, reason = "tells how long a frame waited, never when it was filmed")]
    pub fn add(&self) {
        let now = Instant::now();
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match told.ahead.checked_sub(1) {
            Some(ahead) => told.ahead = ahead,
            None => told.moments.push_back(now),
        }
    }

    /// When the buffer that comes out now was filled; nothing when that was just now.
    pub fn take(&self) -> Option<Instant> {
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let moment = told.moments.pop_front();
        told.ahead += usize::from(moment.is_none());
        moment
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_stay_with_their_buffers_when_one_is_taken_before_it_was_told_of() {
        let completions = Completions::default();
        completions.add();
        completions.add();
        let (first, second) = (completions.take(), completions.take());
        assert!(first.is_some() && first <= second);
        assert_eq!(completions.take(), None);
        completions.add();
        completions.add();
        assert!(completions.take() >= second);
        assert_eq!(completions.take(), None, "the third was taken before it was told of");
    }
}
