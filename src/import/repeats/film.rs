//! The usual changes between the frames of a film, against which a repeat stands out.

use super::change::{Change, median};
use std::collections::VecDeque;

/// Number of changes that count as recent.
const RECENT: usize = 16;
/// A change of less than this share of the noise is no other exposure: the noise of a tile is known within a fifth.
const OF_NOISE: f64 = 0.25;
/// Share of the changes before and after it, as a mean square, below which a change in a film without noise is one of
/// the compression: an eighth of their amplitude.
const OF_MOTION: f64 = 1.0 / 64.0;
/// Share of a usual change, as a mean square, that is still a motion at full speed: half of its amplitude.
const FULL_SPEED: f64 = 0.25;
/// Change that rounding to whole grey levels alone can make, DN^2.
const ROUNDING: f64 = 1.0 / 6.0;

/// The recent changes that were no repeats.
#[derive(Debug, Default)]
pub(super) struct RecentChanges {
    peaks: VecDeque<f64>,
    floors: VecDeque<f64>,
}

impl RecentChanges {
    pub(super) fn push(&mut self, change: &Change) {
        for (recent, value) in [(&mut self.peaks, change.peak()), (&mut self.floors, change.floor())] {
            recent.push_back(value);
            if recent.len() > RECENT {
                recent.pop_front();
            }
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.peaks.is_empty()
    }

    /// Whether two frames of this film always differ by their noise.
    pub(super) fn is_noisy(&self) -> bool {
        self.floor() > 0.0
    }

    fn floor(&self) -> f64 {
        median(self.floors.iter().copied().collect())
    }

    /// Whether a change is so small that the frame may repeat the one before.
    pub(super) fn is_repeat(&self, change: &Change) -> bool {
        let peak = change.peak();
        let before = self.peaks.back().copied().unwrap_or_default();
        peak == 0.0 || peak < OF_NOISE * self.floor() || !self.is_noisy() && peak < OF_MOTION * before
    }

    /// Whether a standstill of a film without noise is one of the film, and not of what it shows.
    ///
    /// A body in motion does not stand still for some frames and then move on at full speed. `largest` is the largest
    /// change within the standstill, `after` the one that ends it, and `across` leads from the frame before the last
    /// motion to the frame after the standstill. Where these are alike, the motion has turned back.
    pub(super) fn interrupts_motion(&self, largest: f64, after: &Change, across: &Change) -> bool {
        let (Some(before), after, across) = (self.peaks.back().copied(), after.peak(), across.peak()) else {
            return false;
        };
        let usual = median(self.peaks.iter().copied().collect());
        let slower = before.min(after);
        slower > ROUNDING && slower >= FULL_SPEED * usual && largest <= OF_MOTION * slower && across > slower / 2.0
    }
}
