//! The flights and contacts of a body so far.

use std::collections::VecDeque;

use crate::motion::Regime;
use crate::results::Phase;

/// The number of changes of regime that are kept.
const KEPT_BREAKS: usize = 16;

/// A change of the motion's regime.
#[derive(Debug, Clone, Copy)]
struct Break {
    from: u64,
    /// The first frame after a contact; `from` where the flight only restarts.
    to: Option<u64>,
    /// Frames from here on were published as "after contact" before a later `to` was known.
    published_after: Option<u64>,
    speed: f64,
    acceleration: f64,
}

impl Break {
    fn is_contact(&self) -> bool {
        self.to != Some(self.from)
    }
}

/// The newest changes between flight and contact, by frames.
#[derive(Debug, Clone)]
pub(super) struct RegimeHistory {
    breaks: VecDeque<Break>,
    /// The lag of published rows.
    lag_frames: u64,
}

impl RegimeHistory {
    /// Creates the history of a flight. Rows of frames older than `lag_frames` are published.
    pub(super) fn new(lag_frames: u64) -> Self {
        Self { breaks: VecDeque::new(), lag_frames }
    }

    /// Restarts the flight at a frame.
    pub(super) fn restart_flight(&mut self, from: u64) {
        self.store(Break { from, to: Some(from), published_after: None, speed: 0.0, acceleration: 0.0 });
    }

    /// Begins a contact at a frame, with this speed of approach, px/frame.
    pub(super) fn begin_contact(&mut self, from: u64, speed: f64) {
        // A slow contact is detected late: flights that seemed to restart during it did not.
        while self.breaks.back().is_some_and(|b| b.from >= from) {
            self.breaks.pop_back();
        }
        self.store(Break { from, to: None, published_after: None, speed, acceleration: 0.0 });
    }

    /// Sets the peak acceleration of the newest contact, px/frame^2.
    pub(super) fn set_acceleration(&mut self, acceleration: f64) {
        if let Some(b) = self.breaks.back_mut() {
            b.acceleration = acceleration;
        }
    }

    /// Sets the end of the newest contact, or corrects it; `newest` is the newest frame.
    pub(super) fn set_end(&mut self, to: u64, newest: u64) {
        if let Some(b) = self.breaks.back_mut() {
            // Frames this old have been published already.
            let was_published = b.to.filter(|before| before + self.lag_frames < newest);
            b.published_after = b.published_after.or(was_published);
            b.to = Some(to.max(b.from + 1));
        }
    }

    /// Removes the newest contact.
    pub(super) fn withdraw_contact(&mut self) {
        self.breaks.pop_back();
    }

    /// Stores a change of regime and discards the oldest beyond [`KEPT_BREAKS`].
    fn store(&mut self, new: Break) {
        if self.breaks.len() == KEPT_BREAKS {
            self.breaks.pop_front();
        }
        self.breaks.push_back(new);
    }

    /// Returns the known regime of the motion at a frame. The first flight starts at 0, the newest ends at `u64::MAX`.
    pub(super) fn regime(&self, frame: u64) -> Regime {
        let next = self.breaks.partition_point(|b| b.from <= frame);
        let to = self.breaks.get(next).map_or(u64::MAX, |b| b.from.saturating_sub(1));
        match next.checked_sub(1).map(|i| self.breaks[i]) {
            None => Regime::Flight { from: 0, to },
            Some(b) => match b.to {
                Some(end) if frame >= end => Regime::Flight { from: end, to },
                _ => Regime::Contact { speed_px: b.speed, acceleration_px: b.acceleration, from: b.from, to: b.to },
            },
        }
    }

    /// Returns the phase at a frame: flight, contact or rebound, as known by now.
    pub(super) fn phase(&self, frame: u64) -> Phase {
        let newest = self.breaks.iter().rev().find(|b| b.from <= frame);
        // A contact that was published as ended is not published as lasting again.
        let is_over = newest.and_then(|b| b.published_after).is_some_and(|after| after <= frame);
        match self.regime(frame) {
            Regime::Contact { .. } if !is_over => Phase::Contact,
            _ if self.breaks.iter().any(|b| b.is_contact() && b.from <= frame) => Phase::Rebound,
            _ => Phase::Flight,
        }
    }
}
