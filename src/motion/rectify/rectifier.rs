//! The map from the recorded image to a plane without lens distortion and perspective.
//!
//! Bodies are detected and followed in the recorded image. Their results are then mapped to the image of an ideal
//! camera that faces the plane of motion. At its centre that image coincides with the recorded one in position, scale
//! and direction, and all its pixels are equally large.

use super::lens::{Distortion, Lens};
use super::linear_map::{
    determinant, inverse_similarity, multiply, numerical_jacobian, rotation_rad, solve_linear, stretch,
};
use crate::motion::Form;
use crate::results::{BodyStep, Circle, Estimate, Outline, OutlineShape, RigidStep};

/// The step of numerical derivatives, px.
const NEAR_PX: f64 = 1e-3;

/// Positions along each side at which a calibration is checked.
const CHECKED_POSITIONS: usize = 24;

/// The number of points that represent a circle.
const CIRCLE_POINTS: usize = 12;

/// The error of a circle fitted to an outline that is not round, in units of the outline's rms deviation from a circle.
const UNROUND_ERROR: f64 = 1.5;

/// The maximum number of iterations of the inverse map.
const ROUNDS: usize = 20;

/// A camera's calibration: its lens, the plane of motion, or both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Width and height of the calibrated image, px.
    pub image_px: [u32; 2],
    /// The position of the recorded image in the calibrated one, px.
    pub offset_px: [u32; 2],
    /// The lens.
    pub lens: Option<Lens>,
    /// From undistorted pixels (x, y, 1) to the plane, mm.
    pub homography: Option<[[f64; 3]; 3]>,
}

/// The reason why a calibration cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RectifierError {
    /// It has neither a lens nor a plane.
    #[error("holds neither a lens nor a plane")]
    Empty,
    /// The map folds or ends within the image.
    #[error("does not hold at pixel ({x_px}, {y_px}) of its own picture")]
    Folds {
        /// Position x, px.
        x_px: f64,
        /// Position y, px.
        y_px: f64,
    },
}

/// The disc over which a motion was measured, in the recorded image.
struct Disc {
    /// Its centre, px.
    seen: [f64; 2],
    /// The pixel of the ball's centre, px.
    center: [f64; 2],
    radius_px: f64,
}

/// The map of steps and positions between the recorded and the rectified image.
#[derive(Debug, Clone, PartialEq)]
pub struct Rectifier {
    calibration: Calibration,
    /// The centre of the calibrated image, in the recorded image.
    center_px: [f64; 2],
    /// The same in the plane.
    center_plane: [f64; 2],
    /// From the plane to rectified pixels, relative to the centre.
    from_plane_axes: [[f64; 2]; 2],
    mm_per_px: Option<f64>,
}

impl Rectifier {
    /// Creates the map of a calibration and checks it on a grid over its own image.
    ///
    /// # Errors
    ///
    /// [`RectifierError`] when the calibration is empty, or not a one-to-one map of its image. Areas may change by a
    /// factor of 0.01 to 100, relative to the centre.
    pub fn new(calibration: Calibration) -> Result<Self, RectifierError> {
        if calibration.lens.is_none() && calibration.homography.is_none() {
            return Err(RectifierError::Empty);
        }
        let [width, height] = calibration.image_px.map(f64::from);
        let [left, top] = calibration.offset_px.map(f64::from);
        let center_px = [0.5 * (width - 1.0) - left, 0.5 * (height - 1.0) - top];
        let folds = |[x, y]: [f64; 2]| RectifierError::Folds { x_px: x + left, y_px: y + top };
        let from_plane_axes = [[1.0, 0.0], [0.0, 1.0]];
        let mut rectifier = Self { calibration, center_px, center_plane: center_px, from_plane_axes, mm_per_px: None };
        let middle = rectifier.plane_position(center_px).ok_or(folds(center_px))?;
        let slope = rectifier.jacobian_at(center_px, Self::plane_position).ok_or(folds(center_px))?;
        let size = determinant(&slope).abs().sqrt();
        if !(size > 0.0 && size.is_finite()) {
            return Err(folds(center_px));
        }
        rectifier.center_plane = middle;
        rectifier.from_plane_axes = inverse_similarity(&slope, size);
        rectifier.mm_per_px = calibration.homography.map(|_| size);
        for k in 0..CHECKED_POSITIONS * CHECKED_POSITIONS {
            let share = |k: usize| k as f64 / (CHECKED_POSITIONS - 1) as f64;
            let at = [
                share(k % CHECKED_POSITIONS) * (width - 1.0) - left,
                share(k / CHECKED_POSITIONS) * (height - 1.0) - top,
            ];
            let sound = rectifier.jacobian(at).is_some_and(|j| determinant(&j) > 0.01 && determinant(&j) < 100.0);
            if !sound {
                return Err(folds(at));
            }
        }
        Ok(rectifier)
    }

