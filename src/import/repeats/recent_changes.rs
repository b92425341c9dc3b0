//! The usual changes between the frames of a film, against which a repeat stands out.

use super::change::Change;
use crate::numeric::quantile;
use std::collections::VecDeque;

/// Number of changes that count as recent.
const RECENT: usize = 16;
/// The minimum number of changes that show whether a film has noise. One alone may be that of the light.
const MIN_CHANGES: usize = 4;
/// Share of a motion, as a mean square, below which a change is a standstill or one of the compression: a third of its
/// amplitude, more than H.264 changes a repeated frame at a constant rate factor of 30 where motion is 1 px per frame.
const MAX_STANDSTILL_SHARE: f64 = 1.0 / 9.0;
/// Share of the changes before and after it, as a mean square, below which a change is too small for their motion. In
/// films without repeats, neighbouring changes differ by less unless the compression is strong.
const MAX_DOUBTFUL_SHARE: f64 = 0.5;
/// Share of a usual change, as a mean square, that is still a motion at full speed: half of its amplitude.
const MIN_FULL_SPEED_SHARE: f64 = 0.25;
/// Change that rounding to whole grey levels alone can make, DN^2.
const MAX_ROUNDING_DN2: f64 = 1.0 / 6.0;

/// Whether the floor of a change, DN^2, is that of a camera's noise: more than rounding alone can make.
pub(super) fn is_noise(floor: f64) -> bool {
    floor > MAX_ROUNDING_DN2
}

/// The recent changes that were no repeats.
#[derive(Debug, Default)]
pub(super) struct RecentChanges {
    peaks: VecDeque<f64>,
    floors: VecDeque<f64>,
}

impl RecentChanges {
    /// Adds a change that was no repeat; of more than [`RECENT`], the oldest goes.
    pub(super) fn push(&mut self, change: &Change) {
        for (recent, value) in [(&mut self.peaks, change.peak()), (&mut self.floors, change.floor())] {
            recent.push_back(value);
            if recent.len() > RECENT {
                recent.pop_front();
            }
        }
    }

    /// Returns the median of the recent floors, DN^2; 0 without one.
    fn usual_floor(&self) -> f64 {
        quantile(&mut Vec::from(self.floors.clone()), 0.5).unwrap_or_default()
    }

    /// Whether no change was added yet.
    pub(super) fn is_empty(&self) -> bool {
        self.peaks.is_empty()
    }

    /// Whether a frame has no change at all in a film with noise, so that it is no other exposure.
    pub(super) fn is_copy(&self, change: &Change) -> bool {
        let floor = self.usual_floor();
        change.peak() == 0.0 && self.floors.len() >= MIN_CHANGES && is_noise(floor)
    }

    /// Whether a change is none, or so small next to the last one that the frame may repeat the one before.
    pub(super) fn is_standstill(&self, change: &Change) -> bool {
        let before = self.peaks.back().copied().unwrap_or_default();
        change.peak() == 0.0 || change.peak() < MAX_STANDSTILL_SHARE * before
    }

    /// Whether the last change is too small for a frame of the motion around it, in a film without the noise of a
    /// camera, which a strong compression removes.
    ///
    /// `after` is the change that follows, and `across` leads from the frame before the last two changes to the one
    /// after all three. Where these two are alike, the motion has turned back.
    pub(super) fn is_last_doubtful(&self, after: &Change, across: impl FnOnce() -> Option<Change>) -> bool {
        let mut recent = self.peaks.iter().rev();
        let (Some(last), Some(before)) = (recent.next(), recent.next()) else { return false };
        let (slower, faster) = (before.min(after.peak()), before.max(after.peak()));
        let is_small = *last > MAX_ROUNDING_DN2 && *last < MAX_DOUBTFUL_SHARE * slower;
        let is_compressed = || !is_noise(self.usual_floor());
        is_small && is_compressed() && across().is_some_and(|across| across.peak() > faster / 2.0)
    }

    /// Whether a standstill is one of the film, and not of what it shows.
    ///
    /// A body in motion does not stand still for some frames and then move on at full speed. `largest` is the largest
    /// change within the standstill, `after` the one that ends it, and `across` leads from the frame before the last
    /// motion to the frame after the standstill. Where these two are alike, the motion has turned back.
    pub(super) fn interrupts_motion(&self, largest: f64, after: &Change, across: &Change) -> bool {
        let Some(before) = self.peaks.back().copied() else { return false };
        let usual = quantile(&mut Vec::from(self.peaks.clone()), 0.5).unwrap_or_default();
        let (slower, faster) = (before.min(after.peak()), before.max(after.peak()));
        let is_fast = slower > MAX_ROUNDING_DN2
            && slower >= MIN_FULL_SPEED_SHARE * usual
            && largest <= MAX_STANDSTILL_SHARE * slower;
        is_fast && across.peak() > faster / 2.0
    }
}
