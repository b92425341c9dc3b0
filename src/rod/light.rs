//! The shade of paint along a rod: light falls off along it, and where speckles hide the paint, clean edges tell it.

use super::edge::{Edge, Known};
use crate::results::Estimate;

/// Light does not fall off quite evenly: share of what it changes by from the clean edges' middle.
const UNEVEN: f64 = 0.1;

/// What the edges of clean tapes tell an edge at `row`: a line through their paint, each by its uncertainty.
///
/// Nothing where there are none.
pub(super) fn known_at(clean: &[&Edge], row: f64) -> Option<Known> {
    let blur_px = clean.iter().map(|edge| edge.blur_px).sum::<f64>() / clean.len() as f64;
    let paint = |shade: usize| paint_at(clean.iter().map(|edge| (edge.at.value, edge.paints_dn[shade])), row);
    (!clean.is_empty()).then(|| Known { blur_px, paints_dn: [paint(0), paint(1)] })
}

/// The shade at a row from those at other rows; where all of these are one, the same everywhere.
fn paint_at(paints: impl Iterator<Item = (f64, Estimate)> + Clone, row: f64) -> Estimate {
    let weighted = paints.map(|(at, paint)| (at, paint.value, paint.sigma.powi(-2)));
    let sum = |of: &dyn Fn(f64, f64) -> f64| weighted.clone().map(|(at, level, w)| w * of(at, level)).sum::<f64>();
    let weight = sum(&|_, _| 1.0);
    let (middle, mean) = (sum(&|at, _| at) / weight, sum(&|_, level| level) / weight);
    let spread = sum(&|at, _| (at - middle).powi(2));
    if spread <= weight {
        return Estimate { value: mean, sigma: weight.powf(-0.5) };
    }
    let slope = sum(&|at, level| (at - middle) * level) / spread;
    // The more it is noise, the less of it is believed.
    let believed = (1.0 - 1.0 / (spread * slope * slope)).max(0.0);
    let change = believed * slope * (row - middle);
    let variance = 1.0 / weight + (row - middle).powi(2) / spread;
    Estimate { value: mean + change, sigma: variance.sqrt().hypot(UNEVEN * change) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_clean_paint_is_the_less_sure_the_farther_it_goes() {
        let sigma = 0.2;
        let clean = [(90.0, 170.0), (110.0, 168.0)].map(|(at, value)| (at, Estimate { value, sigma }));
        let near = paint_at(clean.into_iter(), 70.0);
        let believed = 1.0 - (sigma * 0.5_f64.sqrt() / 10.0 / 0.1).powi(2);
        assert!((near.value - 169.0 - 3.0 * believed).abs() < 1e-9, "{}", near.value);
        // 30 px from the middle of two that are 10 px from it, and what uneven light may do besides.
        let expected = (sigma * (0.5_f64 + 4.5).sqrt()).hypot(UNEVEN * 3.0 * believed);
        assert!((near.sigma - expected).abs() < 1e-9, "{} {expected}", near.sigma);
        let one = paint_at(clean[..1].iter().copied(), 20.0);
        assert!((one.value - 170.0).abs() < 1e-9 && (one.sigma - sigma).abs() < 1e-9);
    }
}
