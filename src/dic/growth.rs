//! By how much a body grows between two pictures.

use crate::results::{FieldPoint, PointStatus};

/// Fewest subsets that tell it.
const FEWEST_POINTS: usize = 6;
/// And how far they are from their middle at least, root mean square, px.
const LEAST_SPREAD_PX: f64 = 1.0;

/// By which share the valid subsets of a field have moved apart from each other: it comes nearer to the camera, or goes
/// to where the lens draws it larger. `None` where they are too few, or all in one place.
///
/// The scale of the similarity that fits their displacements best, in closed form, each by its own uncertainty (S.
/// Umeyama, IEEE Trans. Pattern Anal. Mach. Intell. 13 (1991) 376, <https://doi.org/10.1109/34.88573>). As its levers
/// are those of the rotation, turned by a right angle, it is as sure as that is, in rad.
pub fn growth(field: &[FieldPoint]) -> Option<f64> {
    let (mut count, mut total) = (0, 0.0);
    let (mut from, mut to) = ([0.0; 2], [0.0; 2]);
    for (weight, place, moved) in vectors(field) {
        count += 1;
        total += weight;
        for axis in 0..2 {
            from[axis] += weight * place[axis];
            to[axis] += weight * moved[axis];
        }
    }
    if count < FEWEST_POINTS {
        return None;
    }
    let (from, to) = (from.map(|sum| sum / total), to.map(|sum| sum / total));
    let (mut along, mut across, mut square) = (0.0, 0.0, 0.0);
    for (weight, [x, y], [u, v]) in vectors(field) {
        // Of the displacements alone: the places, which are far larger, would leave rounding.
        let (x, y, u, v) = (x - from[0], y - from[1], u - to[0], v - to[1]);
        along += weight * (x * u + y * v);
        across += weight * (y * u - x * v);
        square += weight * (x * x + y * y);
    }
    if square < LEAST_SPREAD_PX * LEAST_SPREAD_PX * total {
        return None;
    }
    let (along, across) = (along / square, across / square);
    let growth = along + across * across / (1.0 + along + (1.0 + along).hypot(across));
    growth.is_finite().then_some(growth)
}

/// Weight, place and displacement of the valid subsets.
fn vectors(field: &[FieldPoint]) -> impl Iterator<Item = (f64, [f64; 2], [f64; 2])> + '_ {
    field.iter().filter(|point| point.status == PointStatus::Valid).filter_map(|point| {
        let found = point.displacement?;
        let variance = f64::from(found.sigma_u_px).powi(2) + f64::from(found.sigma_v_px).powi(2);
        let place = [point.x_px, point.y_px].map(f64::from);
        Some((1.0 / variance.max(1e-8), place, [found.u_px, found.v_px].map(f64::from)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Displacement;

    /// A field about (60, 50) that moves by (u, v), turns and grows.
    fn field((u, v): (f64, f64), angle_deg: f64, growth: f64) -> Vec<FieldPoint> {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let point = |k: u16| {
            let (x, y) = (f64::from(k % 7) * 11.0 + 20.0, f64::from(k / 7) * 13.0 + 14.0);
            let (dx, dy) = (x - 60.0, y - 50.0);
            let (to_x, to_y) = ((1.0 + growth) * (cos * dx + sin * dy), (1.0 + growth) * (cos * dy - sin * dx));
            let displacement = Displacement {
                u_px: (to_x - dx + u) as f32,
                v_px: (to_y - dy + v) as f32,
                sigma_u_px: 0.004,
                sigma_v_px: 0.004 + 0.001 * f32::from(k % 3),
            };
            FieldPoint {
                x_px: x as f32,
                y_px: y as f32,
                displacement: Some(displacement),
                zncc: None,
                peak_ratio: None,
                status: PointStatus::Valid,
            }
        };
        (0..42).map(point).collect()
    }

    #[test]
    fn what_grows_is_told_whatever_else_it_does() {
        for (motion, angle_deg) in [((0.0, 0.0), 0.0), ((3.7, -1.2), 0.0), ((0.4, 0.9), 2.9), ((-1.3, 0.2), -40.0)] {
            for truth in [0.0, 3e-5, -2e-3, 0.05] {
                let found = growth(&field(motion, angle_deg, truth)).unwrap();
                // Displacements are kept in single precision.
                let rounding = 1e-7 * (1.0 + angle_deg.abs());
                assert!((found - truth).abs() < rounding, "{motion:?} {angle_deg} deg: {found} for {truth}");
            }
        }
    }

    #[test]
    fn a_few_subsets_or_one_place_tell_nothing() {
        let mut few = field((0.3, 0.1), 0.2, 0.01);
        few.iter_mut().skip(5).for_each(|point| point.status = PointStatus::Outlier);
        assert_eq!(growth(&few), None);
        let mut same = field((0.3, 0.1), 0.0, 0.01);
        same.iter_mut().for_each(|point| (point.x_px, point.y_px) = (60.0, 50.0));
        assert_eq!(growth(&same), None);
    }
}
