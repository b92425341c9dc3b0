//! Straight lines and parabolas through parts of a track.

use super::follower::TrackPoint;
use nalgebra::{DMatrix, DVector};

/// A polynomial of time through the centres, along x and along y.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PathFit {
    /// The coefficients of each coordinate, px, px/s, px/s^2, about `origin_s`.
    coefficients: [Vec<f64>; 2],
    origin_s: f64,
    /// The RMS of the residuals, with the degrees of freedom taken into account, px.
    pub(super) rms_px: f64,
    /// The standard uncertainty of the highest coefficient for a residual of 1 px.
    spread: f64,
}

impl PathFit {
    /// Fits a polynomial of this order by least squares; `None` unless there are more points than coefficients.
    pub(super) fn fit(points: &[TrackPoint], order: usize) -> Option<Self> {
        let count = order + 1;
        if points.len() <= count {
            return None;
        }
        let origin_s = points.iter().map(|point| point.t_s).sum::<f64>() / points.len() as f64;
        let span_s = points.last()?.t_s - points.first()?.t_s;
        // Powers of times of about 1 keep the system well conditioned.
        let scale = 2.0 / span_s.max(1e-12);
        let design =
            DMatrix::from_fn(points.len(), count, |row, k| ((points[row].t_s - origin_s) * scale).powi(k as i32));
        let inverse = (design.transpose() * &design).try_inverse()?;
        let solve = |value: fn(&TrackPoint) -> f64| {
            let values = DVector::from_iterator(points.len(), points.iter().map(value));
            let solution = &inverse * design.transpose() * &values;
            let squares = (&design * &solution - values).norm_squared();
            let unscaled = solution.iter().enumerate().map(|(k, c)| c * scale.powi(k as i32)).collect::<Vec<_>>();
            (unscaled, squares)
        };
        let ((x, x_squares), (y, y_squares)) = (solve(|point| point.circle.x_px), solve(|point| point.circle.y_px));
        let free = 2 * (points.len() - count);
        Some(Self {
            coefficients: [x, y],
            origin_s,
            rms_px: ((x_squares + y_squares) / free as f64).sqrt(),
            spread: inverse[(order, order)].sqrt() * scale.powi(order as i32),
        })
    }

    /// Returns the velocity at a time, px/s.
    pub(super) fn velocity(&self, t_s: f64) -> [f64; 2] {
        let t = t_s - self.origin_s;
        let slope = |of: &Vec<f64>| {
            of.iter().enumerate().skip(1).map(|(k, c)| k as f64 * c * t.powi(k as i32 - 1)).sum::<f64>()
        };
        [slope(&self.coefficients[0]), slope(&self.coefficients[1])]
    }

    /// Returns the coefficients of the highest order along x and along y, and their standard uncertainty.
    pub(super) fn highest_coefficients(&self) -> ([f64; 2], f64) {
        let last = |of: &Vec<f64>| of.last().copied().unwrap_or(0.0);
        ([last(&self.coefficients[0]), last(&self.coefficients[1])], self.spread * self.rms_px)
    }
}
