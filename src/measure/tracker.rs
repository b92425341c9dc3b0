//! Steps in frame order to tracks, velocities and impacts.

use std::collections::VecDeque;

use super::body::BodyTracker;
use crate::motion::{MotionParams, lag_frames};
use crate::results::{Alarm, BodyStep, Impact, TrackSample, VelocitySample};

/// What the tracker computes with.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerParams {
    /// One a body, in the order of the configuration.
    pub motion: Vec<MotionParams>,
    /// Intervals besides that of `motion` over which steps are measured, all longer, frames.
    pub longer_frames: Vec<u32>,
    /// Whether there is a surface to collide with; without, there are no phases and no impacts.
    pub contact: bool,
}

impl TrackerParams {
    /// Every interval, the shortest first, frames.
    pub fn intervals_frames(&self) -> impl Iterator<Item = u32> {
        self.motion.iter().take(1).map(|motion| motion.interval_frames).chain(self.longer_frames.iter().copied())
    }
}

/// Rows that became final, in the order they did. The tracker appends, the caller takes them out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrackerRows {
    /// One a step, in the order of the steps.
    pub tracks: Vec<TrackSample>,
    /// One a step, in the order of the steps.
    pub velocities: Vec<VelocitySample>,
    /// One or several a collision; of one `body` and `number` the highest `revision` counts.
    pub impacts: Vec<Impact>,
    /// What is noticed of a collision before it is over.
    pub alarms: Vec<Alarm>,
}

/// Turns steps into tracks, velocities and impacts.
///
/// A pure function of the sequence of steps: the same steps give the same bits,
/// live and afterwards. A frame's rows come when the first step of the frame
/// `lag_frames + 1` later does; they use nothing newer. Impacts come as soon as
/// they are known.
#[derive(Debug, Clone)]
pub struct Tracker {
    bodies: Vec<BodyTracker>,
    lag_frames: u64,
    shortest_frames: u32,
    origin_ns: Option<u64>,
    pending: VecDeque<BodyStep>,
}

impl Tracker {
    /// A tracker at the beginning of a stream.
    pub fn new(params: &TrackerParams) -> Self {
        let bodies = (0_u32..).zip(&params.motion).map(|(i, m)| BodyTracker::new(i, m, params.contact)).collect();
        let lag_frames = params.motion.iter().map(lag_frames).max().unwrap_or(0);
        let shortest_frames = params.intervals_frames().next().unwrap_or(1);
        Self { bodies, lag_frames, shortest_frames, origin_ns: None, pending: VecDeque::new() }
    }

    /// Takes the next step in frame order, all bodies of a frame before the next frame, and of a body the step over
    /// the shortest interval before the longer ones.
    ///
    /// # Panics
    /// If the step's body is none of the configured ones.
    pub fn push(&mut self, step: &BodyStep, rows: &mut TrackerRows) {
        if step.interval_frames != self.shortest_frames {
            self.bodies[step.body as usize].link(step);
            return;
        }
        let lag = self.lag_frames;
        self.give_out(|oldest| oldest.frame.saturating_add(lag) < step.frame, rows);
        let origin_ns = *self.origin_ns.get_or_insert(step.stamp_ns);
        let body = &mut self.bodies[step.body as usize];
        let believed = body.push(step, origin_ns, rows);
        self.pending.push_back(believed);
    }

    /// The stream has ended: everything held back becomes final.
    pub fn finish(&mut self, rows: &mut TrackerRows) {
        for body in &mut self.bodies {
            body.finish(&mut rows.impacts);
        }
        self.give_out(|_| true, rows);
    }

    /// By how many frames rows come behind steps.
    pub fn lag_frames(&self) -> u32 {
        u32::try_from(self.lag_frames).unwrap_or(u32::MAX)
    }

    fn give_out(&mut self, is_due: impl Fn(&BodyStep) -> bool, rows: &mut TrackerRows) {
        while let Some(step) = self.pending.front().copied().filter(&is_due) {
            self.pending.pop_front();
            let (track, velocity) = self.bodies[step.body as usize].rows(&step);
            rows.tracks.push(track);
            rows.velocities.push(velocity);
        }
    }
}
