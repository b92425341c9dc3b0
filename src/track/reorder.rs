//! Reordering of steps from several workers into frame order.

use std::collections::BTreeMap;

use crate::results::{BodyStep, PointStatus};

/// Number of missing frames that may have rows of their own, in addition to one for each measured frame.
const FREE_LOST_FRAMES: u64 = 1000;

/// A buffer that puts steps that arrive in blocks into (frame, body) order.
///
/// The output does not depend on the order of arrival as long as everything arrives. A missing step is given up when a
/// step `patience_frames` newer arrives, or on request. A row with status `lost` takes its place, with a stamp
/// interpolated between its neighbours. Steps that arrive later are dropped and counted.
///
/// A gap so long that over 1000 frames more would be missing than were measured has the rows of its first frame alone.
/// Its length is the distance to the next frame. So a jump of the numbers takes no memory.
#[derive(Debug, Clone)]
pub struct ReorderBuffer {
    bodies: u32,
    /// The intervals of the steps of one body and frame, in output order.
    intervals_frames: Vec<u32>,
    patience_frames: u64,
    next: Option<(u64, u32)>,
    waiting: BTreeMap<(u64, u32), BodyStep>,
    newest_frame: u64,
    give_up_before: u64,
    /// The newest two emitted rows of different frames, older first; the stamps of lost ones are interpolated.
    emitted: [Option<BodyStep>; 2],
    lost: u64,
    late: u64,
    measured_frames: u64,
    /// Whether a step of the next frame was emitted already.
    has_step: bool,
    /// The number of frames with rows of their own whose steps never came.
    lost_frames: u64,
}

impl ReorderBuffer {
    /// Creates a buffer for steps of `bodies` bodies over these intervals, which waits at most `patience_frames`.
    pub fn new(bodies: u32, intervals_frames: Vec<u32>, patience_frames: u64) -> Self {
        Self {
            bodies,
            intervals_frames,
            patience_frames,
            next: None,
            waiting: BTreeMap::new(),
            newest_frame: 0,
            give_up_before: 0,
            emitted: [None; 2],
            lost: 0,
            late: 0,
            measured_frames: 0,
            has_step: false,
            lost_frames: 0,
        }
    }

    /// Sets the first frame; nothing is emitted before. Steps of older frames are late.
    pub fn start_at(&mut self, frame: u64) {
        self.next = Some((frame, 0));
        let kept = self.waiting.split_off(&(frame, 0));
        self.late += self.waiting.len() as u64;
        self.waiting = kept;
    }

    /// Adds a step. A late step or a duplicate is dropped and counted as late.
    ///
    /// # Panics
    ///
    /// If the step has a body or an interval that is none of the configured ones.
    pub fn push(&mut self, step: BodyStep) {
        let slot = self.intervals_frames.iter().position(|interval| *interval == step.interval_frames);
        assert!(step.body < self.bodies, "body {} of {}", step.body, self.bodies);
        let Some(slot) = slot else { panic!("interval {} of {:?}", step.interval_frames, self.intervals_frames) };
        let key = (step.frame, step.body * self.interval_count() + slot as u32);
        if self.next.is_some_and(|next| key < next) || self.waiting.contains_key(&key) {
            self.late += 1;
            return;
        }
        self.newest_frame = self.newest_frame.max(step.frame);
        self.waiting.insert(key, step);
    }

    /// Adds the rows of a frame that was not measured on purpose, and counts them as lost.
    pub fn skip(&mut self, frame: u64, stamp_ns: u64) {
        for body in 0..self.bodies {
            for interval_frames in self.intervals_frames.clone() {
                let late = self.late;
                let lost = PointStatus::Lost;
                self.push(BodyStep { frame, stamp_ns, body, interval_frames, status: lost, ..BodyStep::default() });
                self.lost += u64::from(self.late == late);
            }
        }
    }

    /// Gives up the missing steps of all frames before `frame`.
    pub fn give_up_before(&mut self, frame: u64) {
        self.give_up_before = self.give_up_before.max(frame);
    }

    /// Ends the stream with `last_frame`: every row up to that frame can be popped now.
    pub fn finish(&mut self, last_frame: u64) {
        self.give_up_before(last_frame.saturating_add(1));
    }

    /// Returns the next step in order, or the row of a lost one.
    ///
    /// `None` while it may still arrive, before the first frame is set, and without bodies.
    pub fn pop(&mut self) -> Option<BodyStep> {
        if self.bodies == 0 {
            return None;
        }
        loop {
            let next = self.next?;
            let row = match self.waiting.remove(&next) {
                Some(step) => {
                    self.has_step = true;
                    Some(step)
                }
                None if self.is_given_up(next.0) => {
                    self.lost += 1;
                    self.lost_row(next.0, next.1)
                }
                None => return None,
            };
            let is_last = next.1 + 1 == self.bodies * self.interval_count();
            self.next = Some(if is_last { (self.end_frame(next.0), 0) } else { (next.0, next.1 + 1) });
            if let Some(step) = row {
                self.store_emitted(step);
                return Some(step);
            }
        }
    }

