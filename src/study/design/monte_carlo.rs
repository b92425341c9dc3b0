//! Propagation of the predicted pose noise to the motion and the collision.
//!
//! The simulated steps, truth plus noise, go through the rig's own tracker. Its local fits, flights and contact laws
//! propagate the noise (Monte Carlo propagation of distributions, JCGM 101).

use super::pose_noise::PoseNoise;
use super::rig::Rig;
use crate::dic::STALE_DEG;
use crate::motion::subset_walk;
use crate::numeric::{Stream, key};
use crate::process::analysis_params;
use crate::results::{
    BodyStep, Circle, Estimate, MotionMethod, Outline, OutlineShape, PointStatus, RigidStep, Rod, VelocitySample,
};
use crate::synth::SimulatedFilm;
use crate::track::{Tracker, TrackerParams, TrackerRows};

/// Purpose of these random numbers in the key of the generator.
const STEPS: u64 = 60;

/// The simulation of measured films: the true path of the body and the noise of its measurement.
#[derive(Debug, Clone)]
pub(super) struct FilmSimulation {
    noise: PoseNoise,
    /// The truth of each frame, and the angle, deg.
    frames: Vec<(VelocitySample, f64)>,
    /// Whether the reference is updated in each frame.
    renewed: Vec<bool>,
    intervals: Vec<u32>,
    params: TrackerParams,
}

impl FilmSimulation {
    /// Prepares simulations of a film that a rig measures with this noise.
    pub(super) fn new(rig: &Rig, film: &SimulatedFilm, noise: PoseNoise) -> Self {
        let (measure, mut params) = analysis_params(&rig.config, &rig.format());
        params.motion.truncate(1);
        let frames: Vec<_> = (0..film.frames()).map(|index| (film.truth(index), film.angle_deg(index))).collect();
        let mut kept_deg = 0.0;
        let renewed = frames.iter().enumerate().map(|(index, (_, angle_deg))| {
            let is_renewed = (index as u64).is_multiple_of(u64::from(measure.block_frames))
                || (angle_deg - kept_deg).abs() > STALE_DEG;
            if is_renewed {
                kept_deg = *angle_deg;
            }
            is_renewed
        });
        let renewed = renewed.collect();
        Self { noise, frames, renewed, intervals: measure.intervals_frames, params }
    }

    /// Simulates the film with the noise of this run and returns the tracker's rows.
    pub(super) fn simulate(&self, run: u64) -> TrackerRows {
        let mut stream = Stream::new(key(1, STEPS, run));
        let white: Vec<[f64; 3]> =
            (0..self.frames.len()).map(|index| self.draw_white_noise(index, &mut stream)).collect();
        let (mut tracker, mut rows) = (Tracker::new(&self.params), TrackerRows::default());
        for index in 0..self.frames.len() {
            let outline = self.simulate_outline(index, &mut stream);
            for interval in &self.intervals {
                let step = self.simulate_step(index, *interval, &white, &mut stream);
                tracker.push(&BodyStep { interval_frames: *interval, motion: step, ..outline }, &mut rows);
            }
        }
        tracker.finish(&mut rows);
        rows
    }

    /// Returns the scatter (sigma) of the pose in a frame (px, px, deg).
    ///
    /// It grows when the body is partly occluded, and shrinks between whole pixels from the reference.
    fn pose_sigma(&self, index: usize) -> [f64; 3] {
        let truth = &self.frames[index].0;
        let share = truth.visible_fraction.unwrap_or(1.0).max(0.05);
        // The frame that this one is matched with.
        let reference = self.renewed[..=index].iter().rposition(|renewed| *renewed).unwrap_or(0);
        self.noise.pose_at(self.motion_between(reference, index)).map(|sigma| sigma / share.sqrt())
    }

    /// Returns the motion of the centre between two frames, px.
    fn motion_between(&self, from: usize, to: usize) -> [f64; 2] {
        let place = |at: usize| {
            let truth = &self.frames[at].0;
            [truth.center_x_px, truth.center_y_px].map(Option::unwrap_or_default)
        };
        let (here, there) = (place(from), place(to));
        [there[0] - here[0], there[1] - here[1]]
    }

