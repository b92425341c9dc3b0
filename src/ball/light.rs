//! Side light on a ball, told by the brightness along its rim.

use nalgebra::{Matrix3, Vector3};

use super::edge::Edge;
use super::rim::Rim;

/// Rounds of reweighting.
const ROUNDS: usize = 5;
/// Largest gap in the rim, rad: over a larger one the first harmonic is a guess.
const WIDEST_GAP_RAD: f64 = 2.3;

/// How much brighter the inside gets per px towards the centre, per bin, grey levels.
///
/// The inside's brightness along the rim is `a + b cos + c sin`; a light that
/// changes evenly across the disc then falls by `(b cos + c sin) / R` a pixel
/// inwards. All zero when the bins used do not surround the centre.
pub(super) fn side_light(rim: &Rim, edges: &[Edge], used: &[bool], radius: f64, slope: &mut Vec<f32>) {
    slope.clear();
    slope.resize(rim.bins(), 0.0);
    if widest_gap(used) * std::f64::consts::TAU / rim.bins() as f64 > WIDEST_GAP_RAD {
        return;
    }
    let Some(light) = harmonic(rim, edges, used) else { return };
    for (bin, slope) in slope.iter_mut().enumerate() {
        let (cos, sin) = rim.direction(bin);
        *slope = (-(light[1] * cos + light[2] * sin) / radius) as f32;
    }
}

/// Longest circular run of bins that are not used.
fn widest_gap(used: &[bool]) -> f64 {
    let (mut widest, mut gap) = (0, 0);
    for i in 0..2 * used.len() {
        gap = if used[i % used.len()] { 0 } else { gap + 1 };
        widest = widest.max(gap);
    }
    widest.min(used.len()) as f64
}

/// The brightness inside as `a + b cos + c sin`, by reweighted least squares (Tukey).
fn harmonic(rim: &Rim, edges: &[Edge], used: &[bool]) -> Option<Vector3<f64>> {
    let mut answer: Option<Vector3<f64>> = None;
    let mut sizes = Vec::with_capacity(edges.len());
    for _ in 0..ROUNDS {
        let bins = || edges.iter().enumerate().filter(|(bin, _)| used[*bin]);
        let row = |bin: usize| Vector3::new(1.0, rim.direction(bin).0, rim.direction(bin).1);
        let limit = answer.map(|light| {
            sizes.clear();
            sizes.extend(bins().map(|(bin, e)| (f64::from(e.inside) - row(bin).dot(&light)).abs()));
            let middle = sizes.len() / 2;
            4.0 * 1.4826 * sizes.select_nth_unstable_by(middle, f64::total_cmp).1.max(1e-3)
        });
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (bin, edge) in bins() {
            let inside = f64::from(edge.inside);
            let weight = match (answer, limit) {
                (Some(light), Some(limit)) => {
                    let z = (inside - row(bin).dot(&light)) / limit;
                    (1.0 - z * z).max(0.0).powi(2)
                }
                _ => 1.0,
            };
            normal += row(bin) * row(bin).transpose() * weight;
            right += row(bin) * (weight * inside);
        }
        answer = Some(normal.cholesky()?.solve(&right));
    }
    answer
}