    /// Whether every row of the frames before `end` was emitted.
    pub fn has_emitted_before(&self, end: u64) -> bool {
        self.next.is_some_and(|(frame, _)| frame >= end)
    }

    /// The number of steps that never came, including those of gaps too long for rows of their own.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// The number of steps that came too late, or twice.
    pub fn late(&self) -> u64 {
        self.late
    }

    /// The number of steps held back.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Ends a frame whose rows were all emitted. Returns the next frame, beyond a gap that is too long for rows of
    /// its own.
    fn end_frame(&mut self, frame: u64) -> u64 {
        let next = frame.saturating_add(1);
        if std::mem::take(&mut self.has_step) {
            self.measured_frames += 1;
            return next;
        }
        let given_up =
            self.give_up_before.max(self.newest_frame.saturating_sub(self.patience_frames).saturating_add(1));
        let waiting = self.waiting.first_key_value().map_or(u64::MAX, |(key, _)| key.0);
        let missing = given_up.min(waiting).saturating_sub(next);
        self.lost_frames += 1;
        if self.lost_frames.saturating_add(missing) <= self.measured_frames + FREE_LOST_FRAMES {
            return next;
        }
        self.lost = self.lost.saturating_add(missing.saturating_mul(u64::from(self.bodies * self.interval_count())));
        next + missing
    }

    /// The number of steps of one body per frame.
    fn interval_count(&self) -> u32 {
        self.intervals_frames.len() as u32
    }

    /// Whether missing steps of a frame are no longer awaited.
    fn is_given_up(&self, frame: u64) -> bool {
        frame < self.give_up_before || frame.saturating_add(self.patience_frames) <= self.newest_frame
    }

    /// Keeps an emitted step for the interpolation of stamps.
    fn store_emitted(&mut self, step: BodyStep) {
        match self.emitted[1] {
            Some(last) if last.frame == step.frame => {}
            last => self.emitted = [last, Some(step)],
        }
    }

    /// Returns a row for a missing step; `None` without any row to take its time from.
    ///
    /// `slot` is its index in the frame: body by body, and interval by interval within a body.
    fn lost_row(&self, frame: u64, slot: u32) -> Option<BodyStep> {
        let mut ahead = self.waiting.values().filter(|s| s.frame >= frame);
        let first = ahead.next().copied();
        let second = first.and_then(|f| ahead.find(|s| s.frame > f.frame).copied());
        // The known rows on either side, or else the nearest two on one side.
        let (a, b) = match (self.emitted[1], first, self.emitted[0], second) {
            (Some(a), _, _, _) if a.frame == frame => (a, a),
            (_, Some(b), _, _) if b.frame == frame => (b, b),
            (Some(a), Some(b), _, _) => (a, b),
            (Some(b), None, Some(a), _) => (a, b),
            (Some(a), None, None, _) => (a, a),
            (None, Some(a), _, Some(b)) => (a, b),
            (None, Some(a), _, None) => (a, a),
            (None, None, _, _) => return None,
        };
        Some(BodyStep {
            frame,
            body: slot / self.interval_count(),
            stamp_ns: interpolate_stamp(frame, &a, &b),
            interval_frames: self.intervals_frames[(slot % self.interval_count()) as usize],
            status: PointStatus::Lost,
            ..BodyStep::default()
        })
    }
}

