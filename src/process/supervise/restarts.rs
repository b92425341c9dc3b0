//! The number of restarts that a process may need.

use crate::process::clock::now;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Deaths of one process within [`WINDOW`] after which the rig gives up.
const MAX_DEATHS: usize = 5;
/// Time after which a death no longer counts.
const WINDOW: Duration = Duration::from_secs(30);

/// The recent deaths of a process.
#[derive(Debug, Default)]
pub(super) struct RecentDeaths(VecDeque<Instant>);

impl RecentDeaths {
    /// Counts a death; returns whether the process may be restarted.
    pub(super) fn count_death(&mut self) -> bool {
        self.count_death_at(now())
    }

    /// Counts a death at this time; returns whether there were at most [`MAX_DEATHS`] within [`WINDOW`].
    fn count_death_at(&mut self, time: Instant) -> bool {
        self.0.push_back(time);
        while self.0.front().is_some_and(|first| time.duration_since(*first) > WINDOW) {
            self.0.pop_front();
        }
        self.0.len() <= MAX_DEATHS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_deaths_in_quick_succession_end_the_rig() {
        let (mut slow, mut fast, start) = (RecentDeaths::default(), RecentDeaths::default(), now());
        assert!((0..100_u32).all(|death| slow.count_death_at(start + death * WINDOW / 4)));
        let allowed: Vec<bool> = (0..7_u32).map(|death| fast.count_death_at(start + death * WINDOW / 10)).collect();
        assert_eq!(allowed, [true, true, true, true, true, false, false]);
        assert!(fast.count_death_at(start + 10 * WINDOW), "the budget recovers");
    }
}
