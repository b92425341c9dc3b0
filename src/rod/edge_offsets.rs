//! The positions of edges relative to the reported point of a rod.

use crate::results::{Estimate, ROD_EDGES};

/// Returns the unweighted mean of independent positions.
pub(super) fn mean_position(places: impl Iterator<Item = Estimate> + Clone) -> Estimate {
    let count = places.clone().count().max(1) as f64;
    Estimate {
        value: places.clone().map(|place| place.value).sum::<f64>() / count,
        sigma: places.map(|place| place.sigma.powi(2)).sum::<f64>().sqrt() / count,
    }
}

/// Returns the position of an edge relative to the reported point.
pub(super) fn offset_px(edge: Estimate, point: Estimate) -> Estimate {
    Estimate { value: edge.value - point.value, sigma: edge.sigma.hypot(point.sigma) }
}

/// Returns the mean of the points that edges, by their index, predict. The errors of their offsets are mostly common.
pub(super) fn mean_of_predictions(edges: &[(usize, Estimate)], offsets_px: &[Estimate; ROD_EDGES]) -> Estimate {
    let predicted =
        |(index, place): &(usize, Estimate)| Estimate { value: place.value - offsets_px[*index].value, ..*place };
    let mean = mean_position(edges.iter().map(predicted));
    let common = edges.iter().map(|(index, _)| offsets_px[*index].sigma).fold(0.0, f64::max);
    Estimate { sigma: mean.sigma.hypot(common), ..mean }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_as_uncertain_as_the_offsets_that_predict_it() {
        let estimate = |value: f64, sigma: f64| Estimate { value, sigma };
        let (upper, lower) = (estimate(36.0, 0.02), estimate(106.0, 0.02));
        let point = estimate(61.0, 0.14);
        let none = estimate(0.0, f64::INFINITY);
        let offsets_px = [offset_px(upper, point), none, offset_px(lower, point), none];
        let later = [(0, estimate(36.4, 0.02)), (2, estimate(106.4, 0.02))];
        let predicted = mean_of_predictions(&later, &offsets_px);
        assert!((predicted.value - 61.4).abs() < 1e-12 && (0.14..0.15).contains(&predicted.sigma));
    }
}
