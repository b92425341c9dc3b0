//! Motion of a body from its displacement field at and around the centre.
//!
//! The paper's estimator: the centre's displacement is the field interpolated at the centre, and the rotation is the
//! mean of the subsets' rotations about it. It uses few subsets for the displacement and weights all of them equally
//! for the rotation. [`rigid_fit`](super::rigid_fit()) is more accurate for rigid bodies.

use super::rigid_fit::{RigidMotion, variances};
use crate::dic::geometry::Point;
use crate::results::{FieldPoint, PointStatus};

/// The minimum number of subsets.
const MIN_VECTORS: usize = 3;

/// Subsets closer to the centre than this many grid steps are left out of the rotation.
const MIN_DISTANCE_STEPS: f64 = 0.75;

/// The radius, in grid steps, of the subsets that replace a missing neighbour of the centre.
const NEIGHBOUR_RADIUS_STEPS: f64 = 1.6;

/// The displacement of a subset, with its position relative to the body's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CenterVector {
    /// The position along x, px.
    pub x_px: f64,
    /// The position along y, px.
    pub y_px: f64,
    /// The displacement along x, px.
    pub u_px: f64,
    /// The displacement along y, px.
    pub v_px: f64,
    /// The standard uncertainty of both displacements, px.
    pub sigma_px: f64,
}

impl CenterVector {
    /// Converts a valid point of a field, with its position relative to `center`, px; `None` for others.
    pub fn from_point(point: &FieldPoint, center: Point) -> Option<Self> {
        let displacement = point.displacement.filter(|_| point.status == PointStatus::Valid)?;
        let (sigma_u, sigma_v) = (f64::from(displacement.sigma_u_px), f64::from(displacement.sigma_v_px));
        Some(Self {
            x_px: f64::from(point.x_px) - center.x_px,
            y_px: f64::from(point.y_px) - center.y_px,
            u_px: f64::from(displacement.u_px),
            v_px: f64::from(displacement.v_px),
            sigma_px: (0.5 * (sigma_u * sigma_u + sigma_v * sigma_v)).sqrt(),
        })
    }

    /// Returns the position after the motion, px, relative to the centre, which moved by `center_motion`, px.
    fn final_position(&self, center_motion: [f64; 2]) -> [f64; 2] {
        [self.x_px + self.u_px - center_motion[0], self.y_px + self.v_px - center_motion[1]]
    }

    /// Returns the rotation about the centre, which moved by `center_motion`, px; counter-clockwise on the screen, rad.
    fn angle_rad(&self, center_motion: [f64; 2]) -> f64 {
        let [x, y] = self.final_position(center_motion);
        // y is down.
        (self.y_px * x - self.x_px * y).atan2(self.x_px * x + self.y_px * y)
    }
}

/// Estimates the motion at the origin: the interpolated displacement and the mean rotation about it.
///
/// The vectors lie on a grid of `step_px`, row by row. The uncertainties account for the overlap of subsets of
/// `subset_size_px`. Returns `None` for fewer than three vectors, if those around the origin do not determine its
/// displacement, or if none is far enough from it for a rotation.
pub fn center_fit(vectors: &[CenterVector], step_px: u32, subset_size_px: u32) -> Option<RigidMotion> {
    let step_px = f64::from(step_px);
    let weights = origin_weights(vectors, step_px).filter(|_| vectors.len() >= MIN_VECTORS)?;
    let mean = |part: fn(&CenterVector) -> f64| vectors.iter().zip(&weights).map(|(v, w)| w * part(v)).sum::<f64>();
    let center = [mean(|v| v.u_px), mean(|v| v.v_px)];
    let rotates = |vector: &CenterVector| vector.x_px.hypot(vector.y_px) > MIN_DISTANCE_STEPS * step_px;
    let rotating = vectors.iter().filter(|vector| rotates(vector)).count() as f64;
    if rotating == 0.0 {
        return None;
    }
    let angle_rad = vectors.iter().filter(|v| rotates(v)).map(|v| v.angle_rad(center)).sum::<f64>() / rotating;
    // The derivative of the mean angle with respect to the final position of each vector.
    let slopes: Vec<[f64; 2]> = vectors
        .iter()
        .map(|vector| {
            let [x, y] = vector.final_position(center);
            let reach = rotating * (x * x + y * y);
            if rotates(vector) { [y / reach, -x / reach] } else { [0.0; 2] }
        })
        .collect();
    let all = [0, 1].map(|axis| slopes.iter().map(|slope| slope[axis]).sum::<f64>());
    let influence =
        |(w, slope): (&f64, &[f64; 2])| [[*w, 0.0, slope[0] - w * all[0]], [0.0, *w, slope[1] - w * all[1]]];
    let influences: Vec<_> = weights.iter().zip(&slopes).map(influence).collect();
    let places: Vec<[f64; 4]> = vectors.iter().map(|v| [v.x_px, v.y_px, v.sigma_px, v.sigma_px]).collect();
    let excess = excess(vectors, center, angle_rad);
    let [u, v, angle] = variances(&places, &influences, f64::from(subset_size_px)).map(|part| excess * part.sqrt());
    Some(RigidMotion {
        u_px: center[0],
        v_px: center[1],
        angle_deg: angle_rad.to_degrees(),
        sigma_u_px: u,
        sigma_v_px: v,
        sigma_angle_deg: angle.to_degrees(),
        points: vectors.len() as u32,
    })
}

