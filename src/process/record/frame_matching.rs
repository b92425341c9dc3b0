//! Matching of frames that two cameras took at the same time.

use std::collections::VecDeque;
use std::fmt;

/// Maximum number of stamps that wait for the other camera; beyond that, the other camera has died.
const MAX_WAITING: usize = 1 << 16;

/// The time differences between the frames of a camera and those of the main camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Matching {
    /// Frames of the camera.
    pub frames: u64,
    /// Frames within half a period of one of the main camera.
    pub matched: u64,
    /// Mean delay of those to the nearest frame of the main camera, ns; positive if they are later.
    pub mean_ns: f64,
    /// Standard deviation of the delay, ns.
    pub scatter_ns: f64,
    /// Maximum time difference, ns.
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

/// Matches frames by their stamps as they arrive, in rising order for each camera.
#[derive(Debug, Clone)]
pub struct Matcher {
    half_period_ns: u64,
    /// Stamps of the main camera's frames that may match one of the other camera, ns.
    mains: VecDeque<u64>,
    /// Stamps of the other camera's frames that are not matched yet, ns.
    others: VecDeque<u64>,
    result: Matching,
    is_over: bool,
    /// Sum of the squared deviations of the delays from their mean, ns².
    squares: f64,
}

impl Matcher {
    /// Creates a matcher; `half_period_ns` is the maximum difference, half the frame period of the main camera.
    pub fn new(half_period_ns: u64) -> Self {
        Self {
            half_period_ns,
            mains: VecDeque::new(),
            others: VecDeque::new(),
            result: Matching::default(),
            is_over: false,
            squares: 0.0,
        }
    }

    /// Adds a frame of the main camera.
    pub fn add_main(&mut self, stamp_ns: u64) {
        self.mains.push_back(stamp_ns);
        if self.mains.len() > MAX_WAITING {
            self.mains.pop_front();
        }
        self.match_frames();
    }

    /// Adds a frame of the other camera.
    pub fn add_other(&mut self, stamp_ns: u64) {
        self.result.frames += 1;
        self.others.push_back(stamp_ns);
        if self.others.len() > MAX_WAITING {
            self.others.pop_front();
        }
        self.match_frames();
    }

    /// Matches the remaining frames and returns the result. The scatter is 0 with fewer than two matches.
    pub fn finish(mut self) -> Matching {
        self.is_over = true;
        self.match_frames();
        if self.result.matched > 1 {
            self.result.scatter_ns = (self.squares / (self.result.matched - 1) as f64).sqrt();
        }
        self.result
    }

    /// Matches frames as far as possible: the nearest frame is known once there is a later one, or no more will
    /// come. Mean and scatter of the delays are updated by Welford's method (Technometrics 4, 1962,
    /// <https://doi.org/10.1080/00401706.1962.10490022>).
    fn match_frames(&mut self) {
        while let Some(other) = self.others.front().copied() {
            while self.mains.get(1).is_some_and(|next| next.abs_diff(other) <= self.mains[0].abs_diff(other)) {
                self.mains.pop_front();
            }
            let is_passed = self.mains.back().is_some_and(|newest| *newest >= other);
            if !is_passed && !self.is_over {
                return;
            }
            self.others.pop_front();
            if let Some(first) = self.mains.front().filter(|first| first.abs_diff(other) <= self.half_period_ns) {
                let apart_ns = first.abs_diff(other);
                self.result.worst_ns = self.result.worst_ns.max(apart_ns);
                let later_ns = if other >= *first { apart_ns as f64 } else { -(apart_ns as f64) };
                self.result.matched += 1;
                let step = later_ns - self.result.mean_ns;
                self.result.mean_ns += step / self.result.matched as f64;
                self.squares += step * (later_ns - self.result.mean_ns);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Matches frames in either order of arrival.
    fn both_ways(mains: &[u64], others: &[u64]) -> Matching {
        let (mut late, mut early) = (Matcher::new(500), Matcher::new(500));
        mains.iter().for_each(|stamp| late.add_main(*stamp));
        others.iter().for_each(|stamp| late.add_other(*stamp));
        others.iter().for_each(|stamp| early.add_other(*stamp));
        mains.iter().for_each(|stamp| early.add_main(*stamp));
        let (late, early) = (late.finish(), early.finish());
        assert_eq!(late, early);
        late
    }

    #[test]
    fn frames_of_one_moment_are_matched_and_their_difference_is_reported() {
        let mains: Vec<u64> = (0..100).map(|n| 10_000 + 1000 * n).collect();
        // 30 or 50 ns later.
        let others: Vec<u64> = mains.iter().enumerate().map(|(n, stamp)| stamp + 30 + 20 * (n as u64 % 2)).collect();
        let matching = both_ways(&mains, &others);
        assert_eq!((matching.frames, matching.matched, matching.worst_ns), (100, 100, 50));
        assert!((matching.mean_ns - 40.0).abs() < 1e-9 && (matching.scatter_ns - 10.05).abs() < 0.01, "{matching:?}");
        let text = matching.to_string();
        assert!(text.starts_with("100 of 100 frames match one of the first camera, 0.040 us later"), "{text}");
    }

    #[test]
    fn frames_that_the_first_camera_lost_or_did_not_take_match_none() {
        let mains: Vec<u64> = (0..20).filter(|n| !(5..8).contains(n)).map(|n| 10_000 + 1000 * n).collect();
        let others: Vec<u64> = (0..25).map(|n| 9_900 + 1000 * n).collect();
        let matching = both_ways(&mains, &others);
        assert_eq!((matching.frames, matching.matched), (25, 17));
        assert!((matching.mean_ns + 100.0).abs() < 1e-9, "{matching:?}");
    }

    #[test]
    fn without_a_first_camera_nothing_matches() {
        let matching = both_ways(&[], &[5, 6]);
        assert_eq!((matching.frames, matching.matched), (2, 0));
        assert_eq!(matching.to_string(), "0 of 2 frames match one of the first camera");
    }
}
