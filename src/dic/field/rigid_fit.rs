//! Robust fit of a rigid motion to a displacement field.

use crate::dic::geometry::{PlanarMotion, Point};
use crate::numeric::quantile;
use crate::results::{FieldPoint, PointStatus};

/// The motion of a rigid body between two frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidMotion {
    /// The displacement along x of the reference point, px.
    pub u_px: f64,
    /// The displacement along y of the reference point, px.
    pub v_px: f64,
    /// The rotation, counter-clockwise on the screen, deg.
    pub angle_deg: f64,
    /// The standard uncertainty of `u_px`, px.
    pub sigma_u_px: f64,
    /// The standard uncertainty of `v_px`, px.
    pub sigma_v_px: f64,
    /// The standard uncertainty of `angle_deg`, deg.
    pub sigma_angle_deg: f64,
    /// The number of subsets used.
    pub points: u32,
}

impl RigidMotion {
    /// Returns the motion without its uncertainty.
    pub fn planar(&self) -> PlanarMotion {
        PlanarMotion { u_px: self.u_px, v_px: self.v_px, angle_deg: self.angle_deg }
    }

    /// Returns the motion with its standard uncertainties multiplied by `factor`.
    pub(in crate::dic) fn with_scaled_sigmas(self, factor: f64) -> Self {
        Self {
            sigma_u_px: factor * self.sigma_u_px,
            sigma_v_px: factor * self.sigma_v_px,
            sigma_angle_deg: factor * self.sigma_angle_deg,
            ..self
        }
    }
}

/// Tukey's constant: 95 % efficiency for Gaussian noise.
const TUKEY: f64 = 4.685;

/// The residual above which a vector is an outlier, standard deviations.
const MAX_RESIDUAL_SIGMAS: f64 = 5.0;

/// The minimum scatter assumed in the outlier test, px.
const MIN_SCATTER_PX: f64 = 0.002;

/// The residual below which a vector follows the predicted motion, standard deviations and px.
const FOLLOWING_SIGMAS: f64 = 4.0;
const FOLLOWING_PX: f64 = 0.01;

/// The step that ends the iteration, px and rad.
const CONVERGED: f64 = 1e-7;

/// The number of pairs of points tried for the initial guess.
const TRIALS: usize = 60;

/// The maximum number of reweighting rounds; the weights converge within a few.
const MAX_ROUNDS: usize = 8;

/// One vector, relative to the reference point.
#[derive(Debug, Clone, Copy)]
struct Vector {
    index: usize,
    x: f64,
    y: f64,
    u: f64,
    v: f64,
    /// The standard uncertainties of `u` and `v`, px.
    sigmas: [f64; 2],
    /// The mean of their squares.
    variance: f64,
    weight: f64,
}

/// A motion (u, v of the origin; angle in rad) under iteration.
#[derive(Debug, Clone, Copy)]
struct RigidTransform {
    u: f64,
    v: f64,
    angle: f64,
    sin: f64,
    cos: f64,
}

impl RigidTransform {
    /// Returns the rigid motion that moves a pair of vectors, with their residual split equally; `None` if they are less
    /// than 1 px apart.
    fn from_pair(a: &Vector, b: &Vector) -> Option<Self> {
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        if dx * dx + dy * dy < 1.0 {
            return None;
        }
        let (ex, ey) = (dx + b.u - a.u, dy + b.v - a.v);
        let angle = (dy * ex - dx * ey).atan2(dx * ex + dy * ey);
        let turned = Self::new(0.0, 0.0, angle);
        let (ra, rb) = (turned.residual(a), turned.residual(b));
        Some(Self { u: 0.5 * (ra.0 + rb.0), v: 0.5 * (ra.1 + rb.1), ..turned })
    }

    /// Creates a displacement (u, v) of the origin, px, with a rotation about it, counter-clockwise on the screen, rad.
    fn new(u: f64, v: f64, angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        Self { u, v, angle, sin, cos }
    }

