//! Steps from several workers to rows in frame order: what the tracker does live and the recorder over a shot.

use super::{Order, Tracker, TrackerParams, TrackerRows};
use crate::results::BodyStep;

/// An [`Order`] in front of a [`Tracker`].
#[derive(Debug)]
pub struct OrderedTracker {
    order: Order,
    tracker: Tracker,
    rows: TrackerRows,
    /// Steps that went into the tracker.
    pub taken: u64,
}

impl OrderedTracker {
    /// From frame `first` on; a frame is given up as lost when one `patience_frames` newer was measured.
    pub fn new(params: &TrackerParams, first: u64, patience_frames: u64) -> Self {
        let bodies = u32::try_from(params.motion.len()).unwrap_or(u32::MAX);
        let mut order = Order::new(bodies, params.intervals_frames().collect(), patience_frames);
        order.start_at(first);
        Self { order, tracker: Tracker::new(params), rows: TrackerRows::default(), taken: 0 }
    }

    /// Takes a step in whatever order it arrives; gives the rows that became final.
    pub fn push(&mut self, step: BodyStep) -> &mut TrackerRows {
        self.push_seen(step, |_| {})
    }

    /// As [`push`](Self::push), and shows every step as soon as its turn has come.
    pub fn push_seen(&mut self, step: BodyStep, see: impl FnMut(&BodyStep)) -> &mut TrackerRows {
        self.order.push(step);
        self.advance(see)
    }

    /// Nothing more will come, up to frame `end` (one past the last).
    pub fn finish(&mut self, end: u64) -> &mut TrackerRows {
        if let Some(last) = end.checked_sub(1) {
            self.order.finish(last);
        }
        self.advance(|_| {});
        self.tracker.finish(&mut self.rows);
        &mut self.rows
    }

    /// Whether every frame before `end` went through.
    pub fn has_all_before(&self, end: u64) -> bool {
        self.order.has_given_all_before(end)
    }

    /// Rows that stand for lost frames, and steps that came after they were given up.
    pub fn losses(&self) -> (u64, u64) {
        (self.order.lost(), self.order.late())
    }

    fn advance(&mut self, mut see: impl FnMut(&BodyStep)) -> &mut TrackerRows {
        while let Some(step) = self.order.pop() {
            see(&step);
            self.tracker.push(&step, &mut self.rows);
            self.taken += 1;
        }
        &mut self.rows
    }
}