/// Returns the ratio of the scatter about the rigid motion to the stated uncertainties, at least 1.
///
/// It is the square root of chi^2 per degree of freedom. `center_motion` is the displacement of the centre, px.
fn excess(vectors: &[CenterVector], center_motion: [f64; 2], angle_rad: f64) -> f64 {
    let (sin, cos) = angle_rad.sin_cos();
    let square = |vector: &CenterVector| {
        let [x, y] = vector.final_position(center_motion);
        let (dx, dy) = (x - cos * vector.x_px - sin * vector.y_px, y - cos * vector.y_px + sin * vector.x_px);
        // A vector without a stated uncertainty does not count.
        if vector.sigma_px > 0.0 { (dx * dx + dy * dy) / (vector.sigma_px * vector.sigma_px) } else { 0.0 }
    };
    let freedom = (2 * vectors.len()).saturating_sub(3).max(1) as f64;
    (vectors.iter().map(square).sum::<f64>() / freedom).max(1.0).sqrt()
}

/// Returns the weight of each vector in the displacement interpolated at the origin.
///
/// The interpolation is bilinear between the four vectors around it. If one of these is missing, it is a plane fitted
/// to the neighbours; `None` if they do not span one.
fn origin_weights(vectors: &[CenterVector], step_px: f64) -> Option<Vec<f64>> {
    let share = |v: &CenterVector| (1.0 - v.x_px.abs() / step_px).max(0.0) * (1.0 - v.y_px.abs() / step_px).max(0.0);
    let shares: Vec<f64> = vectors.iter().map(share).collect();
    let total: f64 = shares.iter().sum();
    // The weights of all four add up to 1. They do not if one is missing.
    if total > 0.999 {
        return Some(shares.iter().map(|share| share / total).collect());
    }
    plane_weights(vectors, |vector| vector.x_px.abs().max(vector.y_px.abs()) < NEIGHBOUR_RADIUS_STEPS * step_px)
}