    /// Returns the measured minus the predicted displacement of a vector, px.
    fn residual(&self, vector: &Vector) -> (f64, f64) {
        let u = self.u + (self.cos - 1.0) * vector.x + self.sin * vector.y;
        let v = self.v - self.sin * vector.x + (self.cos - 1.0) * vector.y;
        (vector.u - u, vector.v - v)
    }

    /// Returns the squared length of the residual of a vector, px^2.
    fn squared_distance(&self, vector: &Vector) -> f64 {
        let (u, v) = self.residual(vector);
        u * u + v * v
    }
}

/// Fits one rigid motion to all valid vectors of a field.
///
/// The displacement returned is that of the reference point (`x_px`, `y_px`). The rotation is exact, not the
/// small-angle form. The initial guess is the motion of that of 60 pairs of points that most others agree with, so
/// almost half of the vectors may belong to something else (least median of squares, P. J. Rousseeuw, J. Am. Stat.
/// Assoc. 79 (1984) 871, <https://doi.org/10.1080/01621459.1984.10477105>). Least squares follow, weighted by the
/// uncertainty of each vector and by Tukey's biweight. Vectors that do not follow the body are marked as outliers and
/// lose their displacement.
///
/// The uncertainties account for overlapping subsets: two that share a part of their pixels share that part of their
/// noise. `subset_size_px` is the full width of the subsets.
///
/// Returns `None` if fewer than three vectors are left, or if they do not determine a motion.
///
/// # Cost
///
/// Proportional to the number of points times the number of subsets that overlap one.
pub fn rigid_fit(field: &mut [FieldPoint], x_px: f64, y_px: f64, subset_size_px: u32) -> Option<RigidMotion> {
    rigid_fit_near(field, Point { x_px, y_px }, subset_size_px, None)
}

/// Fits like [`rigid_fit`], with the motion `near` as the initial guess if three quarters of the vectors follow it.
///
/// `point` is the reference point of the result and of `near`.
pub fn rigid_fit_near(
    field: &mut [FieldPoint],
    point: Point,
    subset_size_px: u32,
    near: Option<PlanarMotion>,
) -> Option<RigidMotion> {
    let mut vectors = collect_vectors(field, point);
    if vectors.len() < 3 {
        return None;
    }
    let predicted = near.map(|near| RigidTransform::new(near.u_px, near.v_px, near.angle_deg.to_radians()));
    let mut transform =
        predicted.filter(|transform| is_followed(transform, &vectors)).or_else(|| least_median_motion(&vectors))?;
    let mut scatter = MIN_SCATTER_PX;
    for _ in 0..MAX_ROUNDS {
        scatter = robust_scatter(&transform, &vectors);
        for vector in &mut vectors {
            let ratio = transform.squared_distance(vector) / (TUKEY * TUKEY * expected_variance(vector, scatter));
            let biweight = if ratio < 1.0 { (1.0 - ratio).powi(2) } else { 0.0 };
            vector.weight = biweight / vector.variance;
        }
        let before = std::mem::replace(&mut transform, weighted_fit(&vectors)?);
        if [transform.u - before.u, transform.v - before.v, transform.angle - before.angle]
            .iter()
            .all(|step| step.abs() < CONVERGED)
        {
            break;
        }
    }
    let follows = |vector: &Vector| {
        transform.squared_distance(vector)
            <= MAX_RESIDUAL_SIGMAS * MAX_RESIDUAL_SIGMAS * expected_variance(vector, scatter)
    };
    for vector in vectors.iter().filter(|vector| !follows(vector)) {
        field[vector.index].displacement = None;
        field[vector.index].status = PointStatus::Outlier;
    }
    vectors.retain(|vector| vector.weight > 0.0 && follows(vector));
    if vectors.len() < 3 {
        return None;
    }
    with_uncertainty(&transform, &vectors, f64::from(subset_size_px))
}

