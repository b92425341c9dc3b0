//! A robust fit of a circle to the edges along a rim.

use nalgebra::{Matrix3, Vector3};

use super::RimKind;
use super::annulus::{Annulus, LANES};
use super::edge_fit::Edge;
use super::first_harmonic::{Limits, normal_equations, residuals, reweigh};
use crate::numeric::nth_smallest;

/// The residual of zero weight in robust standard deviations (Tukey's biweight).
const TUKEY: f32 = 4.0;
/// The residual of zero weight, px: speckle at the rim can make half of the edges outliers.
const MAX_RESIDUAL_PX: f32 = 0.7;
const MAX_RESIDUAL_SPECKLED_PX: f32 = 1.5;
/// The rank of the residual that gives their scale: below one half because of many outliers.
const CLEAN_SCALE: ScaleRank = ScaleRank { rank: 0.3, quantile: 0.385_32 };
const SPECKLED_SCALE: ScaleRank = ScaleRank { rank: 0.5, quantile: 0.6745 };
/// The change of the circle at which the reweighting has converged, px.
const CONVERGED_PX: f32 = 1e-4;
/// The roughness of a printed or painted rim, which no noise model contains, px.
const RIM_ROUGHNESS_PX: f32 = 0.03;
/// The number of neighbouring bins whose residuals may be correlated.
const CORRELATED_BINS: usize = 8;

/// A rank of absolute residuals with its quantile of the normal distribution: |z| is below it in `rank` of all draws.
#[derive(Clone, Copy)]
struct ScaleRank {
    rank: f64,
    quantile: f32,
}

/// A correction of a circle, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    pub dx: f64,
    pub dy: f64,
    pub dr: f64,
}

/// The robust circle fit with its scratch memory. Lists are padded to a multiple of [`LANES`] with zero weights.
#[derive(Debug, Default)]
pub(super) struct CircleFit {
    shift: Vec<f32>,
    weight: Vec<f32>,
    /// The square roots of the weights.
    root: Vec<f32>,
    /// Tukey's weight of every bin, 0 if the bin is not used.
    pub robust_weight: Vec<f32>,
    pub rim_kind: RimKind,
    residual: Vec<f32>,
    sorted: Vec<f32>,
    /// The limits of the last round.
    limits: Limits,
    /// The product of robust weight, weight and residual of every bin.
    scores: Vec<f64>,
}

impl CircleFit {
    /// Fits a circle to the edges marked in `used`, with at most `rounds` of reweighting; `noise` in grey levels.
    ///
    /// Returns the correction of the gathered circle; `None` if the edges do not determine one.
    pub fn fit(
        &mut self,
        rim: &Annulus,
        edges: &[Edge],
        used: &[bool],
        noise: f32,
        rounds: usize,
    ) -> Option<Correction> {
        self.set_weights(edges, used, noise);
        // The fit starts at the current circle, which already follows most of the rim of one sign.
        let mut correction = Vector3::zeros();
        for _ in 0..rounds {
            self.update_residuals(rim, correction);
            let scale = self.residual_scale()?;
            let plain = match self.rim_kind {
                RimKind::Clean | RimKind::Shaded => MAX_RESIDUAL_PX,
                RimKind::Speckled => MAX_RESIDUAL_SPECKLED_PX,
            };
            let limits = Limits { weighted: TUKEY * scale, plain };
            self.limits = limits;
            let Self { shift, weight, root, robust_weight, residual, .. } = self;
            let sums = reweigh([shift, weight, root, residual], rim.directions(), limits, robust_weight);
            let (normal, right) = normal_equations(&sums);
            let before = std::mem::replace(&mut correction, normal.cholesky()?.solve(&right));
            if (correction - before).amax() < f64::from(CONVERGED_PX) {
                break;
            }
        }
        self.update_residuals(rim, correction);
        Some(Correction { dx: correction[0], dy: correction[1], dr: correction[2] })
    }

    /// Counts the used edges within `limit_px` of the fitted circle.
    pub fn count_inliers(&self, limit_px: f32) -> usize {
        self.residual
            .iter()
            .zip(&self.robust_weight)
            .filter(|(residual, robust_weight)| **robust_weight > 0.0 && residual.abs() < limit_px)
            .count()
    }

    /// Counts the used edges more than `limit_px` outside the fitted circle.
    pub fn count_outer_edges(&self, limit_px: f32) -> usize {
        self.residual
            .iter()
            .zip(&self.weight)
            .filter(|(residual, weight)| **weight > 0.0 && **residual > limit_px)
            .count()
    }

    /// Sets the weight of each used edge to its inverse variance: image noise, roughness of the rim and residuals.
    fn set_weights(&mut self, edges: &[Edge], used: &[bool], noise: f32) {
        let padded = edges.len().next_multiple_of(LANES);
        self.shift.clear();
        self.shift.extend(edges.iter().map(|edge| edge.shift));
        self.weight.clear();
        self.weight.extend(edges.iter().zip(used).map(|(edge, &used)| {
            let sigma = edge.sigma_unit * noise;
            let texture = edge.rms / edge.contrast;
            let weight = 1.0 / (sigma * sigma + RIM_ROUGHNESS_PX * RIM_ROUGHNESS_PX + texture * texture);
            if used { weight } else { 0.0 }
        }));
        for list in [&mut self.shift, &mut self.weight] {
            list.resize(padded, 0.0);
        }
        self.root.clear();
        self.root.extend(self.weight.iter().map(|weight| weight.sqrt()));
        self.robust_weight.clear();
        self.robust_weight.resize(padded, 0.0);
        self.residual.resize(padded, 0.0);
    }

