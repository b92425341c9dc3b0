//! Shading of the paint along a rod, interpolated from clean edges where speckles cover the paint.

use super::edge_fit::Edge;
use super::profiles::CleanPaint;
use crate::results::Estimate;

/// The uncertainty of the shading because it is not linear, as a fraction of its change from the mean row.
const NONLINEARITY: f64 = 0.1;

/// Interpolates the paint of clean edges at `row`, px: a line weighted by their uncertainties. The blur is the mean.
///
/// Returns `None` if there is no clean edge.
pub(super) fn clean_paint_at(clean: &[&Edge], row: f64) -> Option<CleanPaint> {
    let blur_px = clean.iter().map(|edge| edge.blur_px).sum::<f64>() / clean.len() as f64;
    let paint = |shade: usize| interpolate_paint(clean.iter().map(|edge| (edge.at.value, edge.paints_dn[shade])), row);
    (!clean.is_empty()).then(|| CleanPaint { blur_px, paints_dn: [paint(0), paint(1)] })
}

/// Interpolates the paint at a row from that at other rows by a weighted line.
///
/// The slope is shrunk by the factor 1 - (sigma / slope)^2, at least 0. `paints` are rows, px, and levels, DN. Rows
/// within about a pixel give a constant.
fn interpolate_paint(paints: impl Iterator<Item = (f64, Estimate)> + Clone, row: f64) -> Estimate {
    let weighted = paints.map(|(at, paint)| (at, paint.value, paint.sigma.powi(-2)));
    let sum = |of: &dyn Fn(f64, f64) -> f64| weighted.clone().map(|(at, level, w)| w * of(at, level)).sum::<f64>();
    let weight = sum(&|_, _| 1.0);
    let (middle, mean) = (sum(&|at, _| at) / weight, sum(&|_, level| level) / weight);
    let spread = sum(&|at, _| (at - middle).powi(2));
    if spread <= weight {
        return Estimate { value: mean, sigma: weight.powf(-0.5) };
    }
    let slope = sum(&|at, level| (at - middle) * level) / spread;
    // The slope shrinks with its share of noise.
    let shrinkage = (1.0 - 1.0 / (spread * slope * slope)).max(0.0);
    let change = shrinkage * slope * (row - middle);
    let variance = 1.0 / weight + (row - middle).powi(2) / spread;
    Estimate { value: mean + change, sigma: variance.sqrt().hypot(NONLINEARITY * change) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_clean_paint_is_less_certain_farther_off() {
        let sigma = 0.2;
        let clean = [(90.0, 170.0), (110.0, 168.0)].map(|(at, value)| (at, Estimate { value, sigma }));
        let near = interpolate_paint(clean.into_iter(), 70.0);
        let shrinkage = 1.0 - (sigma * 0.5_f64.sqrt() / 10.0 / 0.1).powi(2);
        assert!((near.value - 169.0 - 3.0 * shrinkage).abs() < 1e-9, "{}", near.value);
        // 30 px from the middle of two edges at 10 px from it, plus the nonlinear shading.
        let expected = (sigma * (0.5_f64 + 4.5).sqrt()).hypot(NONLINEARITY * 3.0 * shrinkage);
        assert!((near.sigma - expected).abs() < 1e-9, "{} {expected}", near.sigma);
        let one = interpolate_paint(clean[..1].iter().copied(), 20.0);
        assert!((one.value - 170.0).abs() < 1e-9 && (one.sigma - sigma).abs() < 1e-9);
    }
}