/// Interpolates the stamp of a frame linearly between two steps, or extrapolates it, ns.
fn interpolate_stamp(frame: u64, a: &BodyStep, b: &BodyStep) -> u64 {
    if a.frame == b.frame {
        return a.stamp_ns;
    }
    let span_frames = i128::from(b.frame) - i128::from(a.frame);
    let span_ns = i128::from(b.stamp_ns) - i128::from(a.stamp_ns);
    let offset = span_ns * (i128::from(frame) - i128::from(a.frame)) / span_frames;
    u64::try_from(i128::from(a.stamp_ns) + offset).unwrap_or(a.stamp_ns)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(frame: u64, body: u32) -> BodyStep {
        let stamp_ns = 1_000 + 100 * frame;
        BodyStep { frame, stamp_ns, body, interval_frames: 1, ..BodyStep::default() }
    }

    fn drain(order: &mut ReorderBuffer) -> Vec<BodyStep> {
        std::iter::from_fn(|| order.pop()).collect()
    }

    #[test]
    fn the_order_of_arrival_does_not_matter() {
        let mut state = 12_345_u64;
        let mut random = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) as usize) % below
        };
        let all: Vec<_> = (5..25).flat_map(|frame| (0..3).map(move |body| step(frame, body))).collect();
        for _ in 0..200 {
            let mut shuffled = all.clone();
            for i in (1..shuffled.len()).rev() {
                shuffled.swap(i, random(i + 1));
            }
            let mut order = ReorderBuffer::new(3, vec![1], 1_000);
            order.start_at(5);
            let mut out = Vec::new();
            for s in shuffled {
                order.push(s);
                out.extend(drain(&mut order));
            }
            assert_eq!(out, all);
            assert_eq!((order.lost(), order.late(), order.waiting()), (0, 0, 0));
        }
    }

    #[test]
    fn a_missing_frame_is_waited_for_and_then_lost_with_an_interpolated_stamp() {
        let mut order = ReorderBuffer::new(1, vec![1], 4);
        order.start_at(0);
        for frame in [0, 1, 3, 4, 5] {
            order.push(step(frame, 0));
        }
        assert_eq!(drain(&mut order).len(), 2, "frame 2 may still come");
        order.push(step(6, 0));
        let out = drain(&mut order);
        assert_eq!(out.len(), 5);
        assert_eq!((out[0].frame, out[0].stamp_ns, out[0].status), (2, 1_200, PointStatus::Lost));
        order.push(step(2, 0));
        assert_eq!((order.lost(), order.late()), (1, 1));
        assert!(drain(&mut order).is_empty());
    }

    #[test]
    fn the_stream_ends_complete_whatever_is_missing() {
        let mut order = ReorderBuffer::new(2, vec![1], 1_000);
        order.start_at(10);
        order.push(step(11, 1));
        order.push(step(12, 0));
        order.finish(14);
        let out = drain(&mut order);
        let keys: Vec<_> = out.iter().map(|s| (s.frame, s.body)).collect();
        let all: Vec<_> = (10..15).flat_map(|frame| (0..2).map(move |body| (frame, body))).collect();
        assert_eq!(keys, all);
        assert!(out.iter().all(|s| s.stamp_ns == 1_000 + 100 * s.frame), "{out:?}");
        assert_eq!(order.lost(), 8);
        assert!(order.pop().is_none());
    }

    #[test]
    fn nothing_comes_out_before_the_start_is_known() {
        let mut order = ReorderBuffer::new(1, vec![1], 2);
        order.push(step(7, 0));
        order.push(step(8, 0));
        assert!(order.pop().is_none());
        order.start_at(8);
        assert_eq!(drain(&mut order), [step(8, 0)]);
        assert_eq!(order.late(), 1);
    }

    #[test]
    fn a_worker_that_died_is_given_up_at_once_on_request() {
        let mut order = ReorderBuffer::new(1, vec![1], 1_000_000);
        order.start_at(0);
        order.push(step(0, 0));
        order.push(step(9, 0));
        order.give_up_before(9);
        assert_eq!(drain(&mut order).len(), 10);
        assert_eq!(order.lost(), 8);
    }

    #[test]
    fn a_jump_of_the_numbers_is_one_row_and_counted_whole() {
        let far = 1 << 50;
        for patience_frames in [10, u64::MAX] {
            let mut order = ReorderBuffer::new(2, vec![1], patience_frames);
            order.start_at(0);
            let frames: Vec<u64> = (0..50).chain(far..far + 50).collect();
            frames.iter().for_each(|frame| (0..2).for_each(|body| order.push(step(*frame, body))));
            order.finish(far + 49);
            let out = drain(&mut order);
            let mut kept: Vec<u64> = out.iter().filter(|row| row.body == 1).map(|row| row.frame).collect();
            let gap = kept.remove(50);
            assert_eq!((gap, &kept), (50, &frames), "one row for the gap");
            assert_eq!(order.lost(), 2 * (far - 50));
        }
    }

    #[test]
    fn a_stream_without_a_step_ends_at_once_however_long_it_is() {
        let mut order = ReorderBuffer::new(1, vec![1], 10);
        order.start_at(3);
        order.finish(u64::MAX - 1);
        assert!(order.pop().is_none());
        assert_eq!(order.lost(), u64::MAX - 3, "3 to u64::MAX - 1");
    }

    #[test]
    fn a_frame_with_no_neighbour_in_time_is_only_counted() {
        let mut order = ReorderBuffer::new(1, vec![1], 10);
        order.start_at(3);
        order.finish(5);
        assert!(order.pop().is_none());
        assert_eq!(order.lost(), 3);
    }
}