    /// Returns the calibration.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// Returns the scale of the rectified image, mm/px; `None` when only the lens is known.
    pub fn mm_per_px(&self) -> Option<f64> {
        self.mm_per_px
    }

    /// Returns the principal point in the rectified image, px; the centre of the image without a lens.
    pub fn principal_point_px(&self) -> [f64; 2] {
        let offset = self.calibration.offset_px.map(f64::from);
        let ahead = self.calibration.lens.and_then(|lens| {
            let [x, y] = lens.pixel([0.0; 2]);
            self.rectify_point([x - offset[0], y - offset[1]])
        });
        ahead.unwrap_or(self.center_px)
    }

    /// Converts a pixel of the recorded image to its rectified position, px; `None` beyond the calibration.
    pub fn rectify_point(&self, at_px: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y] = self.plane_position(at_px)?;
        let offset = multiply(&self.from_plane_axes, [x - self.center_plane[0], y - self.center_plane[1]]);
        Some([self.center_px[0] + offset[0], self.center_px[1] + offset[1]])
    }

    /// Converts a rectified position to its pixel in the recorded image; `None` beyond the calibration.
    pub fn pixel(&self, place: [f64; 2]) -> Option<[f64; 2]> {
        self.pixel_near(place, place)
    }

    /// Converts a rectified position to its pixel by Newton's method, starting from the pixel `at`.
    fn pixel_near(&self, place: [f64; 2], mut at: [f64; 2]) -> Option<[f64; 2]> {
        for _ in 0..ROUNDS {
            let now = self.rectify_point(at)?;
            let step = solve_linear(&self.jacobian(at)?, [place[0] - now[0], place[1] - now[1]]);
            at = [at[0] + step[0], at[1] + step[1]];
            if step[0].hypot(step[1]) < 1e-9 {
                return Some(at);
            }
        }
        None
    }

    /// Converts a step to rectified pixels; `None` beyond the calibration.
    ///
    /// The circle of a ball is its outline.
    pub fn rectify_step(&self, step: &BodyStep, form: Form) -> Option<BodyStep> {
        let Some(seen) = step.center_px() else { return Some(*step) };
        let radius_px = step.circle().map_or(0.0, |circle| circle.radius_px);
        let (center, uneven) = if form == Form::Ball { self.outline_center(seen, radius_px)? } else { (seen, 0.0) };
        let [x, y] = self.rectify_point(center)?;
        let jacobian = self.jacobian(center)?;
        let (min_stretch, mean) = stretch(&jacobian);
        // A ball's outline is not foreshortened with the plane.
        let size = if self.mm_per_px.is_some() { min_stretch } else { mean };
        let rectified = |circle: Circle| Circle {
            x_px: x,
            y_px: y,
            radius_px: size * circle.radius_px,
            sigma_center_px: mean * circle.sigma_center_px.hypot(uneven * circle.radius_px),
            sigma_radius_px: size * circle.sigma_radius_px.hypot(uneven * circle.radius_px),
            ..circle
        };
        let outline = match step.outline {
            Some(outline) => Some(Outline {
                shape: match &outline.shape {
                    OutlineShape::Circle(circle) => OutlineShape::Circle(rectified(*circle)),
                    OutlineShape::Rod(rod) => OutlineShape::Rod(self.rod(rod)?),
                },
                ..outline
            }),
            None => None,
        };
        let frames = f64::from(step.interval_frames.max(1));
        let motion = match &step.motion {
            Some(motion) => Some(self.plane_motion(motion, &Disc { seen, center, radius_px }, &jacobian, frames)?),
            None => None,
        };
        let growth_fraction = step.growth_fraction.zip(step.motion).and_then(|(grown, motion)| {
            let end = [center[0] + frames * motion.dx_px, center[1] + frames * motion.dy_px];
            let larger = (stretch(&self.jacobian(end)?).1 / mean).ln() / frames;
            Some(Estimate { value: grown.value + larger, ..grown })
        });
        // Lens distortion looks like a rotation out of the plane; only outlines separate the two.
        // The angle since the reference image holds in the recorded image only.
        Some(BodyStep { outline, angle_deg: None, growth_fraction, drift: None, motion, ..*step })
    }

    /// Returns the pixel of the centre of the ball whose outline was fitted by a circle about `seen`, and its
    /// uncertainty in radii.
    ///
    /// A lens preserves neither the centre of a circle nor the roundness of a ball's outline. The part of the outline
    /// that a circle follows is unknown, and the scatter of the fit does not reveal it.
    fn outline_center(&self, seen: [f64; 2], radius_px: f64) -> Option<([f64; 2], f64)> {
        let Some(lens) = self.calibration.lens.filter(|_| radius_px > 0.0) else { return Some((seen, 0.0)) };
        let offset = self.calibration.offset_px.map(f64::from);
        let mut rays = [[0.0; 2]; CIRCLE_POINTS];
        for (ray, [x, y]) in rays.iter_mut().zip(circle_points(seen, radius_px)) {
            *ray = lens.ray([x + offset[0], y + offset[1]])?;
        }
        let mean = |of: &dyn Fn(&[f64; 2]) -> f64| rays.iter().map(of).sum::<f64>() / CIRCLE_POINTS as f64;
        let middle = [mean(&|ray| ray[0]), mean(&|ray| ray[1])];
        let far = |ray: &[f64; 2]| (ray[0] - middle[0]).hypot(ray[1] - middle[1]);
        let radius = mean(&far);
        let uneven = mean(&|ray| (far(ray) / radius - 1.0).powi(2)).sqrt();
        let [x, y] = lens.pixel(middle);
        Some(([x - offset[0], y - offset[1]], UNROUND_ERROR * uneven))
    }

    /// Finds the rigid motion per frame in the plane whose recorded image matches the one measured over a disc.
    ///
    /// `jacobian` is the map's at the centre of the body, and `frames` the interval of the step. `None` beyond the
    /// calibration.
    fn plane_motion(&self, step: &RigidStep, disc: &Disc, jacobian: &[[f64; 2]; 2], frames: f64) -> Option<RigidStep> {
        let Disc { seen, center, radius_px } = *disc;
        let measured = [frames * step.dx_px, frames * step.dy_px, (frames * step.dtheta_deg).to_radians()];
        let from = self.rectify_point(center)?;
        let end = move_rigidly(measured, seen, center);
        let to = self.rectify_point(end)?;
        // A rotation in a plane that is seen obliquely appears slightly larger than it is.
        let (min_stretch, mean) = stretch(jacobian);
        let ratio = (mean / min_stretch).powi(2);
        let (sin, cos) = measured[2].sin_cos();
        let plain = measured[2] + (sin.atan2(0.5 * (ratio + 1.0 / ratio) * cos) - sin.atan2(cos));
        let angle = plain + (rotation_rad(&self.jacobian(end)?) - rotation_rad(jacobian));
        let mut motion = [to[0] - from[0], to[1] - from[1], angle];
        if radius_px > 0.0 {
            // The image is curved within the body, and the measurement is the mean over it.
            let shown = self.apparent_motion(motion, from, disc, measured)?;
            let wrong: [f64; 3] = std::array::from_fn(|k| measured[k] - shown[k]);
            let [x, y] = multiply(jacobian, [wrong[0], wrong[1]]);
            motion = [motion[0] + x, motion[1] + y, motion[2] + wrong[2]];
        }
        let [[a, b], [c, d]] = *jacobian;
        Some(RigidStep {
            dx_px: motion[0] / frames,
            dy_px: motion[1] / frames,
            dtheta_deg: motion[2].to_degrees() / frames,
            sigma_dx_px: (a * step.sigma_dx_px).hypot(b * step.sigma_dy_px),
            sigma_dy_px: (c * step.sigma_dx_px).hypot(d * step.sigma_dy_px),
            ..*step
        })
    }

    /// Returns the rigid motion that a match over the disc in the recorded image shows for a motion in the plane.
    ///
    /// Motions are px, px and rad. `motion` is about the rectified position `from`, and `near` is close to the result.
    fn apparent_motion(&self, motion: [f64; 3], from: [f64; 2], disc: &Disc, near: [f64; 3]) -> Option<[f64; 3]> {
        // The mean of a quadratic over a disc equals that over a circle of this radius.
        let Disc { seen, radius_px, .. } = *disc;
        let ring = circle_points(seen, radius_px * std::f64::consts::FRAC_1_SQRT_2);
        let mut ends = [[0.0; 2]; CIRCLE_POINTS];
        for (end, at) in ends.iter_mut().zip(ring) {
            let target = move_rigidly(motion, from, self.rectify_point(at)?);
            *end = self.pixel_near(target, move_rigidly(near, seen, at))?;
        }
        let middle = [0, 1].map(|k| ends.iter().map(|end| end[k]).sum::<f64>() / CIRCLE_POINTS as f64);
        let (mut along, mut across) = (0.0, 0.0);
        for (end, at) in ends.iter().zip(ring) {
            let (a, b) = ([at[0] - seen[0], at[1] - seen[1]], [end[0] - middle[0], end[1] - middle[1]]);
            along += a[0] * b[0] + a[1] * b[1];
            across += a[1] * b[0] - a[0] * b[1];
        }
        Some([middle[0] - seen[0], middle[1] - seen[1], across.atan2(along)])
    }

    /// Returns the position of a pixel in the plane, mm; without a plane, in the undistorted image, px.
    fn plane_position(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let Calibration { offset_px, lens, homography, .. } = &self.calibration;
        let full: [f64; 2] = std::array::from_fn(|k| pixel[k] + f64::from(offset_px[k]));
        let Some(h) = homography else {
            // Square pixels.
            let lens = lens.as_ref()?;
            let focal_px = (lens.focal_px[0] * lens.focal_px[1]).sqrt();
            return lens.ray(full).map(|ray| ray.map(|x| focal_px * x));
        };
        let [x, y] = match lens {
            Some(lens) => Lens { distortion: Distortion::Brown([0.0; 8]), ..*lens }.pixel(lens.ray(full)?),
            None => full,
        };
        let row = |k: usize| h[k][0] * x + h[k][1] * y + h[k][2];
        let scale = row(2);
        (scale.abs() > 1e-12).then(|| [row(0) / scale, row(1) / scale])
    }

    /// Returns the Jacobian of [`Self::place`] at a pixel; `None` beyond the calibration.
    pub(in crate::motion) fn jacobian(&self, at: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        self.jacobian_at(at, Self::rectify_point)
    }

    /// Returns the Jacobian of `map` at a pixel; `None` where the map has no value.
    fn jacobian_at(&self, at: [f64; 2], map: fn(&Self, [f64; 2]) -> Option<[f64; 2]>) -> Option<[[f64; 2]; 2]> {
        let slope = numerical_jacobian(|at| map(self, at).unwrap_or([f64::NAN; 2]), at, NEAR_PX);
        slope.iter().flatten().all(|x| x.is_finite()).then_some(slope)
    }
}