/// Whether at least three quarters of the vectors follow a motion, within [`FOLLOWING_SIGMAS`] or [`FOLLOWING_PX`].
fn is_followed(transform: &RigidTransform, vectors: &[Vector]) -> bool {
    let near = |vector: &&Vector| {
        let limit = (FOLLOWING_SIGMAS * FOLLOWING_SIGMAS * vector.variance).max(FOLLOWING_PX * FOLLOWING_PX);
        transform.squared_distance(vector) <= limit
    };
    4 * vectors.iter().filter(near).count() >= 3 * vectors.len()
}

/// Returns the expected variance of a vector, px^2: its own, or that of the field's scatter (px) if larger.
fn expected_variance(vector: &Vector, scatter: f64) -> f64 {
    (scatter * scatter).max(vector.variance)
}

/// Returns the valid vectors of a field, with positions relative to `origin`.
fn collect_vectors(field: &[FieldPoint], origin: Point) -> Vec<Vector> {
    let vector = |(index, point): (usize, &FieldPoint)| {
        let displacement = point.displacement.filter(|_| point.status == PointStatus::Valid)?;
        let (sigma_u, sigma_v) = (f64::from(displacement.sigma_u_px), f64::from(displacement.sigma_v_px));
        let variance = 0.5 * (sigma_u * sigma_u + sigma_v * sigma_v);
        Some(Vector {
            index,
            x: f64::from(point.x_px) - origin.x_px,
            y: f64::from(point.y_px) - origin.y_px,
            u: f64::from(displacement.u_px),
            v: f64::from(displacement.v_px),
            sigmas: [sigma_u, sigma_v].map(|sigma| sigma.max(1e-4)),
            variance: variance.max(1e-8),
            weight: 1.0,
        })
    };
    field.iter().enumerate().filter_map(vector).collect()
}

/// Fits a rigid motion by least median of squares: of the motions of [`TRIALS`] pairs of vectors, returns that with the
/// smallest median residual.
///
/// The pairs are a fixed pseudo-random sequence. `None` if none is at least 1 px apart. Source: see [`rigid_fit`].
fn least_median_motion(vectors: &[Vector]) -> Option<RigidTransform> {
    let count = vectors.len();
    let mut best: Option<(f64, RigidTransform)> = None;
    let mut distances = Vec::with_capacity(count);
    // A fixed sequence of pairs, mostly far apart in the list and so in the image.
    let mut state = 0x2545_F491_u32;
    let mut pick = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as usize % count
    };
    for _ in 0..TRIALS {
        let (a, b) = (vectors[pick()], vectors[pick()]);
        let Some(transform) = RigidTransform::from_pair(&a, &b) else { continue };
        distances.clear();
        distances.extend(vectors.iter().map(|vector| transform.squared_distance(vector)));
        let (middle, smallest) = (count / 2, best.as_ref().map_or(f64::INFINITY, |(smallest, _)| *smallest));
        // If at most half are nearer than the best median, this median is not smaller.
        if distances.iter().filter(|distance| **distance < smallest).count() <= middle {
            continue;
        }
        best = quantile(&mut distances, 0.5).map(|median| (median, transform));
    }
    best.map(|(_, transform)| transform)
}

/// Returns the standard deviation of one residual component, px, from the median distance; at least
/// [`MIN_SCATTER_PX`].
fn robust_scatter(transform: &RigidTransform, vectors: &[Vector]) -> f64 {
    let mut distances: Vec<f64> = vectors.iter().map(|vector| transform.squared_distance(vector)).collect();
    let median = quantile(&mut distances, 0.5).unwrap_or(0.0);
    // The median length of a Gaussian vector is 1.1774 standard deviations of a component.
    (median.sqrt() / 1.1774).max(MIN_SCATTER_PX)
}

