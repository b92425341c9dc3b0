//! A circle through the edges of a rim, proof against outliers.

use nalgebra::{Matrix3, Vector3};

use super::edge::Edge;
use super::rim::Rim;

/// Residuals beyond this many robust standard deviations count nothing (Tukey).
const TUKEY: f64 = 4.0;
/// Residuals beyond this count nothing either: speckle at the rim can make half of the bins outliers, px.
const FARTHEST_PX: f64 = 0.7;
/// The scale of the residuals is read at this rank, below the usual half, for the same reason.
const SCALE_RANK: f64 = 0.3;
/// Normal quantile of that rank: |z| is below it in 30 of 100 draws.
const SCALE_QUANTILE: f64 = 0.385_32;
/// Reweighting that moves the circle by less than this has settled, px.
const SETTLED_PX: f64 = 1e-4;
/// Unevenness of a printed or painted rim that no noise model knows, px.
const RIM_ROUGHNESS_PX: f64 = 0.03;
/// Neighbouring bins whose residuals are taken to be alike.
const ALIKE_BINS: usize = 8;

/// A correction of the outline, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    pub dx: f64,
    pub dy: f64,
    pub dr: f64,
    /// Normal matrix of the fit, 1 / px^2.
    pub normal: Matrix3<f64>,
}

/// Scratch of the fit.
#[derive(Debug, Default)]
pub(super) struct CircleFit {
    weight: Vec<f64>,
    /// Square roots of the weights.
    root: Vec<f64>,
    /// Tukey's share of every bin, 0 where it is not used.
    pub trust: Vec<f64>,
    residual: Vec<f64>,
    sorted: Vec<f64>,
}

impl CircleFit {
    /// Fits the edges marked in `used` in at most `rounds` of reweighting; `noise` is the picture's, grey levels.
    ///
    /// `None` when there are too few of them to hold a circle.
    pub fn fit(&mut self, rim: &Rim, edges: &[Edge], used: &[bool], noise: f32, rounds: usize) -> Option<Correction> {
        self.weigh(edges, used, noise);
        // The outline itself is the start: it already stands where most rim of one sign is.
        let mut answer = Vector3::zeros();
        let mut normal = Matrix3::identity();
        for _ in 0..rounds {
            self.residuals(rim, edges, answer);
            let scale = self.scale()?;
            let right;
            (normal, right) = self.equations(rim, edges, TUKEY * scale);
            let before = std::mem::replace(&mut answer, normal.cholesky()?.solve(&right));
            if (answer - before).amax() < SETTLED_PX {
                break;
            }
        }
        self.residuals(rim, edges, answer);
        Some(Correction { dx: answer[0], dy: answer[1], dr: answer[2], normal })
    }

