//! Dilatation of a body between two images, and out-of-plane rotation of its front.

use crate::numeric::invert;
use crate::results::{FieldPoint, PointStatus};

/// The minimum number of subsets.
const MIN_POINTS: usize = 8;
/// The minimum spread of the subsets: their root mean square distance from the mean, px.
const MIN_SPREAD_PX: f64 = 1.0;
/// The number of parameters of a flat body: displacement, rotation and dilatation.
const FLAT_PARAMETERS: usize = 4;
/// The front displacement above which depths are taken half-way between the images, px.
const BENDING_FRONT_PX: f64 = 0.1;

/// The change of a body's image that is not in-plane rigid motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dilatation {
    /// The relative increase of the distances between its subsets. The body approaches the camera, or moves to where
    /// the lens magnifies more.
    pub dilatation: f64,
    /// The displacement of a ball's centre, which is also that of its outline, px. Its front moves differently if the
    /// ball rotates about an axis in the image plane.
    pub center_px: Option<[f64; 2]>,
    /// The rotation about the optical axis, counter-clockwise on the screen, deg, independent of the front.
    pub angle_deg: f64,
    /// The ratios of the standard uncertainties of dilatation (1), centre (px) and rotation to that of the rotation of
    /// a flat body (rad).
    pub sigma_ratios: [f64; 3],
}

/// The outline of a ball in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// The centre, x and y, px.
    pub center_px: [f64; 2],
    /// The radius, px.
    pub radius_px: f64,
    /// The side of the subsets on it, px.
    pub subset_px: f64,
}

impl Sphere {
    /// Returns the depth of the surface in front of the centre, averaged over the subset at a position, in radii.
    fn depth(&self, place: [f64; 2]) -> f64 {
        // Gauss points: the mean over two by two is exact for a cubic.
        let apart = self.subset_px / 12.0_f64.sqrt();
        let at = |dx: f64, dy: f64| {
            let (x, y) = (place[0] + dx - self.center_px[0], place[1] + dy - self.center_px[1]);
            (1.0 - (x * x + y * y) / (self.radius_px * self.radius_px)).max(0.0).sqrt()
        };
        0.25 * (at(-apart, -apart) + at(apart, -apart) + at(-apart, apart) + at(apart, apart))
    }
}

/// Estimates the dilatation from the valid subsets of a field, for a ball if `ball` is given.
///
/// The model is u = t + p x + q y + a d, v = s + p y - q x + b d, with the depth d = sqrt(1 - r^2 / R^2) of a sphere. p
/// and q together are exactly rotation and dilatation. a and b are the motion of the front relative to the centre. The
/// fit is by least squares, each subset weighted by its own uncertainty. Returns `None` if there are too few subsets,
/// or all in one place.
pub fn fit_dilatation(field: &[FieldPoint], ball: Option<Sphere>) -> Option<Dilatation> {
    let flat_fit = Fit::new(field, ball, None)?;
    let [front_x_px, front_y_px] = flat_fit.parameters.front_px;
    // Taken half-way, the depth is symmetric in the rotation and the bending cancels.
    let bends = front_x_px.hypot(front_y_px) > BENDING_FRONT_PX;
    let fit = if bends { Fit::new(field, ball, Some(flat_fit.parameters.center_px))? } else { flat_fit };
    let Parameters { center_px: [t, s], p, q, .. } = fit.parameters;
    let dilatation = p + q * q / (1.0 + p + (1.0 + p).hypot(q));
    let is_finite = [dilatation, t, s].iter().all(|number| number.is_finite());
    let Parameters { center_px: [ratio_t, ratio_s], p: ratio_p, q: ratio_q, .. } = fit.sigma_ratios;
    let sigma_ratios = [ratio_p, ratio_t.max(ratio_s), ratio_q];
    let angle_deg = q.atan2(1.0 + p).to_degrees();
    is_finite.then_some(Dilatation { dilatation, center_px: ball.map(|_| [t, s]), angle_deg, sigma_ratios })
}

/// The six parameters of the model of [`fit_dilatation`].
#[derive(Clone, Copy)]
struct Parameters {
    /// The displacement of the centre (t, s), px.
    center_px: [f64; 2],
    /// The dilatation along the unrotated axes: (1 + dilatation) cos(angle) - 1.
    p: f64,
    /// The same across them: (1 + dilatation) sin(angle).
    q: f64,
    /// The displacement of the front relative to the centre (a, b), px.
    front_px: [f64; 2],
}

impl From<[f64; 6]> for Parameters {
    fn from([t, s, p, q, a, b]: [f64; 6]) -> Self {
        Self { center_px: [t, s], p, q, front_px: [a, b] }
    }
}

