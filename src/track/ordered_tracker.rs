//! A tracker for steps in any order, live and over a recorded shot.

use super::{ReorderBuffer, Tracker, TrackerParams, TrackerRows};
use crate::results::BodyStep;

/// A [`ReorderBuffer`] in front of a [`Tracker`].
#[derive(Debug)]
pub struct OrderedTracker {
    buffer: ReorderBuffer,
    tracker: Tracker,
    rows: TrackerRows,
    /// The number of steps that the tracker received, including the rows of lost ones.
    pub taken: u64,
}

impl OrderedTracker {
    /// Creates a tracker that starts at frame `first`.
    ///
    /// A frame is given up as lost once one `max_delay_frames` newer was measured.
    pub fn new(params: &TrackerParams, first: u64, max_delay_frames: u64) -> Self {
        let bodies = u32::try_from(params.motion.len()).unwrap_or(u32::MAX);
        let mut buffer = ReorderBuffer::new(bodies, params.intervals_frames().collect(), max_delay_frames);
        buffer.start_at(first);
        Self { buffer, tracker: Tracker::new(params), rows: TrackerRows::default(), taken: 0 }
    }

    /// Adds a step in any order; returns all rows that the caller has not taken out.
    ///
    /// # Panics
    ///
    /// If the step has a body or an interval that is none of the configured ones.
    pub fn push(&mut self, step: BodyStep) -> &mut TrackerRows {
        self.push_observed(step, |_| {})
    }

    /// Like [`push`](Self::push), and passes every step to `observe` in frame order, with the rows of lost ones.
    pub fn push_observed(&mut self, step: BodyStep, observe: impl FnMut(&BodyStep)) -> &mut TrackerRows {
        self.buffer.push(step);
        self.advance(observe)
    }

    /// Adds the rows of a frame that was not measured on purpose, and passes every step that is now in order to `observe`.
    pub fn skip_observed(&mut self, frame: u64, stamp_ns: u64, observe: impl FnMut(&BodyStep)) -> &mut TrackerRows {
        self.buffer.skip(frame, stamp_ns);
        self.advance(observe)
    }

    /// Ends the stream before frame `end`: completes all earlier frames, and returns all rows not taken out.
    pub fn finish(&mut self, end: u64) -> &mut TrackerRows {
        if let Some(last) = end.checked_sub(1) {
            self.buffer.finish(last);
        }
        self.advance(|_| {});
        self.tracker.finish(&mut self.rows);
        &mut self.rows
    }

    /// Whether the tracker has received every step of the frames before `end`, or its loss.
    pub fn has_all_before(&self, end: u64) -> bool {
        self.buffer.has_emitted_before(end)
    }

    /// Returns the counts of lost and late steps.
    pub fn losses(&self) -> Losses {
        Losses { lost: self.buffer.lost(), late: self.buffer.late() }
    }

    /// Passes the steps that are in order to the tracker, and to `observe`. Returns all rows not taken out.
    fn advance(&mut self, mut observe: impl FnMut(&BodyStep)) -> &mut TrackerRows {
        while let Some(step) = self.buffer.pop() {
            observe(&step);
            self.tracker.push(&step, &mut self.rows);
            self.taken += 1;
        }
        &mut self.rows
    }
}

/// Losses of a tracker.
#[derive(Debug, Clone, Copy, Default)]
pub struct Losses {
    /// Steps that never came, including those of gaps too long for rows of their own.
    pub lost: u64,
    /// Steps that came after their frame was given up, or twice.
    pub late: u64,
}
