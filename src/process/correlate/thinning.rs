//! The blocks that a worker leaves out on purpose while the camera is faster than it.
//!
//! A worker that only fell behind, by a pause, catches up and measures everything. One that is slower than the camera would
//! lose frames wherever its queue overflows. It measures every k-th of its blocks instead, so that what it measures is
//! complete. k follows from the number of frames that come while it measures a block. A block for whose frames the queue
//! has no room is left out as well: load that begins suddenly must not overflow the queue until k has followed.

use crate::numeric::median;
use std::collections::VecDeque;

/// The share of the queue from which blocks are left out, and the share below which fewer are.
const THIN_SHARE: f64 = 0.5;
const FULL_SHARE: f64 = 0.25;
/// The share of the queue that stays free for the frames that come while a block is measured, and its least multiple of
/// those that came during the longest of the last blocks.
const SPARE_SHARE: f64 = 0.25;
const SPARE_BLOCKS: f64 = 2.0;
/// The number of measured blocks that k is computed from.
const BLOCKS: usize = 8;
/// The number of measured blocks below which k is at most 2.
const MIN_BLOCKS: usize = 4;
/// The factor by which k exceeds what is just enough, so that the backlog shrinks.
const RESERVE: f64 = 1.1;
/// The maximum k.
const MAX_EVERY: u64 = 64;

/// The queue of a worker at the start of one of its blocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Queue {
    /// The newest frame of the camera.
    pub(super) newest: u64,
    /// The number of waiting frames, and their maximum.
    pub(super) waiting: u64,
    pub(super) capacity: u64,
}

/// The blocks of a worker that are measured.
#[derive(Debug, Clone)]
pub(super) struct Thinning {
    /// Every k-th block is measured.
    every: u64,
    /// The number of the camera's frames for each block of the worker.
    block_frames: u64,
    /// The queue at the start of the block that is being measured.
    started: Option<Queue>,
    /// The newest frame of the camera when the last frame was measured, and the most that came between two.
    newest: u64,
    longest: u64,
    /// The durations of the last measured blocks, as a multiple of the time in which the camera fills one.
    durations: VecDeque<f64>,
    /// The number of measured blocks since the last change of k.
    settled: usize,
}

impl Thinning {
    /// Measures every block. The camera takes `block_frames` frames for each block of the worker.
    pub(super) fn new(block_frames: u64) -> Self {
        Self { every: 1, block_frames, started: None, newest: 0, longest: 0, durations: VecDeque::new(), settled: 0 }
    }

    /// Returns k: every k-th block is measured.
    pub(super) fn every(&self) -> u64 {
        self.every
    }

    /// Forgets the queue of the run before, whose frames may have had other numbers.
    pub(super) fn begin_run(&mut self) {
        self.started = None;
        self.durations.clear();
    }

    /// Begins the block with this number among those of the worker. Returns whether it is to be measured.
    pub(super) fn begin_block(&mut self, block: u64, queue: Queue) -> bool {
        if let Some(started) = self.started.take() {
            self.settled += 1;
            // Otherwise it may have waited for frames.
            if started.waiting.min(queue.waiting) >= self.block_frames {
                // The longest time between two frames may contain a pause.
                let came = queue.newest.saturating_sub(started.newest + self.longest);
                self.durations.push_back(came as f64 / self.block_frames as f64);
                self.durations.drain(..self.durations.len().saturating_sub(BLOCKS));
            }
        }
        let has_room = self.has_room(queue);
        let every = self.adapted(queue.waiting as f64 / queue.capacity.max(1) as f64).max(if has_room { 1 } else { 2 });
        if every != self.every {
            (self.every, self.settled) = (every, 0);
        }
        let is_measured = block.is_multiple_of(self.every) && has_room;
        self.started = is_measured.then_some(queue);
        (self.newest, self.longest) = (queue.newest, 0);
        is_measured
    }

    /// Records the newest frame of the camera when a frame of a block was measured.
    pub(super) fn record_frame(&mut self, newest: u64) {
        self.longest = self.longest.max(newest.saturating_sub(self.newest));
        self.newest = newest;
    }

