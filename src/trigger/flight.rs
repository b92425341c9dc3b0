//! Where a body will be: its newest places and steps, fitted in free flight.

use crate::results::{BodyStep, PointStatus, Rod};
use std::collections::VecDeque;

/// Outlines are not believed beyond this, px: their error stays the same from frame to frame.
const PLACE_FLOOR_PX: f64 = 0.05;
/// Steps are not believed beyond this, px/frame.
const STEP_FLOOR_PX: f64 = 0.003;
/// A place further than this from where the flight leads is off it, sigmas ...
const OFF_SIGMAS: f64 = 6.0;
/// ... and at least so many px.
const OFF_PX: f64 = 0.5;
/// So many in a row are another flight.
const OFF_FRAMES: usize = 3;

/// A body in one frame.
#[derive(Debug, Clone, Copy)]
struct Place {
    frame: u64,
    at_px: [f64; 2],
    sigma_px: f64,
    radius_px: f64,
    /// Motion to the next frame, px/frame, its sigma, and over how many frames it was measured.
    step: Option<([f64; 2], f64, f64)>,
}

/// Where a body is and how fast it moves at the newest frame; image axes, px and frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// The newest frame.
    pub frame: u64,
    /// Frames it rests on.
    pub frames: usize,
    /// Centre.
    pub at_px: [f64; 2],
    /// Motion a frame.
    pub rate_px: [f64; 2],
    /// Standard uncertainty of the centre along each axis.
    pub sigma_at_px: f64,
    /// Standard uncertainty of the motion along each axis.
    pub sigma_rate_px: f64,
    /// Covariance of the two.
    covariance: f64,
    /// Mean radius; 0 where the body has none.
    pub radius_px: f64,
}

impl Fit {
    /// Standard uncertainty of the centre so many frames from now.
    pub fn sigma_after(&self, frames: f64) -> f64 {
        let variance =
            self.sigma_at_px.powi(2) + frames * (2.0 * self.covariance + frames * self.sigma_rate_px.powi(2));
        // Outlines err alike in neighbouring frames, which no number of them takes away.
        (variance.max(self.sigma_at_px.powi(2)) + PLACE_FLOOR_PX * PLACE_FLOOR_PX).sqrt()
    }
}

/// The newest stretch of free flight of one body.
#[derive(Debug, Clone)]
pub(super) struct Flight {
    /// Frames the fit looks back at most.
    back_frames: usize,
    /// How far a rod's end lies below its lowest edge, px; `None`: the body's centre flies.
    end_px: Option<f64>,
    places: VecDeque<Place>,
    /// Newest places that lie off the flight before them.
    off: usize,
}

impl Flight {
    /// Nothing seen yet; fits look back so many frames at most. `end_px`: how far the end of a rod, whose flight it then
    /// is, lies below its lowest edge.
    pub fn new(back_frames: usize, end_px: Option<f64>) -> Self {
        Self { back_frames, end_px, places: VecDeque::new(), off: 0 }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.places.clear();
        self.off = 0;
    }

    /// Takes the next frame's step; `false` where the body was not seen in it. `gravity_px` in px/frame^2, image axes.
    pub fn push(&mut self, step: &BodyStep, gravity_px: [f64; 2]) -> bool {
        let Some(place) = place(step, self.end_px) else { return false };
        let expected = self.fit_of(self.places.len() - self.off, gravity_px);
        let is_off = expected.is_some_and(|fit| {
            let ahead = (place.frame - fit.frame) as f64;
            let far = |axis: usize| {
                let led = fit.at_px[axis] + ahead * (fit.rate_px[axis] + 0.5 * ahead * gravity_px[axis]);
                (place.at_px[axis] - led).abs()
            };
            far(0).max(far(1)) > (OFF_SIGMAS * fit.sigma_after(ahead).hypot(place.sigma_px)).max(OFF_PX)
        });
        self.places.push_back(place);
        self.off = if is_off { self.off + 1 } else { 0 };
        if self.off >= OFF_FRAMES {
            self.places.drain(..self.places.len() - self.off);
            self.off = 0;
        }
        while self.places.len() > self.back_frames {
            self.places.pop_front();
        }
        true
    }

    /// The newest radius; `None` when nothing was seen.
    pub fn radius_px(&self) -> Option<f64> {
        self.places.back().map(|place| place.radius_px)
    }

    /// Whether the newest place lies off the flight before it.
    pub fn is_off(&self) -> bool {
        self.off > 0
    }

