//! A circle through the edges of a rim, proof against outliers.

use nalgebra::{Matrix3, Vector3};

use super::edge::Edge;
use super::harmonic::{Limits, left, matrix, reweigh};
use super::rank::nth_smallest;
use super::rim::{LANES, Rim};

/// Residuals beyond this many robust standard deviations count nothing (Tukey).
const TUKEY: f32 = 4.0;
/// Residuals beyond this count nothing either: speckle at the rim can make half of the bins outliers, px.
const FARTHEST_PX: f32 = 0.7;
const FARTHEST_LINED_PX: f32 = 1.5;
/// The scale of the residuals is read at this rank, below the usual half, for the same reason.
const SCALE_RANK: f64 = 0.3;
/// Normal quantile of that rank: |z| is below it in 30 of 100 draws.
const SCALE_QUANTILE: f32 = 0.385_32;
const LINED_SCALE: (f64, f32) = (0.5, 0.6745);
/// Reweighting that moves the circle by less than this has settled, px.
const SETTLED_PX: f32 = 1e-4;
/// Unevenness of a printed or painted rim that no noise model knows, px.
const RIM_ROUGHNESS_PX: f32 = 0.03;
/// Neighbouring bins whose residuals are taken to be alike.
const ALIKE_BINS: usize = 8;

/// A correction of the outline, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    pub dx: f64,
    pub dy: f64,
    pub dr: f64,
}

/// Scratch of the fit; lists go on to a multiple of [`LANES`], with edges that weigh nothing.
#[derive(Debug, Default)]
pub(super) struct CircleFit {
    shift: Vec<f32>,
    weight: Vec<f32>,
    /// Square roots of the weights.
    root: Vec<f32>,
    /// Tukey's share of every bin, 0 where it is not used.
    pub trust: Vec<f32>,
    /// Whether marks line the rim.
    pub is_lined: bool,
    residual: Vec<f32>,
    sorted: Vec<f32>,
    /// Those of the fit done last.
    limits: Limits,
    /// Trust times weight times residual of every bin.
    scores: Vec<f64>,
}

impl CircleFit {
    /// Fits the edges marked in `used` in at most `rounds` of reweighting; `noise` is the picture's, grey levels.
    ///
    /// `None` when there are too few of them to hold a circle.
    pub fn fit(&mut self, rim: &Rim, edges: &[Edge], used: &[bool], noise: f32, rounds: usize) -> Option<Correction> {
        self.weigh(edges, used, noise);
        // The outline itself is the start: it already stands where most rim of one sign is.
        let mut answer = Vector3::zeros();
        for _ in 0..rounds {
            self.residuals(rim, answer);
            let scale = self.scale()?;
            let plain = if self.is_lined { FARTHEST_LINED_PX } else { FARTHEST_PX };
            let limits = Limits { weighted: TUKEY * scale, plain };
            self.limits = limits;
            let Self { shift, weight, root, trust, residual, .. } = self;
            let sums = reweigh([shift, weight, root, residual], rim.directions(), limits, trust);
            let (normal, right) = matrix(&sums);
            let before = std::mem::replace(&mut answer, normal.cholesky()?.solve(&right));
            if (answer - before).amax() < f64::from(SETTLED_PX) {
                break;
            }
        }
        self.residuals(rim, answer);
        Some(Correction { dx: answer[0], dy: answer[1], dr: answer[2] })
    }

    /// How many trusted edges lie within `limit_px` of the circle fitted last.
    pub fn close(&self, limit_px: f32) -> usize {
        self.residual.iter().zip(&self.trust).filter(|(e, trust)| **trust > 0.0 && e.abs() < limit_px).count()
    }

    /// How many of the edges used lie more than `limit_px` outside the circle fitted last.
    pub fn beyond(&self, limit_px: f32) -> usize {
        self.residual.iter().zip(&self.weight).filter(|(e, weight)| **weight > 0.0 && **e > limit_px).count()
    }

    fn weigh(&mut self, edges: &[Edge], used: &[bool], noise: f32) {
        let padded = edges.len().next_multiple_of(LANES);
        self.shift.clear();
        self.shift.extend(edges.iter().map(|edge| edge.shift));
        self.weight.clear();
        self.weight.extend(edges.iter().zip(used).map(|(edge, &used)| {
            let sigma = edge.sigma_unit * noise;
            let blotch = edge.rms / edge.contrast;
            let weight = 1.0 / (sigma * sigma + RIM_ROUGHNESS_PX * RIM_ROUGHNESS_PX + blotch * blotch);
            if used { weight } else { 0.0 }
        }));
        for list in [&mut self.shift, &mut self.weight] {
            list.resize(padded, 0.0);
        }
        self.root.clear();
        self.root.extend(self.weight.iter().map(|weight| weight.sqrt()));
        self.trust.clear();
        self.trust.resize(padded, 0.0);
        self.residual.resize(padded, 0.0);
    }

