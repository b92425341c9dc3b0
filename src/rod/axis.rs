//! The axis of a rod between its sides, and the composition of the measured rod.

use super::edge_fit::Edge;
use crate::results::{Estimate, PointStatus, Rod, RodEdge};

/// The difference of two axes that chance explains, sigmas.
pub(super) const CHANCE_SIGMAS: f64 = 3.0;

/// A side of a rod.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    /// The position at the middle row, px.
    pub(super) at: Estimate,
    /// Columns per row.
    pub(super) slope: Estimate,
}

/// Both sides of a rod.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    pub(super) sides: [Side; 2],
    /// The row to which the positions of the sides belong.
    pub(super) middle: f64,
}

impl Axis {
    /// The tilt, columns per row.
    pub(super) fn tilt(&self) -> f64 {
        0.5 * (self.sides[0].slope.value + self.sides[1].slope.value)
    }

    /// Returns the distances of the sides from those of another axis, px.
    fn distances_px(&self, other: &Self) -> [f64; 2] {
        let shift = |k: usize| other.sides[k].at.value + other.tilt() * (self.middle - other.middle);
        [0, 1].map(|k| (self.sides[k].at.value - shift(k)).abs())
    }

    /// Whether chance explains the distances from the sides of another axis.
    pub(super) fn agrees_with(&self, other: &Self) -> bool {
        let sigma = |k: usize| self.sides[k].at.sigma.hypot(other.sides[k].at.sigma);
        self.distances_px(other).into_iter().enumerate().all(|(k, apart_px)| apart_px <= CHANCE_SIGMAS * sigma(k))
    }

    /// Returns the axis with sides as uncertain as half of their distance from those of another.
    pub(super) fn widened_towards(&self, other: &Self) -> Self {
        let apart_px = self.distances_px(other);
        let widened = |k: usize| {
            let Side { at, slope } = self.sides[k];
            Side { at: Estimate { sigma: at.sigma.hypot(0.5 * apart_px[k]), ..at }, slope }
        };
        Self { sides: [0, 1].map(widened), ..*self }
    }

    /// Returns the column of the axis at a row, px.
    fn x_at_row(&self, y: f64) -> f64 {
        0.5 * (self.sides[0].at.value + self.sides[1].at.value) + self.tilt() * (y - self.middle)
    }

    /// Returns the row where the axis crosses an edge, px. The edge's position belongs to the column `column`, px.
    pub(super) fn y_at_edge(&self, edge: &Edge, column: f64) -> f64 {
        // y = position + slope (x(y) - column), a linear equation in y.
        let (slope, tilt) = (edge.slope.value, self.tilt());
        (edge.at.value + slope * (self.x_at_row(0.0) - column)) / (1.0 - slope * tilt)
    }
}

/// Composes the measured rod from its sides, its edges and the reported row `y_px`.
///
/// The tilt is the weighted mean of those of the sides and of the fitted edges.
pub(super) fn compose_rod(axis: &Axis, edges: &[Result<Edge, PointStatus>], y_px: Estimate) -> Rod {
    let slopes = edges.iter().flatten().map(|edge| Estimate { value: -edge.slope.value, ..edge.slope });
    let tilt = weighted_mean(slopes.chain(axis.sides.map(|side| side.slope)));
    let [a, b] = axis.sides.map(|side| side.at);
    let half = |value: f64| Estimate { value, sigma: 0.5 * a.sigma.hypot(b.sigma) };
    let tilt_rad = tilt.value.atan();
    let to_rod_edge = |edge: &Result<Edge, PointStatus>| match edge {
        Ok(edge) => RodEdge { y_px: Some(edge.at), status: PointStatus::Valid },
        Err(status) => RodEdge { y_px: None, status: *status },
    };
    let lever = axis.middle - y_px.value;
    let x = half(axis.x_at_row(y_px.value));
    Rod {
        x_px: Estimate { sigma: x.sigma.hypot(lever * tilt.sigma), ..x },
        y_px,
        half_width_px: half(0.5 * (b.value - a.value) * tilt_rad.cos()),
        tilt_deg: Estimate { value: tilt_rad.to_degrees(), sigma: tilt.sigma.to_degrees() },
        edges: std::array::from_fn(|index| edges.get(index).map(to_rod_edge)),
    }
}

/// Returns the mean weighted by the inverse variances (R. T. Birge, Phys. Rev. 40 (1932) 207,
/// <https://doi.org/10.1103/PhysRev.40.207>).
///
/// Its uncertainty grows if the values scatter more than their own uncertainties.
pub(super) fn weighted_mean(values: impl Iterator<Item = Estimate> + Clone) -> Estimate {
    let weight = |x: &Estimate| x.sigma.max(1e-6).powi(-2);
    let total: f64 = values.clone().map(|x| weight(&x)).sum();
    let value = values.clone().map(|x| weight(&x) * x.value).sum::<f64>() / total;
    let chi2: f64 = values.clone().map(|x| weight(&x) * (x.value - value).powi(2)).sum();
    let freedom = (values.count() as f64 - 1.0).max(1.0);
    Estimate { value, sigma: ((chi2 / freedom).max(1.0) / total).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_that_contradict_each_other_are_as_uncertain_as_half_of_their_distance() {
        let axis = |sides: [f64; 2], sigma: f64| Axis {
            sides: sides
                .map(|value| Side { at: Estimate { value, sigma }, slope: Estimate { value: 0.1, sigma: 0.01 } }),
            middle: 20.0,
        };
        let (narrow, wide) = (axis([11.0, 29.0], 0.1), axis([10.0, 30.2], 0.2));
        assert!(!narrow.agrees_with(&wide) && narrow.agrees_with(&axis([11.4, 29.0], 0.2)));
        let widened = narrow.widened_towards(&wide).sides.map(|side| side.at);
        for (side, apart_px) in widened.iter().zip([1.0, 1.2]) {
            assert!((side.sigma - f64::hypot(0.1, 0.5 * apart_px)).abs() < 1e-9, "{side:?}");
        }
        // At another row, the sides have moved by the tilt.
        assert!(narrow.agrees_with(&Axis { middle: 30.0, ..axis([12.0, 30.0], 0.1) }));
    }
}