    /// The flight as its newest frames tell it; `None` from fewer than three.
    pub fn fit(&self, gravity_px: [f64; 2]) -> Option<Fit> {
        self.fit_of(self.places.len(), gravity_px)
    }

    /// Least squares over the first `count` places: centre and motion at the last of them, gravity known.
    fn fit_of(&self, count: usize, gravity_px: [f64; 2]) -> Option<Fit> {
        if count < 3 {
            return None;
        }
        let last = self.places.get(count - 1)?;
        let (mut normal, mut right) = ([0.0; 3], [[0.0; 2]; 2]);
        for place in self.places.iter().take(count) {
            let t = place.frame as f64 - last.frame as f64;
            let weight = place.sigma_px.powi(-2);
            normal[0] += weight;
            normal[1] += weight * t;
            normal[2] += weight * t * t;
            for axis in 0..2 {
                let free = place.at_px[axis] - 0.5 * gravity_px[axis] * t * t;
                right[axis][0] += weight * free;
                right[axis][1] += weight * t * free;
            }
            // The last place's own step leads to a frame that is not told yet.
            let Some((rate, sigma, interval)) = place.step.filter(|(.., interval)| t + interval <= 0.0) else {
                continue;
            };
            let weight = sigma.powi(-2);
            normal[2] += weight;
            for axis in 0..2 {
                right[axis][1] += weight * (rate[axis] - gravity_px[axis] * (t + 0.5 * interval));
            }
        }
        let determinant = normal[0] * normal[2] - normal[1] * normal[1];
        if !(determinant.is_finite() && determinant > 0.0) {
            return None;
        }
        let solve = |right: [f64; 2]| {
            let at = (normal[2] * right[0] - normal[1] * right[1]) / determinant;
            let rate = (normal[0] * right[1] - normal[1] * right[0]) / determinant;
            (at, rate)
        };
        let [(x, dx), (y, dy)] = right.map(solve);
        let radii = self.places.iter().take(count).map(|place| place.radius_px);
        Some(Fit {
            frame: last.frame,
            frames: count,
            at_px: [x, y],
            rate_px: [dx, dy],
            sigma_at_px: (normal[2] / determinant).sqrt(),
            sigma_rate_px: (normal[0] / determinant).sqrt(),
            covariance: -normal[1] / determinant,
            radius_px: radii.sum::<f64>() / count as f64,
        })
    }
}

/// Where a body was seen.
pub(super) fn center_px(step: &BodyStep) -> Option<[f64; 2]> {
    place(step, None).map(|place| place.at_px)
}

fn place(step: &BodyStep, end_px: Option<f64>) -> Option<Place> {
    let gone = matches!(step.status, PointStatus::Lost | PointStatus::Occluded | PointStatus::OutOfFrame);
    let motion = step.step.map(|motion| {
        let sigma = motion.sigma_dx_px.max(motion.sigma_dy_px).max(STEP_FLOOR_PX);
        ([motion.dx_px, motion.dy_px], sigma, f64::from(step.interval_frames.max(1)))
    });
    let (at_px, sigma_px, radius_px) = match (&step.circle, &step.rod) {
        (_, Some(rod)) if end_px.is_some() => {
            let (at_px, sigma_px) = end(rod, end_px?)?;
            (at_px, sigma_px, 0.0)
        }
        (Some(circle), _) => ([circle.x_px, circle.y_px], circle.sigma_center_px, circle.radius_px),
        (None, Some(rod)) => ([rod.x_px.value, rod.y_px.value], rod.x_px.sigma.max(rod.y_px.sigma), 0.0),
        (None, None) => return None,
    };
    let sound = at_px.iter().all(|x| x.is_finite()) && !gone;
    sound.then_some(Place { frame: step.frame, at_px, sigma_px: sigma_px.max(PLACE_FLOOR_PX), radius_px, step: motion })
}

/// The end of a rod `below_px` below its lowest edge, and the sigma of it; `None` while that edge is not seen.
fn end(rod: &Rod, below_px: f64) -> Option<([f64; 2], f64)> {
    let edge = rod.edges.iter().flatten().last()?.y_px?;
    let (sin, cos) = rod.tilt_deg.value.to_radians().sin_cos();
    let x_px = rod.x_px.value + (edge.value - rod.y_px.value) * sin / cos;
    Some(([x_px + below_px * sin, edge.value + below_px * cos], rod.x_px.sigma.max(edge.sigma)))
}