/// Returns the weight of each vector in the value at the origin of a plane fitted to those for which `is_near`.
///
/// `None` if they do not span a plane.
fn plane_weights(vectors: &[CenterVector], is_near: impl Fn(&CenterVector) -> bool) -> Option<Vec<f64>> {
    let near = || vectors.iter().filter(|vector| is_near(vector));
    let sum = |part: fn(&CenterVector) -> f64| near().map(part).sum::<f64>();
    let (count, x, y) = (near().count(), sum(|v| v.x_px), sum(|v| v.y_px));
    let (xx, xy, yy) = (sum(|v| v.x_px * v.x_px), sum(|v| v.x_px * v.y_px), sum(|v| v.y_px * v.y_px));
    let minors = [xx * yy - xy * xy, xy * y - x * yy, x * xy - xx * y];
    let determinant = count as f64 * minors[0] + x * minors[1] + y * minors[2];
    // Vectors on a line span no plane.
    if count < MIN_VECTORS || determinant < 1e-6 * count as f64 * xx.max(1.0) * yy.max(1.0) {
        return None;
    }
    let weight = |v: &CenterVector| (minors[0] + minors[1] * v.x_px + minors[2] * v.y_px) / determinant;
    Some(vectors.iter().map(|vector| if is_near(vector) { weight(vector) } else { 0.0 }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_PX: f64 = 12.0;

    /// Vectors of a body that rotated by `angle_deg` about its centre and moved.
    fn body(shift: [f64; 2], angle_deg: f64, leave_out: impl Fn(i32, i32) -> bool) -> Vec<CenterVector> {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let places = (-3..=3).flat_map(|row| (-3..=3).map(move |column| (column, row)));
        let vector = |(column, row): (i32, i32)| {
            // The centre lies off the grid of the subsets.
            let (x, y) = (STEP_PX * f64::from(column) + 0.3, STEP_PX * f64::from(row) - 0.2);
            let (u_px, v_px) = (shift[0] + x * (cos - 1.0) + y * sin, shift[1] - x * sin + y * (cos - 1.0));
            CenterVector { x_px: x, y_px: y, u_px, v_px, sigma_px: 0.01 }
        };
        places.filter(|(column, row)| !leave_out(*column, *row)).map(vector).collect()
    }

    #[test]
    fn an_exact_field_gives_the_exact_motion_with_and_without_the_subset_at_the_centre() {
        for leave_out in [false, true] {
            let vectors = body([0.7, -1.2], 2.4, |column, row| leave_out && (column, row) == (0, 0));
            let found = center_fit(&vectors, 12, 25).unwrap();
            let errors = [found.u_px - 0.7, found.v_px + 1.2, found.angle_deg - 2.4];
            assert!(errors.iter().all(|error| error.abs() < 1e-9), "{found:?}");
            assert_eq!(found.points, if leave_out { 48 } else { 49 });
        }
    }

    #[test]
    fn too_few_vectors_or_none_around_the_centre_are_no_answer() {
        assert_eq!(center_fit(&body([0.0; 2], 0.0, |_, row| row != 0), 12, 25), None, "a line spans no plane");
        assert_eq!(center_fit(&body([0.0; 2], 0.0, |column, row| column.abs() < 2 && row.abs() < 2), 12, 25), None);
    }

    #[test]
    fn excess_scatter_raises_the_uncertainty_of_the_motion() {
        let mut noise = crate::dic::tests::Sequence::new(9);
        let mut vectors = body([0.7, -1.2], 33.0, |_, _| false);
        let before = center_fit(&vectors, 12, 25).unwrap();
        for vector in &mut vectors {
            vector.u_px += 0.03 * noise.normal();
            vector.v_px += 0.03 * noise.normal();
        }
        let after = center_fit(&vectors, 12, 25).unwrap();
        let ratio = after.sigma_angle_deg / before.sigma_angle_deg;
        // Three times the stated uncertainty of each vector. The residuals include the centre's own error.
        assert!((2.6..3.9).contains(&ratio), "{ratio}");
        assert!(center_fit(&body([0.7, -1.2], 33.0, |_, _| false), 12, 25).unwrap().sigma_u_px <= 0.0101);
    }

    #[test]
    fn the_uncertainty_is_the_scatter_that_independent_noise_makes() {
        let mut noise = crate::dic::tests::Sequence::new(5);
        let films = 4000;
        let mut squares = [0.0; 3];
        let clean = body([0.7, -1.2], 20.0, |_, _| false);
        for _ in 0..films {
            let mut noisy = clean.clone();
            for vector in &mut noisy {
                vector.u_px += 0.01 * noise.normal();
                vector.v_px += 0.01 * noise.normal();
            }
            let found = center_fit(&noisy, 12, 1).unwrap();
            let errors = [found.u_px - 0.7, found.v_px + 1.2, found.angle_deg - 20.0];
            squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error);
        }
        let found = center_fit(&clean, 12, 1).unwrap();
        for (sum, sigma) in squares.iter().zip([found.sigma_u_px, found.sigma_v_px, found.sigma_angle_deg]) {
            let ratio = (sum / f64::from(films)).sqrt() / sigma;
            assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
        }
    }
}