    /// Normal matrix and right side of the circle, each edge trusted by its last residual.
    fn equations(&mut self, rim: &Rim, edges: &[Edge], most: f64) -> (Matrix3<f64>, Vector3<f64>) {
        let (cos, sin) = rim.directions();
        // cos cos, cos sin, sin sin, cos, sin, 1; and the shift times cos, sin, 1.
        let mut sums = [0.0; 9];
        for (bin, edge) in edges.iter().enumerate() {
            let z = self.residual[bin] * self.root[bin] / most;
            let far = self.residual[bin] / FARTHEST_PX;
            let near = self.weight[bin] > 0.0 && z.abs() < 1.0 && far.abs() < 1.0;
            self.trust[bin] = if near { ((1.0 - z * z) * (1.0 - far * far)).powi(2) } else { 0.0 };
            let weight = self.trust[bin] * self.weight[bin];
            let (x, y, shift) = (weight * cos[bin], weight * sin[bin], f64::from(edge.shift));
            let terms = [x * cos[bin], x * sin[bin], y * sin[bin], x, y, weight, x * shift, y * shift, weight * shift];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
        let [xx, xy, yy, x, y, one, right @ ..] = sums;
        (Matrix3::new(xx, xy, x, xy, yy, y, x, y, one), Vector3::from(right))
    }

    /// How many trusted edges lie within `limit_px` of the circle fitted last.
    pub fn close(&self, limit_px: f64) -> usize {
        self.residual.iter().zip(&self.trust).filter(|(e, trust)| **trust > 0.0 && e.abs() < limit_px).count()
    }

    fn weigh(&mut self, edges: &[Edge], used: &[bool], noise: f32) {
        self.weight.clear();
        self.weight.extend(edges.iter().zip(used).map(|(edge, &used)| {
            if !used {
                return 0.0;
            }
            let sigma = f64::from(edge.sigma_unit * noise);
            let blotch = f64::from(edge.rms / edge.contrast);
            1.0 / (sigma * sigma + RIM_ROUGHNESS_PX.powi(2) + blotch * blotch)
        }));
        self.root.clear();
        self.root.extend(self.weight.iter().map(|weight| weight.sqrt()));
        self.trust.clear();
        self.trust.resize(edges.len(), 0.0);
    }

    fn residuals(&mut self, rim: &Rim, edges: &[Edge], answer: Vector3<f64>) {
        self.residual.clear();
        let (cos, sin) = rim.directions();
        let places = edges.iter().zip(cos.iter().zip(sin));
        self.residual
            .extend(places.map(|(e, (cos, sin))| f64::from(e.shift) - (cos * answer[0] + sin * answer[1] + answer[2])));
    }

    /// Robust standard deviation of the weighted residuals.
    fn scale(&mut self) -> Option<f64> {
        self.sorted.clear();
        let pairs = self.residual.iter().zip(&self.root).filter(|(_, root)| **root > 0.0);
        self.sorted.extend(pairs.map(|(e, root)| e.abs() * root));
        spread(&mut self.sorted).map(|scale| scale.max(1e-6))
    }

    /// Covariance of the correction fitted last, px^2.
    pub fn covariance(&self, rim: &Rim, fitted: &Correction) -> Option<Matrix3<f64>> {
        let bread = fitted.normal.try_inverse()?;
        Some(bread * self.correlated(rim) * bread)
    }

    /// Robust standard deviation of the residuals of the circle fitted last, px.
    pub fn scatter_px(&mut self) -> Option<f64> {
        self.sorted.clear();
        let pairs = self.residual.iter().zip(&self.weight).filter(|(_, w)| **w > 0.0);
        self.sorted.extend(pairs.map(|(e, _)| e.abs()));
        spread(&mut self.sorted)
    }

    /// Covariance of the weighted sums, from the residuals' own likeness along the rim (Bartlett's window).
    fn correlated(&self, rim: &Rim) -> Matrix3<f64> {
        let bins = rim.bins();
        let score = |bin: usize| row(rim, bin) * (self.trust[bin] * self.weight[bin] * self.residual[bin]);
        let scores: Vec<Vector3<f64>> = (0..bins).map(score).collect();
        let reach = ALIKE_BINS.min(bins / 4);
        let mut meat = Matrix3::zeros();
        for (bin, own) in scores.iter().enumerate() {
            // All that is like it and comes later, together.
            let mut later = Vector3::zeros();
            for lag in 1..=reach {
                let place = bin + lag;
                let place = if place < bins { place } else { place - bins };
                later += scores[place] * (1.0 - lag as f64 / (ALIKE_BINS + 1) as f64);
            }
            let cross = own * later.transpose();
            meat += own * own.transpose() + cross + cross.transpose();
        }
        meat
    }
}

fn row(rim: &Rim, bin: usize) -> Vector3<f64> {
    let (cos, sin) = rim.direction(bin);
    Vector3::new(cos, sin, 1.0)
}

/// Robust standard deviation of residuals, from their sizes; `None` when there are too few.
fn spread(sizes: &mut [f64]) -> Option<f64> {
    let rank = (sizes.len() as f64 * SCALE_RANK) as usize;
    (sizes.len() >= 6).then(|| *sizes.select_nth_unstable_by(rank, f64::total_cmp).1 / SCALE_QUANTILE)
}
