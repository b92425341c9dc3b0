//! The prediction of a position: a fit of the newest positions and steps of a body in free flight.

use crate::results::{BodyStep, OutlineShape, PointStatus, Rod};
use std::collections::VecDeque;

/// The minimum uncertainty of a position, px. Outlines have an error that stays the same from frame to frame.
const MIN_POSITION_SIGMA_PX: f64 = 0.05;
/// The minimum uncertainty of a step, px/frame.
const MIN_STEP_SIGMA_PX: f64 = 0.003;
/// The distance from the predicted position beyond which a position is an outlier, sigmas ...
const OUTLIER_SIGMAS: f64 = 6.0;
/// ... and at least this, px.
const OUTLIER_PX: f64 = 0.5;
/// The number of consecutive outliers that begin another flight.
const OUTLIER_FRAMES: usize = 3;

/// The position of a body in one frame, and its motion.
#[derive(Debug, Clone, Copy)]
struct Position {
    frame: u64,
    /// The centre of the body, or the end of a rod.
    at_px: [f64; 2],
    /// The standard uncertainty along each axis.
    sigma_px: f64,
    /// The radius of a ball; 0 for other bodies.
    radius_px: f64,
    /// The motion to a later frame, if it was measured.
    step: Option<Step>,
}

/// The motion from a frame to a later one.
#[derive(Debug, Clone, Copy)]
struct Step {
    /// Along x and y, px/frame.
    rate_px: [f64; 2],
    /// The standard uncertainty of each, px/frame.
    sigma_px: f64,
    /// The interval it was measured over, frames.
    interval_frames: f64,
}

/// The position and the motion of a body at the newest frame; image axes, px and frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// The newest frame.
    pub frame: u64,
    /// The number of frames it rests on.
    pub frames: usize,
    /// The centre.
    pub at_px: [f64; 2],
    /// The motion per frame.
    pub rate_px: [f64; 2],
    /// The standard uncertainty of the centre along each axis.
    pub sigma_at_px: f64,
    /// The standard uncertainty of the motion along each axis.
    pub sigma_rate_px: f64,
    /// The covariance of centre and motion along each axis, px²/frame.
    covariance: f64,
    /// The mean radius; 0 where the body has none.
    pub radius_px: f64,
}

impl Fit {
    /// Returns the standard uncertainty of the predicted centre along each axis, px, this many frames later (or earlier
    /// if negative).
    ///
    /// It is never below that of the centre at the newest frame, and includes [`MIN_POSITION_SIGMA_PX`].
    pub fn sigma_after(&self, frames: f64) -> f64 {
        let variance =
            self.sigma_at_px.powi(2) + frames * (2.0 * self.covariance + frames * self.sigma_rate_px.powi(2));
        // The error of outlines is correlated between neighbouring frames, so it does not average out.
        (variance.max(self.sigma_at_px.powi(2)) + MIN_POSITION_SIGMA_PX * MIN_POSITION_SIGMA_PX).sqrt()
    }
}

/// The present free flight of one body.
#[derive(Debug, Clone)]
pub(super) struct Flight {
    /// The maximum number of frames in the fit.
    max_frames: usize,
    /// The distance of a rod's end below its lowest edge, px; `None` for the flight of the body's centre.
    end_px: Option<f64>,
    positions: VecDeque<Position>,
    /// The number of outliers at the end of `positions`.
    outliers: usize,
}

impl Flight {
    /// Creates an empty flight whose fits use at most `max_frames` frames. With `end_px` it is the flight of a rod's
    /// end, which lies this far below its lowest edge.
    pub fn new(max_frames: usize, end_px: Option<f64>) -> Self {
        Self { max_frames, end_px, positions: VecDeque::new(), outliers: 0 }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.positions.clear();
        self.outliers = 0;
    }

    /// Adds the position of the body in the next frame, if it is visible, and returns whether it is.
    ///
    /// Without a visible body nothing changes. A position far from the prediction counts as an outlier;
    /// [`OUTLIER_FRAMES`] of them in a row begin another flight. The oldest positions beyond the maximum number of
    /// frames are dropped. `gravity_px` is the acceleration of gravity, px/frame², image axes.
    pub fn add_step(&mut self, step: &BodyStep, gravity_px: [f64; 2]) -> bool {
        let Some(position) = position(step, self.end_px) else { return false };
        let expected = self.fit_first(self.positions.len() - self.outliers, gravity_px);
        let is_outlier = expected.is_some_and(|fit| {
            let ahead = (position.frame - fit.frame) as f64;
            let distance = |axis: usize| {
                let predicted = fit.at_px[axis] + ahead * (fit.rate_px[axis] + 0.5 * ahead * gravity_px[axis]);
                (position.at_px[axis] - predicted).abs()
            };
            distance(0).max(distance(1))
                > (OUTLIER_SIGMAS * fit.sigma_after(ahead).hypot(position.sigma_px)).max(OUTLIER_PX)
        });
        self.positions.push_back(position);
        self.outliers = if is_outlier { self.outliers + 1 } else { 0 };
        if self.outliers >= OUTLIER_FRAMES {
            self.positions.drain(..self.positions.len() - self.outliers);
            self.outliers = 0;
        }
        while self.positions.len() > self.max_frames {
            self.positions.pop_front();
        }
        true
    }

    /// Returns the radius at the newest position, px, 0 for bodies without one; `None` before the body was visible.
    pub fn radius_px(&self) -> Option<f64> {
        self.positions.back().map(|position| position.radius_px)
    }

