//! The sides of a rod, and with its edges all that is told of it.

use super::edge::Edge;
use crate::results::{Estimate, PointStatus, Rod, RodEdge};

/// Both sides of a rod.
pub(super) struct Axis {
    pub(super) sides: [Edge; 2],
    /// The row their places are told at.
    pub(super) middle: f64,
}

impl Axis {
    /// Columns a row.
    pub(super) fn lean(&self) -> f64 {
        0.5 * (self.sides[0].slope.value + self.sides[1].slope.value)
    }

    fn x(&self, y: f64) -> f64 {
        0.5 * (self.sides[0].at.value + self.sides[1].at.value) + self.lean() * (y - self.middle)
    }

    /// Where the middle between the sides crosses an edge whose place was told at a column.
    pub(super) fn crossing(&self, edge: &Edge, column: f64) -> f64 {
        // y = place + slope (x(y) - column), a line in y.
        let (slope, lean) = (edge.slope.value, self.lean());
        (edge.at.value + slope * (self.x(0.0) - column)) / (1.0 - slope * lean)
    }
}

/// Everything that is told of the rod.
pub(super) fn compose(axis: &Axis, edges: &[Result<Edge, PointStatus>], y_px: Estimate) -> Rod {
    let slopes = edges.iter().flatten().map(|edge| Estimate { value: -edge.slope.value, ..edge.slope });
    let lean = weighted(slopes.chain(axis.sides.map(|side| side.slope)));
    let [a, b] = axis.sides.map(|side| side.at);
    let half = |value: f64| Estimate { value, sigma: 0.5 * a.sigma.hypot(b.sigma) };
    let tilt = lean.value.atan();
    let told = |edge: &Result<Edge, PointStatus>| match edge {
        Ok(edge) => RodEdge { y_px: Some(edge.at), status: PointStatus::Valid },
        Err(status) => RodEdge { y_px: None, status: *status },
    };
    let lever = axis.middle - y_px.value;
    let x = half(axis.x(y_px.value));
    Rod {
        x_px: Estimate { sigma: x.sigma.hypot(lever * lean.sigma), ..x },
        y_px,
        half_width_px: half(0.5 * (b.value - a.value) * tilt.cos()),
        tilt_deg: Estimate { value: tilt.to_degrees(), sigma: lean.sigma.to_degrees() },
        edges: std::array::from_fn(|index| edges.get(index).map(told)),
    }
}

/// Weighted mean, its uncertainty widened where the numbers scatter more than theirs.
fn weighted(numbers: impl Iterator<Item = Estimate> + Clone) -> Estimate {
    let weight = |x: &Estimate| x.sigma.max(1e-6).powi(-2);
    let total: f64 = numbers.clone().map(|x| weight(&x)).sum();
    let value = numbers.clone().map(|x| weight(&x) * x.value).sum::<f64>() / total;
    let chi2: f64 = numbers.clone().map(|x| weight(&x) * (x.value - value).powi(2)).sum();
    let freedom = (numbers.count() as f64 - 1.0).max(1.0);
    Estimate { value, sigma: ((chi2 / freedom).max(1.0) / total).sqrt() }
}
