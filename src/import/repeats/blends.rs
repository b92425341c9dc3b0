//! Frames that were blended of their neighbours.

use std::collections::VecDeque;

/// Number of frames that count as recent.
const RECENT: usize = 16;
/// The share of the usual part of a frame that its neighbours do not explain, below which it was blended of them.
const MAX_SHARE_OF_USUAL: f64 = 1.0 / 16.0;
/// The minimum number of blended frames that is reported.
const MIN_COUNT: u64 = 4;
/// The minimum share of a film that is reported.
const MIN_SHARE: f64 = 0.1;

/// Blended frames among those of a film.
#[derive(Debug, Default)]
pub(super) struct BlendedFrames {
    /// The parts of recent frames that their neighbours do not explain, DN^2.
    recent: VecDeque<f64>,
    blended: u64,
    all: u64,
}

impl BlendedFrames {
    /// Adds a frame with the part of it that its neighbours do not explain, DN^2. A part far below the usual one of
    /// recent frames counts as a blend.
    pub(super) fn push(&mut self, own_part: f64) {
        self.recent.push_back(own_part);
        if self.recent.len() > RECENT {
            self.recent.pop_front();
        }
        // A film at twice its rate has a blend in every second frame; the upper quartile describes the other half.
        let mut sorted: Vec<f64> = self.recent.iter().copied().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let usual = sorted[sorted.len() * 3 / 4];
        self.all += 1;
        self.blended += u64::from(own_part < MAX_SHARE_OF_USUAL * usual);
    }

    /// Returns the warning of a film with blended frames; `None` while they are too few or too small a share.
    pub(super) fn warning(&self) -> Option<String> {
        let (blended, all) = (self.blended, self.all);
        let is_reported = blended >= MIN_COUNT && blended as f64 > MIN_SHARE * all as f64;
        is_reported.then(|| {
            format!(
                "{blended} of {all} frames are blended of their neighbours, by a conversion to another rate or by a strong \
                 compression, and show no moment of their own; measure the original"
            )
        })
    }
}