/// Fits the exact rigid motion by weighted least squares, in closed form; `None` if all weights are zero.
///
/// S. Umeyama, IEEE Trans. Pattern Anal. Mach. Intell. 13 (1991) 376, <https://doi.org/10.1109/34.88573>, without
/// scale.
fn weighted_fit(vectors: &[Vector]) -> Option<RigidTransform> {
    let total: f64 = vectors.iter().map(|v| v.weight).sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let mean = |value: fn(&Vector) -> f64| vectors.iter().map(|v| v.weight * value(v)).sum::<f64>() / total;
    let (x, y) = (mean(|v| v.x), mean(|v| v.y));
    let (tx, ty) = (mean(|v| v.x + v.u), mean(|v| v.y + v.v));
    let (mut along, mut across) = (0.0, 0.0);
    for v in vectors {
        let ((ax, ay), (bx, by)) = ((v.x - x, v.y - y), (v.x + v.u - tx, v.y + v.v - ty));
        along += v.weight * (ax * bx + ay * by);
        across += v.weight * (ay * bx - ax * by);
    }
    let angle = across.atan2(along);
    let (sin, cos) = angle.sin_cos();
    // The displacement of the origin.
    Some(RigidTransform { u: tx - (cos * x + sin * y), v: ty - (cos * y - sin * x), angle, sin, cos })
}

/// Returns the motion with its uncertainty; `None` if the normal equations are singular.
///
/// The influence of each vector on the weighted fit is propagated through the covariance of all vectors. The result
/// grows with the scatter of the residuals where that exceeds the vectors' uncertainties. `size` is the full width of
/// the subsets, px.
fn with_uncertainty(transform: &RigidTransform, vectors: &[Vector], size: f64) -> Option<RigidMotion> {
    let RigidTransform { sin, cos, .. } = *transform;
    // The derivative of (x', y') by the angle.
    let lever = |v: &Vector| (-sin * v.x + cos * v.y, -cos * v.x - sin * v.y);
    let mut normal = [[0.0; 3]; 3];
    for v in vectors {
        let (a, b) = lever(v);
        let rows = [[1.0, 0.0, a], [0.0, 1.0, b]];
        for row in rows {
            for (line, i) in normal.iter_mut().zip(row) {
                line.iter_mut().zip(row).for_each(|(value, j)| *value += v.weight * i * j);
            }
        }
    }
    let inverse = crate::numeric::invert(&normal, 3)?;
    let influence = |v: &Vector| {
        let (a, b) = lever(v);
        let rows = [[1.0, 0.0, a], [0.0, 1.0, b]];
        rows.map(|row| {
            let along = |k: usize| v.weight * (0..3).map(|j| inverse[k][j] * row[j]).sum::<f64>();
            [along(0), along(1), along(2)]
        })
    };
    let influences: Vec<[[f64; 3]; 2]> = vectors.iter().map(influence).collect();
    let places: Vec<[f64; 4]> = vectors.iter().map(|v| [v.x, v.y, v.sigmas[0], v.sigmas[1]]).collect();
    let variance = variances(&places, &influences, size);
    // The excess of the residuals over the uncertainties of the vectors.
    let squares: f64 = vectors.iter().map(|v| transform.squared_distance(v) / v.variance).sum();
    let freedom = (2 * vectors.len() - 3) as f64;
    let excess = (squares / freedom).max(1.0).sqrt();
    Some(RigidMotion {
        u_px: transform.u,
        v_px: transform.v,
        angle_deg: transform.angle.to_degrees(),
        sigma_u_px: variance[0].sqrt() * excess,
        sigma_v_px: variance[1].sqrt() * excess,
        sigma_angle_deg: variance[2].sqrt().to_degrees() * excess,
        points: vectors.len() as u32,
    })
}

