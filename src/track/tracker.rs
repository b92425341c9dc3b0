//! Tracking: steps in frame order to tracks, velocities and impacts.

use std::collections::VecDeque;

use super::body_tracker::BodyTracker;
use super::rows::TrackerRows;
use crate::impact::Detector;
use crate::motion::MotionParams;
use crate::results::BodyStep;

/// The parameters of the tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerParams {
    /// The motion parameters of each body, in the order of the configuration.
    pub motion: Vec<MotionParams>,
    /// The further intervals of steps, all longer than that of `motion`, frames.
    pub longer_frames: Vec<u32>,
    /// Whether there is a surface to collide with; otherwise there are no phases and no impacts.
    pub contact: bool,
    /// The index of the body that is the surface; `None` for a fixed surface.
    pub surface_body: Option<u32>,
}

impl TrackerParams {
    /// Returns every interval, the shortest first, frames.
    pub fn intervals_frames(&self) -> impl Iterator<Item = u32> {
        self.motion.iter().take(1).map(|motion| motion.interval_frames).chain(self.longer_frames.iter().copied())
    }
}

/// Turns steps into tracks, velocities and impacts.
///
/// A pure function of the sequence of steps: the same steps give the same bits, live and offline. The
/// rows of a frame are emitted with the last step `lag_frames` frames later and use nothing newer. Impacts are emitted
/// as soon as they are measured.
#[derive(Debug, Clone)]
pub struct Tracker {
    bodies: Vec<BodyTracker>,
    /// The index of the body that is the surface.
    surface_body: Option<u32>,
    lag_frames: u64,
    /// The shortest interval of steps, frames.
    shortest_frames: u32,
    /// The interval of the last step of a body in a frame, frames.
    last_frames: u32,
    origin_ns: Option<u64>,
    pending: VecDeque<BodyStep>,
}

impl Tracker {
    /// Creates a tracker at the start of a stream.
    pub fn new(params: &TrackerParams) -> Self {
        let bodies = (0_u32..)
            .zip(&params.motion)
            .map(|(i, m)| {
                let strikes = params.contact && params.surface_body != Some(i);
                BodyTracker::new(i, m, strikes.then(|| Detector::new(m.lag_frames)))
            })
            .collect();
        let lag_frames = params.motion.iter().map(|motion| motion.lag_frames).max().unwrap_or(0);
        let shortest_frames = params.intervals_frames().next().unwrap_or(1);
        let last_frames = params.intervals_frames().last().unwrap_or(1);
        let surface_body = params.surface_body;
        let (origin_ns, pending) = (None, VecDeque::new());
        Self { bodies, surface_body, lag_frames, shortest_frames, last_frames, origin_ns, pending }
    }

    /// Processes the next step in frame order and appends finished rows.
    ///
    /// All bodies of a frame come before the next frame. Of one body, the step over the shortest interval comes
    /// first.
    ///
    /// # Panics
    ///
    /// If the step has a body that is none of the configured ones.
    pub fn push(&mut self, step: &BodyStep, rows: &mut TrackerRows) {
        let lag = self.lag_frames;
        if step.interval_frames == self.shortest_frames {
            // The frame that they were waiting for is missing.
            self.emit(|oldest| oldest.frame.saturating_add(lag) < step.frame, rows);
            self.process_shortest_step(step, rows);
        } else {
            self.bodies[step.body as usize].link(step);
        }
        if step.body as usize + 1 == self.bodies.len() && step.interval_frames == self.last_frames {
            self.emit(|oldest| oldest.frame.saturating_add(lag) <= step.frame, rows);
        }
    }

    /// Adds a step over the shortest interval to its body, and queues it until its rows are due.
    ///
    /// If the body is the surface, the others receive its position. The first step sets the origin of time.
    fn process_shortest_step(&mut self, step: &BodyStep, rows: &mut TrackerRows) {
        let origin_ns = *self.origin_ns.get_or_insert(step.stamp_ns);
        let body = &mut self.bodies[step.body as usize];
        let accepted = body.add_step(step, origin_ns, rows);
        self.pending.push_back(accepted);
        if self.surface_body == Some(step.body)
            && let Some(node) = self.bodies[step.body as usize].newest()
        {
            let others = self.bodies.iter_mut().enumerate().filter(|(index, _)| *index != step.body as usize);
            others.for_each(|(_, body)| body.add_surface_position(node));
        }
    }

    /// Ends the stream: everything held back becomes final.
    pub fn finish(&mut self, rows: &mut TrackerRows) {
        for body in &mut self.bodies {
            body.finish(&mut rows.impacts);
        }
        self.emit(|_| true, rows);
    }

    /// The number of frames by which rows lag behind steps.
    pub fn lag_frames(&self) -> u32 {
        u32::try_from(self.lag_frames).unwrap_or(u32::MAX)
    }

    /// Appends the rows of the oldest pending steps as long as `is_due` holds for the oldest.
    fn emit(&mut self, is_due: impl Fn(&BodyStep) -> bool, rows: &mut TrackerRows) {
        while let Some(step) = self.pending.front().copied().filter(&is_due) {
            self.pending.pop_front();
            let (track, velocity) = self.bodies[step.body as usize].rows(&step);
            rows.tracks.push(track);
            rows.velocities.push(velocity);
        }
    }
}