/// A least-squares fit of the model of [`fit_dilatation`].
struct Fit {
    parameters: Parameters,
    /// The ratio of the uncertainty of each parameter to that of the rotation of a flat body.
    sigma_ratios: Parameters,
}

impl Fit {
    /// Fits with the depth of each subset in the first image. If the motion of the centre `moved` is given, px, the
    /// depth is that half-way between the images.
    ///
    /// `None` if there are too few subsets or all are in one place.
    fn new(field: &[FieldPoint], ball: Option<Sphere>, moved: Option<[f64; 2]>) -> Option<Self> {
        let middle = mean_position(field)?;
        let from = ball.map_or(middle, |ball| ball.center_px);
        let (mut normal, mut right, mut square, mut total) = ([[0.0; 6]; 6], [0.0; 6], 0.0, 0.0);
        let (mut count, mut moved_square) = (0.0, 0.0);
        for (weight, place, [u, v]) in valid_vectors(field) {
            let half_way = moved.map_or(place, |[t, s]| [place[0] + 0.5 * (u - t), place[1] + 0.5 * (v - s)]);
            let (x, y, d) = (place[0] - from[0], place[1] - from[1], ball.map_or(0.0, |ball| ball.depth(half_way)));
            for (numbers, row, value) in [([0, 2, 3, 4], [1.0, x, y, d], u), ([1, 2, 3, 5], [1.0, y, -x, d], v)] {
                for (i, of_i) in numbers.into_iter().zip(row) {
                    right[i] += weight * of_i * value;
                    numbers.into_iter().zip(row).for_each(|(j, of_j)| normal[i][j] += weight * of_i * of_j);
                }
            }
            square += weight * ((place[0] - middle[0]).powi(2) + (place[1] - middle[1]).powi(2));
            moved_square += weight * (u * u + v * v);
            total += weight;
            count += 2.0;
        }
        if square < MIN_SPREAD_PX * MIN_SPREAD_PX * total {
            return None;
        }
        // The parameters and the residual variance per degree of freedom, for the first parameters only.
        let solved = |numbers: usize| {
            let inverse = invert(&normal, numbers)?;
            let found: [f64; 6] = std::array::from_fn(|k| (0..numbers).map(|j| inverse[k][j] * right[j]).sum());
            let residual_square =
                moved_square - found.iter().zip(right).map(|(found, right)| found * right).sum::<f64>();
            Some((inverse, found, residual_square.max(0.0) / (count - numbers as f64)))
        };
        let (flat, flat_found, flat_variance) = solved(FLAT_PARAMETERS)?;
        let sigma_ratios = |inverse: &[[f64; 6]; 6], factor: f64| {
            Parameters::from(std::array::from_fn(|k| factor * (inverse[k][k] * square).sqrt()))
        };
        if ball.is_none() {
            return Some(Self { parameters: flat_found.into(), sigma_ratios: sigma_ratios(&flat, 1.0) });
        }
        let (round, found, round_left) = solved(6)?;
        // The rotation of the front is not noise.
        let share = (round_left / flat_variance).min(1.0).sqrt();
        Some(Self { parameters: found.into(), sigma_ratios: sigma_ratios(&round, share) })
    }
}

/// Returns the weighted mean position (x, y) of the valid subsets, px; `None` for fewer than [`MIN_POINTS`].
fn mean_position(field: &[FieldPoint]) -> Option<[f64; 2]> {
    let (mut count, mut total, mut sum) = (0, 0.0, [0.0; 2]);
    for (weight, place, _) in valid_vectors(field) {
        count += 1;
        total += weight;
        sum = [sum[0] + weight * place[0], sum[1] + weight * place[1]];
    }
    (count >= MIN_POINTS).then(|| sum.map(|sum| sum / total))
}

