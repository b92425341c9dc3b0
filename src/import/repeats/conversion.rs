//! RepeatFilter that took no time: films that were converted to a higher rate.

use crate::numeric::quantile;
use std::collections::BTreeMap;

/// The minimum number of changes after runs of one length for a judgement.
const MIN_CHANGES: usize = 4;
/// Maximum number of changes that are kept for each length.
const MAX_KEPT: usize = 1024;
/// Minimum growth of a change over twice the time that shows how much time a change took: half of that of a small
/// motion. Beyond the size of the texture, changes grow no more.
const MIN_GROWTH: f64 = 2.0;

/// The motion from one picture to the next, by the number of repeats between them.
#[derive(Debug, Default)]
pub(super) struct MotionAfterRepeats {
    by_repeats: BTreeMap<usize, Vec<f64>>,
    /// The motion over two pictures.
    across: Vec<f64>,
}

impl MotionAfterRepeats {
    /// Adds the motion after a number of repeats, and that over two pictures where there are two, DN^2. Beyond
    /// [`MAX_KEPT`] of a kind, further ones are ignored.
    pub(super) fn push(&mut self, repeats: usize, motion: f64, across: Option<f64>) {
        for (kept, motion) in [(self.by_repeats.entry(repeats).or_default(), Some(motion)), (&mut self.across, across)]
        {
            kept.extend(motion.filter(|_| kept.len() < MAX_KEPT));
        }
    }

    /// Whether the motion across repeats is no larger than without them, so that the repeats were inserted and the
    /// times of all frames are wrong.
    ///
    /// A camera that repeats a frame in place of the next loses that one, and then the motion goes on by two periods.
    /// The change of a small motion over `n` periods is that of one times `n` to the power of log2 of the growth over
    /// two; the limit lies half way, on a logarithmic scale.
    pub(super) fn are_inserted(&self) -> bool {
        let mut groups = self.by_repeats.iter().filter(|(_, motions)| motions.len() >= MIN_CHANGES);
        let (Some(fewest), Some(most)) = (groups.next(), groups.next_back()) else { return false };
        let middle = |motions: &Vec<f64>| quantile(&mut motions.clone(), 0.5).unwrap_or_default();
        let [few, many] = [fewest, most].map(|(_, motions)| middle(motions));
        let growth = middle(&self.across) / few;
        if !(few > 0.0 && growth >= MIN_GROWTH) {
            return false;
        }
        let periods = (*most.0 as f64 + 1.0) / (*fewest.0 as f64 + 1.0);
        many / few < periods.powf(growth.log2() / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Changes of a motion whose picture changes with the square of the time, up to a limit.
    fn judged(repeats: &[usize], takes_time: bool, limit: f64) -> bool {
        let mut motions = MotionAfterRepeats::default();
        let duration = |repeats: usize| if takes_time { repeats as f64 + 1.0 } else { 1.0 };
        let motion = |periods: f64| (periods * periods).min(limit);
        for at in 0..40 {
            let [before, now] = [at, at + 1].map(|at| repeats[at % repeats.len()]);
            motions.push(now, motion(duration(now)), Some(motion(duration(before) + duration(now))));
        }
        motions.are_inserted()
    }

    #[test]
    fn the_motion_after_repeats_separates_inserted_ones_from_lost_frames() {
        // 24 frames/s as 30; 25 as 30; 24 as 60.
        for repeats in [&[0, 0, 0, 1][..], &[0, 0, 0, 0, 1], &[1, 2]] {
            assert!(judged(repeats, false, f64::INFINITY), "{repeats:?}");
            assert!(!judged(repeats, true, f64::INFINITY), "{repeats:?}");
            assert!(!judged(repeats, true, 1.5) && !judged(repeats, false, 1.5), "a saturated change decides nothing");
        }
        // Each picture twice: either is right.
        assert!(!judged(&[1], false, f64::INFINITY));
    }
}
