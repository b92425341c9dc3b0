//! Straight lines and parabolas through parts of a track.

use super::follower::TrackPoint;
use crate::numeric::{Polynomial, Sample};
use crate::results::Estimate;

/// A polynomial of time through the centres, along x and along y.
#[derive(Debug, Clone)]
pub(super) struct PathFit {
    axes: [Polynomial; 2],
    /// The RMS of the residuals, with the degrees of freedom taken into account, px.
    pub(super) rms_px: f64,
}

impl PathFit {
    /// Fits a polynomial of this order by least squares; `None` unless there are more points than coefficients, at
    /// different times.
    pub(super) fn fit(points: &[TrackPoint], order: usize) -> Option<Self> {
        let origin_s = points.iter().map(|point| point.t_s).sum::<f64>() / points.len() as f64;
        let fit = |value: fn(&TrackPoint) -> f64| {
            let sample = |point: &TrackPoint| Sample {
                time_frames: point.t_s,
                component: 0,
                value: value(point),
                sigma: 1.0,
                walk: 0.0,
            };
            let samples: Vec<Sample> = points.iter().map(sample).collect();
            Polynomial::fit(&samples, origin_s, order, 0.0).filter(|fit| fit.freedom() > 0)
        };
        let axes = [fit(|point| point.circle.x_px)?, fit(|point| point.circle.y_px)?];
        let free = axes[0].freedom() + axes[1].freedom();
        let rms_px = ((axes[0].chi2() + axes[1].chi2()) / free as f64).sqrt();
        Some(Self { axes, rms_px })
    }

    /// Returns the velocity along x and y at a time, px/s.
    pub(super) fn velocity(&self, t_s: f64) -> [f64; 2] {
        self.axes.each_ref().map(|axis| axis.rate(t_s).value)
    }

    /// Returns the acceleration along x and along y with its standard uncertainty, px/s^2.
    pub(super) fn acceleration(&self) -> [Estimate; 2] {
        self.axes.each_ref().map(|axis| {
            let Estimate { value, sigma } = axis.curvature();
            Estimate { value, sigma: sigma * self.rms_px }
        })
    }
}