/// Returns weight (1/px^2), position (px) and displacement (px) of the valid subsets.
///
/// The weight is the inverse sum of the variances of u and v, which counts as at least 1e-8 px^2.
fn valid_vectors(field: &[FieldPoint]) -> impl Iterator<Item = (f64, [f64; 2], [f64; 2])> + '_ {
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

    /// A field about (60, 50) that moves by (u, v), rotates and dilates.
    fn field((u, v): (f64, f64), angle_deg: f64, dilatation: f64) -> Vec<FieldPoint> {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let point = |k: u16| {
            let (x, y) = (f64::from(k % 7) * 11.0 + 20.0, f64::from(k / 7) * 13.0 + 14.0);
            let (dx, dy) = (x - 60.0, y - 50.0);
            let (to_x, to_y) = ((1.0 + dilatation) * (cos * dx + sin * dy), (1.0 + dilatation) * (cos * dy - sin * dx));
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

    const BALL: Sphere = Sphere { center_px: [53.0, 47.0], radius_px: 60.0, subset_px: 1.0 };

    #[test]
    fn dilatation_is_found_under_any_motion() {
        for (motion, angle_deg) in [((0.0, 0.0), 0.0), ((3.7, -1.2), 0.0), ((0.4, 0.9), 2.9), ((-1.3, 0.2), -40.0)] {
            for truth in [0.0, 3e-5, -2e-3, 0.05] {
                for ball in [None, Some(BALL)] {
                    let found = fit_dilatation(&field(motion, angle_deg, truth), ball).unwrap();
                    // Displacements are stored in single precision.
                    let rounding = 2e-7 * (1.0 + angle_deg.abs());
                    assert!(
                        (found.dilatation - truth).abs() < rounding,
                        "{motion:?} {angle_deg}: {found:?} for {truth}"
                    );
                    assert!((found.angle_deg - angle_deg).abs() < 60.0 * rounding, "{angle_deg}: {found:?}");
                }
            }
        }
    }

    /// The same ball displaced by `center` while it rotates about axes in the image plane.
    fn rolling(center: [f64; 2], [about_y, about_x]: [f64; 2]) -> Vec<FieldPoint> {
        let mut field = field((0.0, 0.0), 0.0, 0.0);
        let (Sphere { center_px: [cx, cy], radius_px, .. }, angle) = (BALL, about_y.hypot(about_x));
        for point in &mut field {
            let [x, y] = [f64::from(point.x_px) - cx, f64::from(point.y_px) - cy];
            let z = (radius_px * radius_px - x * x - y * y).max(0.0).sqrt();
            // It rolls in the direction of its front's motion.
            let (to_x, to_y) = (about_y / angle, about_x / angle);
            let along = x * to_x + y * to_y;
            let moved = along * angle.cos() + z * angle.sin() - along;
            let displacement = point.displacement.as_mut().unwrap();
            (displacement.u_px, displacement.v_px) =
                ((center[0] + moved * to_x) as f32, (center[1] + moved * to_y) as f32);
        }
        field
    }

    #[test]
    fn the_centre_moves_independently_of_its_front() {
        for (turn_deg, close) in [([0.1, -0.07], 1e-4), ([1.0, 0.5], 2e-3), ([0.0, 2.9], 3e-2)] {
            let found = fit_dilatation(&rolling([0.7, -0.3], turn_deg.map(f64::to_radians)), Some(BALL)).unwrap();
            let [x, y] = found.center_px.unwrap();
            assert!((x - 0.7).abs() < close && (y + 0.3).abs() < close, "{turn_deg:?}: {found:?}");
            assert!(found.dilatation.abs() < 0.01 * close, "{turn_deg:?}: {found:?}");
        }
        let flat = fit_dilatation(&rolling([0.7, -0.3], [0.002, -0.001]), None).unwrap();
        assert!(
            flat.dilatation.abs() > 1e-5 && flat.center_px.is_none(),
            "an unmodelled front counts as dilatation: {flat:?}"
        );
    }

    #[test]
    fn a_rotating_front_is_not_noise() {
        let noisy = |mut field: Vec<FieldPoint>| {
            for (k, point) in field.iter_mut().enumerate() {
                let displacement = point.displacement.as_mut().unwrap();
                displacement.u_px += 0.004 * ((k * 37 % 17) as f32 - 8.0) / 5.0;
                displacement.v_px += 0.004 * ((k * 29 % 13) as f32 - 6.0) / 4.0;
            }
            field
        };
        let still = noisy(field((0.7, -0.3), 0.0, 0.0));
        let (flat, round) = (fit_dilatation(&still, None).unwrap(), fit_dilatation(&still, Some(BALL)).unwrap());
        assert!(
            (flat.sigma_ratios[0] - 1.0).abs() < 1e-6 && (0.9..1.2).contains(&round.sigma_ratios[0]),
            "{flat:?} {round:?}"
        );
        assert!((100.0..600.0).contains(&round.sigma_ratios[1]), "{round:?}");
        // The scatter about a rigid motion, to which the ratio refers, includes the motion of the front.
        let rolls = fit_dilatation(&noisy(rolling([0.7, -0.3], [0.02, -0.01])), Some(BALL)).unwrap();
        assert!(rolls.sigma_ratios[1] < 0.2 * round.sigma_ratios[1], "{rolls:?}");
    }

    #[test]
    fn few_subsets_or_a_single_place_give_no_estimate() {
        let mut few = field((0.3, 0.1), 0.2, 0.01);
        few.iter_mut().skip(5).for_each(|point| point.status = PointStatus::Outlier);
        assert_eq!(fit_dilatation(&few, None), None);
        let mut same = field((0.3, 0.1), 0.0, 0.01);
        same.iter_mut().for_each(|point| (point.x_px, point.y_px) = (60.0, 50.0));
        assert_eq!(fit_dilatation(&same, None), None);
    }
}
