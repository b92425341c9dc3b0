//! Lines that draw a rod.

use super::Rod;

/// A line from (x, y) to (x, y), px.
pub type Segment = [[f64; 2]; 2];

/// Returns the lines that draw a rod, px (y down): each measured edge from side to side, then both sides between the
/// first and the last measured edge.
///
/// Empty if no edge was measured.
pub fn segments(rod: &Rod) -> Vec<Segment> {
    let (sin, cos) = rod.tilt_deg.value.to_radians().sin_cos();
    let half = rod.half_width_px.value;
    let edge_ends = |y: f64| {
        let x = rod.x_px.value + (y - rod.y_px.value) * sin / cos;
        [[x - half * cos, y + half * sin], [x + half * cos, y - half * sin]]
    };
    let places: Vec<f64> = rod.edges.iter().flatten().filter_map(|edge| edge.y_px).map(|y| y.value).collect();
    let mut lines: Vec<Segment> = places.iter().map(|y| edge_ends(*y)).collect();
    if let (Some(first), Some(last)) = (places.first(), places.last()) {
        let (upper, lower) = (edge_ends(*first), edge_ends(*last));
        lines.extend([[upper[0], lower[0]], [upper[1], lower[1]]]);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::super::{Estimate, PointStatus, RodEdge};
    use super::*;

    #[test]
    fn a_leaning_rod_is_a_leaning_box() {
        let exact = |value| Estimate { value, sigma: 0.0 };
        let edge = |y| Some(RodEdge { y_px: Some(exact(y)), status: PointStatus::Valid });
        let rod = Rod {
            x_px: exact(50.0),
            y_px: exact(40.0),
            half_width_px: exact(10.0),
            tilt_deg: exact(45.0),
            edges: [edge(40.0), edge(50.0), None, None],
        };
        let lines = segments(&rod);
        assert_eq!(lines.len(), 4);
        // Rotated by 45 deg counter-clockwise on the screen: its right side is up, its lower end to the right.
        let [[left_x, left_y], [right_x, right_y]] = lines[0];
        let reach = 10.0 * std::f64::consts::FRAC_1_SQRT_2;
        assert!((left_x - 50.0 + reach).abs() < 1e-9 && (left_y - 40.0 - reach).abs() < 1e-9);
        assert!((right_x - 50.0 - reach).abs() < 1e-9 && (right_y - 40.0 + reach).abs() < 1e-9);
        let [[x, y], _] = lines[1];
        assert!((x + reach - 60.0).abs() < 1e-9 && (y - reach - 50.0).abs() < 1e-9, "{x} {y}");
    }
}