    /// Whether the newest position is an outlier.
    pub fn ends_with_outlier(&self) -> bool {
        self.outliers > 0
    }

    /// Fits a free flight to all positions, including outliers at their end; `None` if there are fewer than three.
    ///
    /// `gravity_px` is the acceleration of gravity, px/frame², image axes.
    pub fn fit(&self, gravity_px: [f64; 2]) -> Option<Fit> {
        self.fit_first(self.positions.len(), gravity_px)
    }

    /// Fits the first `count` positions by weighted linear least squares with known gravity, px/frame², image axes.
    ///
    /// Returns the centre and the motion at the last of them; `None` if there are fewer than three. The observations
    /// are the positions and the steps between them, weighted by the inverse squares of their uncertainties. Both axes
    /// have the same normal equations.
    fn fit_first(&self, count: usize, gravity_px: [f64; 2]) -> Option<Fit> {
        if count < 3 {
            return None;
        }
        let last = self.positions.get(count - 1)?;
        let (mut normal, mut right) = ([0.0; 3], [[0.0; 2]; 2]);
        for position in self.positions.iter().take(count) {
            let t = position.frame as f64 - last.frame as f64;
            let weight = position.sigma_px.powi(-2);
            normal[0] += weight;
            normal[1] += weight * t;
            normal[2] += weight * t * t;
            for axis in 0..2 {
                let free = position.at_px[axis] - 0.5 * gravity_px[axis] * t * t;
                right[axis][0] += weight * free;
                right[axis][1] += weight * t * free;
            }
            // The step of the last position leads to a frame beyond the fit.
            let Some(step) = position.step.filter(|step| t + step.interval_frames <= 0.0) else { continue };
            let weight = step.sigma_px.powi(-2);
            normal[2] += weight;
            for axis in 0..2 {
                right[axis][1] += weight * (step.rate_px[axis] - gravity_px[axis] * (t + 0.5 * step.interval_frames));
            }
        }
        let determinant = normal[0] * normal[2] - normal[1] * normal[1];
        if !(determinant.is_finite() && determinant > 0.0) {
            return None;
        }
        let solve = |right: [f64; 2]| {
            let at_px = (normal[2] * right[0] - normal[1] * right[1]) / determinant;
            let rate_px = (normal[0] * right[1] - normal[1] * right[0]) / determinant;
            (at_px, rate_px)
        };
        let [(x_px, rate_x_px), (y_px, rate_y_px)] = right.map(solve);
        let radii = self.positions.iter().take(count).map(|position| position.radius_px);
        Some(Fit {
            frame: last.frame,
            frames: count,
            at_px: [x_px, y_px],
            rate_px: [rate_x_px, rate_y_px],
            sigma_at_px: (normal[2] / determinant).sqrt(),
            sigma_rate_px: (normal[0] / determinant).sqrt(),
            covariance: -normal[1] / determinant,
            radius_px: radii.sum::<f64>() / count as f64,
        })
    }
}

/// Returns the centre of a body in a frame, px; `None` if it is not visible.
pub(super) fn center_px(step: &BodyStep) -> Option<[f64; 2]> {
    position(step, None).map(|position| position.at_px)
}

/// Returns the position of a body in a frame, or of a rod's end `end_px` below its lowest edge, with the motion from
/// it.
///
/// `None` if the body, or that edge, is not visible, or its place is only predicted. Uncertainties below
/// [`MIN_POSITION_SIGMA_PX`] and [`MIN_STEP_SIGMA_PX`] are raised to these.
fn position(step: &BodyStep, end_px: Option<f64>) -> Option<Position> {
    let is_gone = matches!(
        step.status,
        PointStatus::Lost | PointStatus::Occluded | PointStatus::OutOfFrame | PointStatus::Predicted
    );
    let motion = step.motion.map(|motion| Step {
        rate_px: [motion.dx_px, motion.dy_px],
        sigma_px: motion.sigma_dx_px.max(motion.sigma_dy_px).max(MIN_STEP_SIGMA_PX),
        interval_frames: f64::from(step.interval_frames.max(1)),
    });
    let (at_px, sigma_px, radius_px) = match (step.outline?.shape, end_px) {
        (OutlineShape::Circle(circle), _) => ([circle.x_px, circle.y_px], circle.sigma_center_px, circle.radius_px),
        (OutlineShape::Rod(rod), None) => ([rod.x_px.value, rod.y_px.value], rod.x_px.sigma.max(rod.y_px.sigma), 0.0),
        (OutlineShape::Rod(rod), Some(end_px)) => {
            let (at_px, sigma_px) = rod_end(&rod, end_px)?;
            (at_px, sigma_px, 0.0)
        }
    };
    let is_valid = at_px.iter().all(|x| x.is_finite()) && !is_gone;
    is_valid.then_some(Position {
        frame: step.frame,
        at_px,
        sigma_px: sigma_px.max(MIN_POSITION_SIGMA_PX),
        radius_px,
        step: motion,
    })
}

/// Returns the end of a rod, px, and its standard uncertainty along each axis, px. The end lies `below_px` along the
/// axis below the lowest edge; `None` while that edge is not visible.
fn rod_end(rod: &Rod, below_px: f64) -> Option<([f64; 2], f64)> {
    let edge = rod.edges.iter().flatten().last()?.y_px?;
    let (sin, cos) = rod.tilt_deg.value.to_radians().sin_cos();
    let x_px = rod.x_px.value + (edge.value - rod.y_px.value) * sin / cos;
    Some(([x_px + below_px * sin, edge.value + below_px * cos], rod.x_px.sigma.max(edge.sigma)))
}