/// Returns the variances of three weighted sums over vectors of overlapping subsets.
///
/// `places` holds position and standard deviations of u and v of each vector, row by row on a grid. `influences` holds
/// the weights of its u and v in each sum. `size` is the full width of the subsets, px. Two subsets that share a part
/// of their pixels share that part of their noise.
pub(in crate::dic) fn variances(places: &[[f64; 4]], influences: &[[[f64; 3]; 2]], size: f64) -> [f64; 3] {
    let counted = places.iter().zip(influences).map(|([_, _, u, v], [by_u, by_v])| {
        let ([a, b, c], [d, e, f]) = (by_u.map(|influence| u * influence), by_v.map(|influence| v * influence));
        [a, b, c, d, e, f]
    });
    let counted: Vec<[f64; 6]> = counted.collect();
    let (mut variances, a_pixel) = ([0.0; 3], 1.0 / size);
    for (i, ([ax, ay, ..], own)) in places.iter().zip(&counted).enumerate() {
        let mut sums = [0.0; 6];
        for (j, ([bx, by, ..], other)) in places.iter().zip(&counted).enumerate().skip(i) {
            // No overlap further down.
            if by - ay >= size {
                break;
            }
            let (dx, dy) = ((ax - bx).abs(), (ay - by).abs());
            if dx >= size {
                continue;
            }
            let both = if i == j { 1.0 } else { 2.0 };
            let shared = both * (1.0 - a_pixel * dx) * (1.0 - a_pixel * dy);
            sums.iter_mut().zip(other).for_each(|(sum, other)| *sum += shared * other);
        }
        for (k, variance) in variances.iter_mut().enumerate() {
            *variance += own[k] * sums[k] + own[3 + k] * sums[3 + k];
        }
    }
    variances
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::geometry::grid;
    use crate::dic::tests::{Sequence, Speckle, record};
    use crate::dic::{CorrelationParams, Correlator, Start};
    use crate::results::Displacement;

    fn body(transform: RigidTransform, noise: f64, seed: u64) -> Vec<FieldPoint> {
        let mut sequence = Sequence::new(seed);
        let mut field = Vec::new();
        for k in 0..49 {
            let (x, y) = (f64::from(k % 7) * 40.0, f64::from(k / 7) * 40.0);
            let zero = Vector {
                index: 0,
                x: x - 100.0,
                y: y - 90.0,
                u: 0.0,
                v: 0.0,
                sigmas: [1.0; 2],
                variance: 1.0,
                weight: 1.0,
            };
            let (u, v) = transform.residual(&zero);
            let displacement = Displacement {
                u_px: (noise * sequence.normal() - u) as f32,
                v_px: (noise * sequence.normal() - v) as f32,
                sigma_u_px: noise as f32,
                sigma_v_px: noise as f32,
            };
            field.push(FieldPoint {
                x_px: x as f32,
                y_px: y as f32,
                displacement: Some(displacement),
                zncc: Some(0.99),
                peak_ratio: None,
                status: PointStatus::Valid,
            });
        }
        field
    }

    #[test]
    fn any_angle_is_exact_and_counter_clockwise() {
        for angle_deg in [-170.0, -90.0, -3.0, 0.01, 45.0, 179.0] {
            let transform = RigidTransform::new(3.0, -2.0, f64::to_radians(angle_deg));
            let motion = rigid_fit(&mut body(transform, 1e-6, 1), 100.0, 90.0, 31).unwrap();
            assert!((motion.angle_deg - angle_deg).abs() < 1e-4, "{motion:?}");
            assert!((motion.u_px - 3.0).abs() < 1e-4 && (motion.v_px + 2.0).abs() < 1e-4, "{motion:?}");
        }
        // A point to the right of the centre rises on the screen: its v is negative.
        let transform = RigidTransform::new(0.0, 0.0, 0.1);
        let right = body(transform, 1e-9, 1)[26].displacement.unwrap();
        assert!(right.v_px < 0.0, "{right:?}");
    }

    #[test]
    fn a_third_of_the_vectors_may_follow_something_else() {
        let transform = RigidTransform::new(1.0, 0.5, 0.01);
        let mut field = body(transform, 0.005, 3);
        for point in field.iter_mut().filter(|point| point.y_px < 70.0) {
            point.displacement = Some(Displacement { u_px: 0.2, v_px: 0.1, sigma_u_px: 0.005, sigma_v_px: 0.005 });
        }
        let motion = rigid_fit(&mut field, 100.0, 90.0, 31).unwrap();
        assert!((motion.u_px - 1.0).abs() < 0.005 && (motion.v_px - 0.5).abs() < 0.005, "{motion:?}");
        assert!(field.iter().all(|point| (point.status == PointStatus::Outlier) == (point.y_px < 70.0)));
        assert_eq!(motion.points, 35);
    }

    #[test]
    fn a_predicted_motion_is_used_only_if_the_vectors_follow_it() {
        let transform = RigidTransform::new(1.0, 0.5, 0.01);
        let fit = |near| rigid_fit_near(&mut body(transform, 0.005, 3), Point::new(100.0, 90.0), 31, near).unwrap();
        let (free, near) =
            (fit(None), fit(Some(PlanarMotion { u_px: 1.003, v_px: 0.498, angle_deg: 0.01_f64.to_degrees() })));
        assert!((free.u_px - near.u_px).abs() < 1e-5 && (free.angle_deg - near.angle_deg).abs() < 1e-5);
        assert_eq!(fit(Some(PlanarMotion::default())), free);
    }

    #[test]
    fn two_vectors_are_no_body() {
        let mut field = body(RigidTransform::new(0.0, 0.0, 0.0), 0.01, 1);
        field.truncate(2);
        assert!(rigid_fit(&mut field, 0.0, 0.0, 31).is_none());
    }

    #[test]
    fn the_uncertainty_covers_the_scatter_of_overlapping_subsets() {
        let params = CorrelationParams { step_px: 10, ..CorrelationParams::default() };
        let speckle = Speckle::standard(2, 130.0);
        let moved = speckle.moved(|x, y| {
            let warp = crate::dic::geometry::Warp::rigid(0.37, -0.21, 0.005);
            let (dx, dy) = (x - 65.0, y - 65.0);
            let (tx, ty) = warp.apply(dx, dy);
            (tx - dx, ty - dy)
        });
        let (clean, moved) = (speckle.draw(130, 130), moved.draw(130, 130));
        let mut correlator = Correlator::new(&params, 130, 130).unwrap();
        let points = grid::disc(65.0, 65.0, 57.0, 10, 31, 130, 130);
        let (mut errors, mut reported, mut field) = ([0.0; 3], [0.0; 3], Vec::new());
        let rounds = 24;
        for round in 0..rounds {
            let reference = correlator.prepare(record(&clean, 2.0, 2 * round + 1).view());
            let target = correlator.prepare(record(&moved, 2.0, 2 * round + 2).view());
            correlator.correlate(&reference, &target, &points, Start::Search, &mut field);
            let motion = rigid_fit(&mut field, 65.0, 65.0, 31).unwrap();
            let error = [motion.u_px - 0.37, motion.v_px + 0.21, motion.angle_deg - 0.005_f64.to_degrees()];
            let sigma = [motion.sigma_u_px, motion.sigma_v_px, motion.sigma_angle_deg];
            for k in 0..3 {
                errors[k] += error[k] * error[k] / rounds as f64;
                reported[k] += sigma[k] * sigma[k] / rounds as f64;
            }
        }
        let ratio: [f64; 3] = std::array::from_fn(|k| (reported[k] / errors[k]).sqrt());
        eprintln!("{} subsets, rms {:?} px, px, deg; reported/actual {ratio:?}", points.len(), errors.map(f64::sqrt));
        // 24 rounds: the scatter itself is with_uncertainty by 15 % each.
        assert!(ratio.iter().all(|ratio| (0.75..1.45).contains(ratio)), "{ratio:?}");
        assert!(errors[2].sqrt() < 0.003, "angle {} deg", errors[2].sqrt());
    }
}