    /// Draws the independent error of the pose in a frame, px, px and deg, from a normal distribution.
    fn draw_white_noise(&self, index: usize, stream: &mut Stream) -> [f64; 3] {
        self.pose_sigma(index).map(|sigma| sigma * stream.normal())
    }

    /// Whether the body is visible in a frame.
    fn is_visible(&self, index: usize) -> bool {
        self.frames.get(index).is_some_and(|(truth, _)| truth.status == PointStatus::Valid)
    }

    /// Draws the outline of a frame around the true one, and returns it as a step without a motion.
    ///
    /// The step has no outline where the body is not visible.
    fn simulate_outline(&self, index: usize, stream: &mut Stream) -> BodyStep {
        let (truth, _) = &self.frames[index];
        let (is_visible, like) = (self.is_visible(index), &self.noise.step);
        let place = [truth.center_x_px, truth.center_y_px].map(Option::unwrap_or_default);
        let mut at = |k: usize, sigma: f64| place[k] + self.noise.center_offset_px[k] + sigma * stream.normal();
        let outline = like.outline.map(|outline| Outline {
            shape: match outline.shape {
                OutlineShape::Circle(circle) => OutlineShape::Circle(Circle {
                    x_px: at(0, circle.sigma_center_px),
                    y_px: at(1, circle.sigma_center_px),
                    visible_fraction: truth.visible_fraction.unwrap_or(1.0),
                    ..circle
                }),
                OutlineShape::Rod(rod) => OutlineShape::Rod(Rod {
                    x_px: Estimate { value: at(0, rod.x_px.sigma), ..rod.x_px },
                    y_px: Estimate { value: at(1, rod.y_px.sigma), ..rod.y_px },
                    ..rod
                }),
            },
            ..outline
        });
        BodyStep {
            frame: truth.frame,
            stamp_ns: truth.stamp_ns,
            body: 0,
            outline: outline.filter(|_| is_visible),
            motion: None,
            growth_fraction: None,
            drift: None,
            status: truth.status,
            ..*like
        }
    }

    /// Draws the step per frame from a frame over an interval; `None` if the body is not visible at both ends.
    ///
    /// It is the true motion plus the difference of the `white` errors of both poses and a random walk.
    fn simulate_step(&self, index: usize, interval: u32, white: &[[f64; 3]], stream: &mut Stream) -> Option<RigidStep> {
        // Drawn in any case, so that every variant of a rig has the same noise.
        let walk: [f64; 3] = std::array::from_fn(|_| stream.normal());
        let to = index + interval as usize;
        if !(self.is_visible(index) && self.is_visible(to)) {
            return None;
        }
        let ((here, angle), (there, turned)) = (&self.frames[index], &self.frames[to]);
        let truth = [there.center_x_px? - here.center_x_px?, there.center_y_px? - here.center_y_px?, turned - angle];
        let permanent = match self.noise.step.method {
            MotionMethod::WholeBody if self.renewed[index + 1..=to].contains(&true) => self.noise.renewal,
            MotionMethod::WholeBody | MotionMethod::Outlines => [0.0; 3],
            MotionMethod::Subsets => {
                let share = subset_walk(truth);
                std::array::from_fn(|k| share[k] * self.noise.walk[k] * self.noise.pose[k])
            }
        };
        let (first, second, frames) = (self.pose_sigma(index), self.pose_sigma(to), f64::from(interval));
        let moved = |k: usize| (truth[k] + white[to][k] - white[index][k] + permanent[k] * walk[k]) / frames;
        let sigma = |k: usize| self.noise.reported_ratio[k] * first[k].hypot(second[k]) / frames;
        Some(RigidStep {
            dx_px: moved(0),
            dy_px: moved(1),
            dtheta_deg: moved(2),
            sigma_dx_px: sigma(0),
            sigma_dy_px: sigma(1),
            sigma_dtheta_deg: sigma(2),
            points: self.noise.step.motion.map_or(0, |step| step.points),
        })
    }
}