    fn residuals(&mut self, rim: &Rim, answer: Vector3<f64>) {
        left(&self.shift, rim.directions(), answer.cast().into(), &mut self.residual);
    }

    /// Robust standard deviation of the weighted residuals.
    fn scale(&mut self) -> Option<f32> {
        self.sorted.clear();
        let pairs = self.residual.iter().zip(&self.root).filter(|(_, root)| **root > 0.0);
        self.sorted.extend(pairs.map(|(e, root)| e.abs() * root));
        let rank = self.rank();
        spread(&mut self.sorted, rank).map(|scale| scale.max(1e-6))
    }

    fn rank(&self) -> (f64, f32) {
        if self.is_lined { LINED_SCALE } else { (SCALE_RANK, SCALE_QUANTILE) }
    }

    /// Covariance of the correction fitted last, px^2: that of an M-estimate, for residuals alike along the rim.
    ///
    /// The fit answers to a residual by the slope of its influence: those half way to the limit, whose trust falls as
    /// fast as they grow, hold the circle no longer. Taken for their trust they made it look a third too sure, the more
    /// so the more marks there are at the rim. `None` where too few hold it. P. J. Huber, Ann. Math. Stat. 35 (1964) 73,
    /// <https://doi.org/10.1214/aoms/1177703732>.
    pub fn covariance(&mut self, rim: &Rim) -> Option<Matrix3<f64>> {
        // Sums of the slopes, and of the squares of the scores, times cos cos, cos sin, cos, sin sin, sin and 1.
        let mut sums = [[0.0_f64; 6]; 2];
        self.scores.clear();
        let mut used = 0.0;
        for bin in 0..rim.bins() {
            let [trust, weight, residual] =
                [&self.trust, &self.weight, &self.residual].map(|list| f64::from(list[bin]));
            let score = trust * weight * residual;
            self.scores.push(score);
            if trust > 0.0 {
                let (cos, sin) = rim.direction(bin);
                let row = [cos * cos, cos * sin, cos, sin * sin, sin, 1.0];
                for (sums, weight) in sums.iter_mut().zip([weight * self.slope(trust, weight, residual), score * score])
                {
                    sums.iter_mut().zip(row).for_each(|(sum, each)| *sum += weight * each);
                }
                used += 1.0;
            }
        }
        let [slopes, squares] = sums.map(|[xx, xy, x, yy, y, one]| Matrix3::new(xx, xy, x, xy, yy, y, x, y, one));
        let bread = slopes.cholesky()?.inverse();
        let alike = self.alike();
        // Three of so many independent ones are spent on the circle.
        let free = (used / alike - 3.0).max(1.0);
        Some(bread * squares * bread * (alike * (free + 3.0) / free))
    }

    /// Derivative of a residual's trust times the residual.
    fn slope(&self, trust: f64, weight: f64, residual: f64) -> f64 {
        let (square, [weighted, plain]) =
            (residual * residual, [self.limits.weighted, self.limits.plain].map(f64::from));
        let (near, far) = (1.0 - square * weight / (weighted * weighted), 1.0 - square / (plain * plain));
        let falls = weight / (weighted * weighted) * far + near / (plain * plain);
        trust - 4.0 * square * near * far * falls
    }

    /// How many neighbouring scores are one, from their likeness along the rim (Bartlett's window).
    fn alike(&mut self) -> f64 {
        let bins = self.scores.len();
        let reach = ALIKE_BINS.min(bins / 4);
        let shares: [f64; ALIKE_BINS] = std::array::from_fn(|k| (ALIKE_BINS - k) as f64 / (ALIKE_BINS + 1) as f64);
        // Once more behind the last: no bin has to be looked for round the rim.
        self.scores.extend_from_within(..reach);
        let (mut own, mut cross) = (0.0, 0.0);
        for bin in 0..bins {
            let (score, later) = (self.scores[bin], &self.scores[bin + 1..=bin + reach]);
            own += score * score;
            cross += 2.0 * score * later.iter().zip(shares).map(|(later, share)| later * share).sum::<f64>();
        }
        if own > 0.0 { (1.0 + cross / own).max(1.0) } else { 1.0 }
    }

    /// Robust standard deviation of the residuals of the circle fitted last, px.
    pub fn scatter_px(&mut self) -> Option<f32> {
        self.sorted.clear();
        let pairs = self.residual.iter().zip(&self.weight).filter(|(_, w)| **w > 0.0);
        self.sorted.extend(pairs.map(|(e, _)| e.abs()));
        let rank = self.rank();
        spread(&mut self.sorted, rank)
    }
}

/// Robust standard deviation of residuals, from their sizes; `None` when there are too few.
fn spread(sizes: &mut Vec<f32>, (rank, quantile): (f64, f32)) -> Option<f32> {
    let rank = (sizes.len() as f64 * rank) as usize;
    (sizes.len() >= 6).then(|| nth_smallest(sizes, rank) / quantile)
}
