//! Side light on a ball, told by the brightness along its rim.

use nalgebra::Vector3;

use super::edge::Edge;
use super::harmonic::{Limits, left, matrix, reweigh};
use super::rank::nth_smallest;
use super::rim::{LANES, Rim};

/// Rounds of reweighting.
const ROUNDS: usize = 5;
/// Residuals beyond this many robust standard deviations count nothing (Tukey).
const TUKEY: f32 = 4.0;
/// Standard deviations in a median of sizes.
const FROM_MEDIAN: f32 = 1.4826;
/// Largest gap in the rim, rad: over a larger one the first harmonic is a guess.
const WIDEST_GAP_RAD: f64 = 2.3;

/// Scratch of the fit; lists go on to a multiple of [`LANES`], with bins that weigh nothing.
#[derive(Debug, Default)]
pub(super) struct SideLight {
    /// The inside is brighter by so much where the rim is farthest along x and along y, grey levels; nought where that is
    /// not known.
    pub across: [f64; 2],
    level: Vec<f32>,
    weight: Vec<f32>,
    residual: Vec<f32>,
    trust: Vec<f32>,
    sorted: Vec<f32>,
}

impl SideLight {
    /// How much brighter the inside gets per px towards the centre, per bin, grey levels.
    ///
    /// The inside's brightness along the rim is `a + b cos + c sin`; a light that
    /// changes evenly across the disc then falls by `(b cos + c sin) / R` a pixel
    /// inwards. All zero when the bins used do not surround the centre.
    pub fn slope(&mut self, rim: &Rim, edges: &[Edge], used: &[bool], radius: f64, slope: &mut Vec<f32>) {
        slope.clear();
        slope.resize(rim.bins(), 0.0);
        self.across = [0.0; 2];
        if widest_gap(used) * std::f64::consts::TAU / rim.bins() as f64 > WIDEST_GAP_RAD {
            return;
        }
        let Some(light) = self.harmonic(rim, edges, used) else { return };
        self.across = [light[0], light[1]];
        let [x, y] = self.across.map(|v| (-v / radius) as f32);
        let [cos, sin] = rim.directions();
        for (slope, (cos, sin)) in slope.iter_mut().zip(cos.iter().zip(sin)) {
            *slope = x * cos + y * sin;
        }
    }

    /// The brightness inside as `b cos + c sin + a`, by reweighted least squares.
    fn harmonic(&mut self, rim: &Rim, edges: &[Edge], used: &[bool]) -> Option<Vector3<f64>> {
        let Self { level, weight, residual, trust, sorted, .. } = self;
        let padded = edges.len().next_multiple_of(LANES);
        level.clear();
        level.extend(edges.iter().zip(used).map(|(edge, used)| if *used { edge.inside } else { 0.0 }));
        weight.clear();
        weight.extend(used.iter().map(|used| if *used { 1.0_f32 } else { 0.0 }));
        for list in [&mut *level, &mut *weight, &mut *residual, &mut *trust] {
            list.resize(padded, 0.0);
        }
        let (mut answer, mut most) = (Vector3::zeros(), f32::INFINITY);
        for round in 0..ROUNDS {
            if round > 0 {
                left(level, rim.directions(), answer.cast().into(), residual);
                sorted.clear();
                let sizes = residual.iter().zip(weight.iter()).filter(|(_, weight)| **weight > 0.0);
                sorted.extend(sizes.map(|(residual, _)| residual.abs()));
                let middle = sorted.len() / 2;
                most = TUKEY * FROM_MEDIAN * nth_smallest(sorted, middle).max(1e-3);
            }
            // The roots of the weights are the weights.
            let limits = Limits { weighted: most, plain: f32::INFINITY };
            let sums = reweigh([level, weight, weight, residual], rim.directions(), limits, trust);
            let (normal, right) = matrix(&sums);
            answer = normal.cholesky()?.solve(&right);
        }
        Some(answer)
    }
}

/// Longest circular run of bins that are not used.
fn widest_gap(used: &[bool]) -> f64 {
    let (mut widest, mut gap) = (0, 0);
    for used in used.iter().chain(used) {
        gap = if *used { 0 } else { gap + 1 };
        widest = widest.max(gap);
    }
    widest.min(used.len()) as f64
}
