//! Side light on a ball, estimated from the brightness along its rim.

use nalgebra::Vector3;

use super::annulus::{Annulus, Directions, LANES};
use super::edge_fit::Edge;
use super::first_harmonic::{Limits, normal_equations, residuals, reweigh};
use crate::numeric::{SIGMA_PER_MEDIAN, nth_smallest};

/// The number of rounds of reweighting.
const ROUNDS: usize = 5;
/// The residual of zero weight in robust standard deviations (Tukey's biweight).
const TUKEY: f32 = 4.0;
/// The maximum gap in the rim, rad; a larger one leaves the first harmonic undetermined.
const MAX_GAP_RAD: f64 = 2.3;

/// The side-light fit with its scratch memory. Lists are padded to a multiple of [`LANES`] with zero weights.
#[derive(Debug, Default)]
pub(super) struct SideLight {
    /// The amplitude of the brightness along the rim in x and y, grey levels; zero if it is not known.
    pub amplitude: [f64; 2],
    level: Vec<f32>,
    weight: Vec<f32>,
    residual: Vec<f32>,
    robust_weight: Vec<f32>,
    sorted: Vec<f32>,
}

impl SideLight {
    /// Computes the rise of the brightness inside towards the centre, per bin, grey levels/px.
    ///
    /// The brightness inside along the rim is `a + b cos + c sin`. Illumination that changes linearly across the disc
    /// then falls by `(b cos + c sin) / R` per pixel inwards. The slope is zero if the used bins do not surround the
    /// centre.
    pub fn fit_slope(&mut self, rim: &Annulus, edges: &[Edge], used: &[bool], radius: f64, slope: &mut Vec<f32>) {
        slope.clear();
        slope.resize(rim.bins(), 0.0);
        self.amplitude = [0.0; 2];
        if max_gap(used) * std::f64::consts::TAU / rim.bins() as f64 > MAX_GAP_RAD {
            return;
        }
        let Some(harmonic) = self.fit_harmonic(rim, edges, used) else { return };
        self.amplitude = [harmonic[0], harmonic[1]];
        let [x, y] = self.amplitude.map(|v| (-v / radius) as f32);
        let Directions { cos, sin } = rim.directions();
        for (slope, (cos, sin)) in slope.iter_mut().zip(cos.iter().zip(sin)) {
            *slope = x * cos + y * sin;
        }
    }

    /// Fits the brightness inside by `b cos + c sin + a` with reweighted least squares. Returns (b, c, a), grey
    /// levels.
    ///
    /// `None` if the used bins do not determine it.
    fn fit_harmonic(&mut self, rim: &Annulus, edges: &[Edge], used: &[bool]) -> Option<Vector3<f64>> {
        let Self { level, weight, residual, robust_weight, sorted, .. } = self;
        let padded = edges.len().next_multiple_of(LANES);
        level.clear();
        level.extend(edges.iter().zip(used).map(|(edge, used)| if *used { edge.inside } else { 0.0 }));
        weight.clear();
        weight.extend(used.iter().map(|used| if *used { 1.0_f32 } else { 0.0 }));
        for list in [&mut *level, &mut *weight, &mut *residual, &mut *robust_weight] {
            list.resize(padded, 0.0);
        }
        let (mut answer, mut limit) = (Vector3::zeros(), f32::INFINITY);
        for round in 0..ROUNDS {
            if round > 0 {
                residuals(level, rim.directions(), answer.cast().into(), residual);
                sorted.clear();
                let sizes = residual.iter().zip(weight.iter()).filter(|(_, weight)| **weight > 0.0);
                sorted.extend(sizes.map(|(residual, _)| residual.abs()));
                let middle = sorted.len() / 2;
                limit = TUKEY * SIGMA_PER_MEDIAN as f32 * nth_smallest(sorted, middle).max(1e-3);
            }
            // The weights are 0 and 1, so they are their own roots.
            let limits = Limits { weighted: limit, plain: f32::INFINITY };
            let sums = reweigh([level, weight, weight, residual], rim.directions(), limits, robust_weight);
            let (normal, right) = normal_equations(&sums);
            answer = normal.cholesky()?.solve(&right);
        }
        Some(answer)
    }
}

/// Returns the length of the longest circular run of unused bins.
fn max_gap(used: &[bool]) -> f64 {
    let (mut widest, mut gap) = (0, 0);
    for used in used.iter().chain(used) {
        gap = if *used { 0 } else { gap + 1 };
        widest = widest.max(gap);
    }
    widest.min(used.len()) as f64
}