    /// Returns whether the frames that come while a block is measured fit into the queue.
    fn has_room(&self, queue: Queue) -> bool {
        let longest = self.durations.iter().copied().fold(0.0, f64::max);
        let capacity = queue.capacity as f64;
        let spare = (SPARE_BLOCKS * longest * self.block_frames as f64).max(SPARE_SHARE * capacity);
        // A queue that is shorter than that of a slow block would never be measured.
        (queue.waiting as f64) <= (capacity - spare).max(THIN_SHARE * capacity)
    }

    /// Returns k for a queue that is full by this share.
    fn adapted(&self, share: f64) -> u64 {
        match share {
            _ if share >= THIN_SHARE => self.every.max(self.enough().unwrap_or(1)),
            // The durations may be those of harder frames.
            _ if share < FULL_SHARE && self.settled >= BLOCKS => (self.every / 2).max(1),
            _ => self.every,
        }
    }

    /// Returns the k with which the backlog shrinks, at most 2 as long as few blocks were measured, since the first ones take
    /// longer. `None` if no block was measured without a wait for frames.
    fn enough(&self) -> Option<u64> {
        let mut durations: Vec<f64> = self.durations.iter().copied().collect();
        let max = if durations.len() < MIN_BLOCKS { 2 } else { MAX_EVERY };
        let typical = median(&mut durations)?;
        Some(((RESERVE * typical).ceil() as u64).clamp(1, max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAPACITY: u64 = 1600;

    /// Plays a camera that delivers `ratio` blocks while the worker measures one, from a backlog of `waiting` frames on.
    /// Returns k and the backlog after each block of 16 frames.
    fn play(thinning: &mut Thinning, ratio: f64, mut waiting: f64, blocks: u64) -> Vec<(u64, f64)> {
        let mut newest = thinning.newest as f64;
        let mut states = Vec::new();
        for block in 0..blocks {
            let queue = Queue { newest: newest as u64, waiting: waiting as u64, capacity: CAPACITY };
            let frames = if thinning.begin_block(block, queue) { 16.0 * ratio } else { 0.2 };
            // A worker without a backlog waits for its frames.
            let frames = frames.max(16.0 - waiting);
            (1..=16).for_each(|part| thinning.record_frame((newest + frames / 16.0 * f64::from(part)) as u64));
            newest += frames;
            waiting += frames - 16.0;
            states.push((thinning.every(), waiting));
        }
        states
    }

    #[test]
    fn a_worker_that_is_too_slow_measures_fewer_blocks_and_loses_none() {
        for ratio in [1.1, 1.7, 3.2, 6.0, 20.0] {
            let states = play(&mut Thinning::new(16), ratio, 0.0, 4000);
            let most = states.iter().map(|(_, waiting)| *waiting).fold(0.0, f64::max);
            assert!(most < CAPACITY as f64, "{ratio}: {most}");
            let settled = &states[1000..];
            assert!(settled.iter().all(|(every, _)| (*every as f64) < RESERVE * ratio + 1.1), "{ratio}");
            assert!(settled.iter().any(|(every, _)| *every as f64 > ratio), "{ratio}");
        }
    }

    #[test]
    fn load_that_begins_suddenly_overflows_no_queue() {
        for ratio in [10.0, 20.0, 30.0] {
            let mut thinning = Thinning::new(16);
            let states = play(&mut thinning, 1.5, 0.0, 2000);
            let (_, waiting) = states[1999];
            let most = play(&mut thinning, ratio, waiting, 200).iter().map(|(_, waiting)| *waiting).fold(0.0, f64::max);
            assert!(most < CAPACITY as f64, "{ratio}: {most}");
        }
    }

    #[test]
    fn a_worker_that_only_paused_catches_up() {
        let mut thinning = Thinning::new(16);
        play(&mut thinning, 0.8, 100.0, 1);
        // The pause lies within a measured block.
        thinning.record_frame(thinning.newest + 1500);
        let states = play(&mut thinning, 0.8, 1590.0, 1000);
        // The queue was almost full at first.
        let less = states.iter().filter(|(every, _)| *every > 1).count();
        assert!(less < 150 && states.iter().all(|(every, _)| *every <= 2), "{less}");
        assert!(states[999].1 < 16.0);
    }

    #[test]
    fn a_worker_measures_everything_again_once_the_camera_is_slow() {
        let mut thinning = Thinning::new(16);
        play(&mut thinning, 3.0, 0.0, 400);
        assert!(thinning.every() > 2);
        play(&mut thinning, 0.5, 300.0, 1000);
        assert_eq!(thinning.every(), 1);
    }
}
