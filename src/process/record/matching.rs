//! Which frames of two cameras show the same moment.

use std::collections::VecDeque;
use std::fmt;

/// Stamps of a camera that wait for the other's at most; one that is further behind has died.
const WAITING_MAX: usize = 1 << 16;

/// How the frames of a camera lie in time beside those of the first.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Matching {
    /// Frames of the camera.
    pub frames: u64,
    /// Those of them that a frame of the first camera was taken within half a period of.
    pub matched: u64,
    /// Mean of how much later those were taken than the frame of the first that is nearest, ns.
    pub mean_ns: f64,
    /// Scatter of that about its mean (one sigma), ns.
    pub scatter_ns: f64,
    /// Largest distance in time, ns.
    pub worst_ns: u64,
}

impl fmt::Display for Matching {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frames, matched, mean_ns, scatter_ns, worst_ns } = self;
        write!(formatter, "{matched} of {frames} frames match one of the first camera")?;
        if *matched == 0 {
            return Ok(());
        }
        let (mean_us, scatter_us, worst_us) = (mean_ns * 1e-3, scatter_ns * 1e-3, *worst_ns as f64 * 1e-3);
        write!(
            formatter,
            ", {mean_us:.3} us later with a scatter of {scatter_us:.3} us, at most {worst_us:.3} us apart"
        )
    }
}

/// Matches frames by their stamps, as they come; those of each camera in rising order.
#[derive(Debug, Clone)]
pub struct Matcher {
    half_period_ns: u64,
    firsts: VecDeque<u64>,
    others: VecDeque<u64>,
    told: Matching,
    /// Sum of squares about the mean (Welford).
    squares: f64,
}

impl Matcher {
    /// Frames match that are no further apart than this, half the time between two frames of the first camera.
    pub fn new(half_period_ns: u64) -> Self {
        Self {
            half_period_ns,
            firsts: VecDeque::new(),
            others: VecDeque::new(),
            told: Matching::default(),
            squares: 0.0,
        }
    }

    /// A frame of the first camera.
    pub fn first(&mut self, stamp_ns: u64) {
        self.firsts.push_back(stamp_ns);
        if self.firsts.len() > WAITING_MAX {
            self.firsts.pop_front();
        }
        self.settle(false);
    }

    /// A frame of the other camera.
    pub fn other(&mut self, stamp_ns: u64) {
        self.told.frames += 1;
        self.others.push_back(stamp_ns);
        if self.others.len() > WAITING_MAX {
            self.others.pop_front();
        }
        self.settle(false);
    }

    /// No more frames will come.
    pub fn finish(mut self) -> Matching {
        self.settle(true);
        if self.told.matched > 1 {
            self.told.scatter_ns = (self.squares / (self.told.matched - 1) as f64).sqrt();
        }
        self.told
    }

    /// Decides what can be decided: the nearest frame is known once there is a later one.
    fn settle(&mut self, is_over: bool) {
        while let Some(other) = self.others.front().copied() {
            while self.firsts.get(1).is_some_and(|next| next.abs_diff(other) <= self.firsts[0].abs_diff(other)) {
                self.firsts.pop_front();
            }
            let is_passed = self.firsts.back().is_some_and(|newest| *newest >= other);
            if !is_passed && !is_over {
                return;
            }
            self.others.pop_front();
            if let Some(first) = self.firsts.front().filter(|first| first.abs_diff(other) <= self.half_period_ns) {
                let apart_ns = first.abs_diff(other);
                self.told.worst_ns = self.told.worst_ns.max(apart_ns);
                let later_ns = if other >= *first { apart_ns as f64 } else { -(apart_ns as f64) };
                self.told.matched += 1;
                let step = later_ns - self.told.mean_ns;
                self.told.mean_ns += step / self.told.matched as f64;
                self.squares += step * (later_ns - self.told.mean_ns);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In whatever order the frames of the two come.
    fn both_ways(firsts: &[u64], others: &[u64]) -> Matching {
        let (mut late, mut early) = (Matcher::new(500), Matcher::new(500));
        firsts.iter().for_each(|stamp| late.first(*stamp));
        others.iter().for_each(|stamp| late.other(*stamp));
        others.iter().for_each(|stamp| early.other(*stamp));
        firsts.iter().for_each(|stamp| early.first(*stamp));
        let (late, early) = (late.finish(), early.finish());
        assert_eq!(late, early);
        late
    }

    #[test]
    fn frames_of_one_moment_are_matched_and_their_distance_told() {
        let firsts: Vec<u64> = (0..100).map(|n| 10_000 + 1000 * n).collect();
        // 30 or 50 ns later.
        let others: Vec<u64> = firsts.iter().enumerate().map(|(n, stamp)| stamp + 30 + 20 * (n as u64 % 2)).collect();
        let told = both_ways(&firsts, &others);
        assert_eq!((told.frames, told.matched, told.worst_ns), (100, 100, 50));
        assert!((told.mean_ns - 40.0).abs() < 1e-9 && (told.scatter_ns - 10.05).abs() < 0.01, "{told:?}");
        let text = told.to_string();
        assert!(text.starts_with("100 of 100 frames match one of the first camera, 0.040 us later"), "{text}");
    }

    #[test]
    fn frames_that_the_first_camera_lost_or_did_not_take_match_none() {
        let firsts: Vec<u64> = (0..20).filter(|n| !(5..8).contains(n)).map(|n| 10_000 + 1000 * n).collect();
        let others: Vec<u64> = (0..25).map(|n| 9_900 + 1000 * n).collect();
        let told = both_ways(&firsts, &others);
        assert_eq!((told.frames, told.matched), (25, 17));
        assert!((told.mean_ns + 100.0).abs() < 1e-9, "{told:?}");
    }

    #[test]
    fn without_a_first_camera_nothing_matches() {
        let told = both_ways(&[], &[5, 6]);
        assert_eq!((told.frames, told.matched), (2, 0));
        assert_eq!(told.to_string(), "0 of 2 frames match one of the first camera");
    }
}