/// Returns evenly spaced points on a circle, px.
fn circle_points(center: [f64; 2], radius_px: f64) -> [[f64; 2]; CIRCLE_POINTS] {
    std::array::from_fn(|k| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / CIRCLE_POINTS as f64).sin_cos();
        [center[0] + radius_px * cos, center[1] + radius_px * sin]
    })
}

/// Returns a point after a rigid motion: a rotation about `about`, counter-clockwise on the screen (rad), and a shift
/// (px).
fn move_rigidly(motion: [f64; 3], about: [f64; 2], point: [f64; 2]) -> [f64; 2] {
    let [dx, dy, angle] = motion;
    let (sin, cos) = angle.sin_cos();
    let (u, v) = (point[0] - about[0], point[1] - about[1]);
    [about[0] + dx + u * cos + v * sin, about[1] + dy + v * cos - u * sin]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::MotionMethod;

    const BARREL: Lens = Lens {
        focal_px: [700.0, 698.0],
        center_px: [252.0, 259.0],
        distortion: Distortion::Brown([-0.25, 0.08, 0.0004, -0.0003, 0.0, 0.0, 0.0, 0.0]),
    };

    /// A plane rotated by 20 deg about its vertical and by 30 deg about the optical axis, 0.3 mm/px; y upwards.
    fn aslant() -> [[f64; 3]; 3] {
        let (sin, cos) = 30.0_f64.to_radians().sin_cos();
        let (lean, size) = (2e-4, 0.3);
        [[size * cos, size * sin, -70.0], [size * sin / 0.94, -size * cos / 0.94, 90.0], [lean, -0.3 * lean, 1.0]]
    }

    fn all() -> Vec<Rectifier> {
        let calibration = Calibration { image_px: [512, 512], offset_px: [0, 0], lens: Some(BARREL), homography: None };
        let both = Calibration { homography: Some(aslant()), ..calibration };
        let plane = Calibration { lens: None, offset_px: [17, 40], ..both };
        [calibration, both, plane].map(|c| Rectifier::new(c).unwrap()).to_vec()
    }

    #[test]
    fn the_middle_stays_where_it_is_and_as_it_is() {
        for rectifier in all() {
            let [x, y] = rectifier.center_px;
            let place = rectifier.rectify_point([x, y]).unwrap();
            assert!((place[0] - x).hypot(place[1] - y) < 1e-9, "{place:?}");
            let jacobian = rectifier.jacobian([x, y]).unwrap();
            assert!(
                (determinant(&jacobian) - 1.0).abs() < 1e-6 && rotation_rad(&jacobian).abs() < 1e-6,
                "{jacobian:?}"
            );
        }
    }

    #[test]
    fn a_place_has_the_pixel_it_came_from() {
        for rectifier in all() {
            for at in [[3.0, 5.0], [400.0, 77.0], [256.0, 256.0], [470.0, 460.0]] {
                let back = rectifier.pixel(rectifier.rectify_point(at).unwrap()).unwrap();
                assert!((back[0] - at[0]).hypot(back[1] - at[1]) < 1e-6, "{at:?}: {back:?}");
            }
        }
    }

    #[test]
    fn distances_in_the_plane_are_those_of_the_homography() {
        let rectifier = &all()[1];
        let mm = rectifier.mm_per_px().unwrap();
        let [a, b] = [[100.0, 130.0], [380.0, 300.0]];
        let (plane, place) = (|at| rectifier.plane_position(at).unwrap(), |at| rectifier.rectify_point(at).unwrap());
        let apart = |[x, y]: [f64; 2], [u, v]: [f64; 2]| (x - u).hypot(y - v);
        assert!((mm * apart(place(a), place(b)) - apart(plane(a), plane(b))).abs() < 1e-9);
    }

    /// The best-fit rigid motion in the recorded image of a disc of 50 px radius, and its dilatation.
    fn recorded(rectifier: &Rectifier, seen: [f64; 2], (dx, dy, turn_deg): (f64, f64, f64)) -> (RigidStep, f64) {
        let from = rectifier.rectify_point(rectifier.outline_center(seen, 50.0).unwrap().0).unwrap();
        let mut pairs = Vec::new();
        for k in 0..101 * 101 {
            let offset = [f64::from(k % 101) - 50.0, f64::from(k / 101) - 50.0];
            if offset[0].hypot(offset[1]) <= 50.0 {
                let place = rectifier.rectify_point([seen[0] + offset[0], seen[1] + offset[1]]).unwrap();
                let end = rectifier.pixel(move_rigidly([dx, dy, turn_deg.to_radians()], from, place)).unwrap();
                pairs.push((offset, end));
            }
        }
        let count = pairs.len() as f64;
        let [x, y] = [0, 1].map(|k| pairs.iter().map(|(_, end)| end[k]).sum::<f64>() / count);
        let (mut along, mut across, mut square) = (0.0_f64, 0.0, 0.0);
        for ([a, b], [u, v]) in &pairs {
            along += a * (u - x) + b * (v - y);
            across += b * (u - x) - a * (v - y);
            square += a * a + b * b;
        }
        let step = RigidStep {
            dx_px: x - seen[0],
            dy_px: y - seen[1],
            dtheta_deg: across.atan2(along).to_degrees(),
            sigma_dx_px: 0.001,
            sigma_dy_px: 0.001,
            sigma_dtheta_deg: 0.002,
            points: 9,
        };
        (step, along.hypot(across) / square - 1.0)
    }

    #[test]
    fn motions_in_the_plane_come_back_as_they_were() {
        for rectifier in all() {
            for center in [[120.0, 130.0], [380.0, 200.0], [250.0, 400.0]] {
                for truth in [(1.3, -0.7, 0.9), (-6.0, 4.0, -8.0), (0.0, 0.0, 2.5)] {
                    let circle = Circle {
                        x_px: center[0],
                        y_px: center[1],
                        radius_px: 50.0,
                        sigma_center_px: 0.03,
                        sigma_radius_px: 0.03,
                        visible_fraction: 1.0,
                    };
                    let (step, grown) = recorded(&rectifier, center, truth);
                    let seen = BodyStep {
                        frame: 3,
                        stamp_ns: 3,
                        interval_frames: 1,
                        outline: Some(circle.into()),
                        motion: Some(step),
                        method: MotionMethod::WholeBody,
                        growth_fraction: Some(Estimate { value: grown, sigma: 4e-5 }),
                        ..BodyStep::default()
                    };
                    let measured = rectifier.rectify_step(&seen, Form::Ball).unwrap();
                    let (step, left) = (measured.motion.unwrap(), measured.growth_fraction.unwrap().value);
                    let most = 0.03 * grown.abs() + 1e-5 * (1.0 + truth.2.abs());
                    assert!(left.abs() < most, "{center:?} {truth:?}: {left} of {grown}");
                    let wrong = [step.dx_px - truth.0, step.dy_px - truth.1, step.dtheta_deg - truth.2];
                    let most = 2e-4 * truth.0.hypot(truth.1) + 2e-4;
                    assert!(wrong[0].hypot(wrong[1]) < most, "{center:?} {truth:?}: {wrong:?}");
                    assert!(wrong[2].abs() < 2e-4 * truth.2.abs() + 3e-4, "{center:?} {truth:?}: {wrong:?}");
                }
            }
        }
    }

    #[test]
    fn calibrations_that_fold_or_say_nothing_are_refused() {
        let empty = Calibration { image_px: [512, 512], offset_px: [0, 0], lens: None, homography: None };
        assert_eq!(Rectifier::new(empty), Err(RectifierError::Empty));
        let folding = Lens { distortion: Distortion::Brown([-2.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), ..BARREL };
        let refused = Rectifier::new(Calibration { lens: Some(folding), ..empty });
        assert!(matches!(refused, Err(RectifierError::Folds { .. })), "{refused:?}");
        for homography in [[[0.0; 3]; 3], [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [[f64::NAN; 3]; 3]] {
            let refused = Rectifier::new(Calibration { homography: Some(homography), ..empty });
            assert!(matches!(refused, Err(RectifierError::Folds { .. })), "{refused:?}");
        }
    }
}