    /// Computes the residuals of all edges from a corrected circle, px.
    fn update_residuals(&mut self, rim: &Annulus, correction: Vector3<f64>) {
        residuals(&self.shift, rim.directions(), correction.cast().into(), &mut self.residual);
    }

    /// Returns the robust standard deviation of the residuals in their own sigmas; `None` if there are too few.
    fn residual_scale(&mut self) -> Option<f32> {
        self.sorted.clear();
        let pairs = self.residual.iter().zip(&self.root).filter(|(_, root)| **root > 0.0);
        self.sorted.extend(pairs.map(|(e, root)| e.abs() * root));
        let rank = self.scale_rank();
        robust_scale(&mut self.sorted, rank).map(|scale| scale.max(1e-6))
    }

    /// Returns the rank of the residual that gives their scale.
    fn scale_rank(&self) -> ScaleRank {
        match self.rim_kind {
            RimKind::Clean | RimKind::Shaded => CLEAN_SCALE,
            RimKind::Speckled => SPECKLED_SCALE,
        }
    }

    /// Returns the covariance of the correction, px^2: that of an M-estimator with correlated residuals.
    ///
    /// The fit responds to a residual by the slope of its influence function. Edges half way to the limit, whose
    /// weight falls as fast as they grow, do not constrain the circle. With weights in place of slopes the
    /// uncertainty is a third too small, and smaller with more marks at the rim. Returns `None` if too few edges
    /// constrain the circle. P. J. Huber, Ann. Math. Stat. 35 (1964) 73, <https://doi.org/10.1214/aoms/1177703732>.
    pub fn covariance(&mut self, rim: &Annulus) -> Option<Matrix3<f64>> {
        // Sums of the slopes, and of the squared scores, times cos cos, cos sin, cos, sin sin, sin and 1.
        let mut sums = [[0.0_f64; 6]; 2];
        self.scores.clear();
        let mut used = 0.0;
        for bin in 0..rim.bins() {
            let [robust_weight, weight, residual] =
                [&self.robust_weight, &self.weight, &self.residual].map(|list| f64::from(list[bin]));
            let score = robust_weight * weight * residual;
            self.scores.push(score);
            if robust_weight > 0.0 {
                let (cos, sin) = rim.direction(bin);
                let row = [cos * cos, cos * sin, cos, sin * sin, sin, 1.0];
                for (sums, weight) in
                    sums.iter_mut().zip([weight * self.score_slope(robust_weight, weight, residual), score * score])
                {
                    sums.iter_mut().zip(row).for_each(|(sum, each)| *sum += weight * each);
                }
                used += 1.0;
            }
        }
        let [slopes, squares] = sums.map(|[xx, xy, x, yy, y, one]| Matrix3::new(xx, xy, x, xy, yy, y, x, y, one));
        let bread = slopes.cholesky()?.inverse();
        let correlated = self.correlation_length();
        // The circle takes three degrees of freedom.
        let free = (used / correlated - 3.0).max(1.0);
        Some(bread * squares * bread * (correlated * (free + 3.0) / free))
    }

    /// Returns the derivative of the robust weight times the residual by the residual.
    fn score_slope(&self, robust_weight: f64, weight: f64, residual: f64) -> f64 {
        let (square, [weighted, plain]) =
            (residual * residual, [self.limits.weighted, self.limits.plain].map(f64::from));
        let (near, far) = (1.0 - square * weight / (weighted * weighted), 1.0 - square / (plain * plain));
        let falls = weight / (weighted * weighted) * far + near / (plain * plain);
        robust_weight - 4.0 * square * near * far * falls
    }

    /// Returns the number of neighbouring scores that count as one, from their autocorrelation (Bartlett's window).
    fn correlation_length(&mut self) -> f64 {
        let bins = self.scores.len();
        let reach = CORRELATED_BINS.min(bins / 4);
        let taper: [f64; CORRELATED_BINS] =
            std::array::from_fn(|k| (CORRELATED_BINS - k) as f64 / (CORRELATED_BINS + 1) as f64);
        // The first scores are repeated at the end, which spares a wrap-around.
        self.scores.extend_from_within(..reach);
        let (mut own, mut cross) = (0.0, 0.0);
        for bin in 0..bins {
            let (score, later) = (self.scores[bin], &self.scores[bin + 1..=bin + reach]);
            own += score * score;
            cross += 2.0 * score * later.iter().zip(taper).map(|(later, factor)| later * factor).sum::<f64>();
        }
        if own > 0.0 { (1.0 + cross / own).max(1.0) } else { 1.0 }
    }

    /// Returns the robust standard deviation of the edges about the fitted circle, px; `None` if there are too few.
    pub fn scatter_px(&mut self) -> Option<f32> {
        self.sorted.clear();
        let pairs = self.residual.iter().zip(&self.weight).filter(|(_, w)| **w > 0.0);
        self.sorted.extend(pairs.map(|(e, _)| e.abs()));
        let rank = self.scale_rank();
        robust_scale(&mut self.sorted, rank)
    }
}

/// Returns the robust standard deviation of residuals from their sizes; `None` if there are too few.
fn robust_scale(sizes: &mut Vec<f32>, scale: ScaleRank) -> Option<f32> {
    let rank = (sizes.len() as f64 * scale.rank) as usize;
    (sizes.len() >= 6).then(|| nth_smallest(sizes, rank) / scale.quantile)
}
