//! Lens distortion and its inverse.

use super::linear_map::numerical_jacobian;

/// The maximum number of Newton steps; a few suffice from a point of the image.
const MAX_STEPS: usize = 30;

/// The tolerance of undistorted coordinates, focal lengths.
const TOLERANCE: f64 = 1e-13;

/// A distortion model with the coefficients of OpenCV (names, order and signs).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// Radial and tangential (D. C. Brown, Photogramm. Eng. 37 (1971) 855), with or without a denominator: k1, k2, p1,
    /// p2, k3, k4, k5, k6.
    Brown([f64; 8]),
    /// Equidistant, for wide angles: k1 to k4 of the angle's odd powers (J. Kannala, S. S. Brandt, IEEE Trans. Pattern
    /// Anal. 28 (2006) 1335, <https://doi.org/10.1109/TPAMI.2006.153>).
    Equidistant([f64; 4]),
}

/// A pinhole camera with lens distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Focal lengths along x and y, px.
    pub focal_px: [f64; 2],
    /// The principal point, px.
    pub center_px: [f64; 2],
    /// The distortion model.
    pub distortion: Distortion,
}

impl Distortion {
    /// Returns the distorted image coordinates of a ray (x/z, y/z), in focal lengths.
    fn distort(&self, ray: [f64; 2]) -> [f64; 2] {
        let [x, y] = ray;
        let square = x * x + y * y;
        match self {
            Self::Brown([k1, k2, p1, p2, k3, k4, k5, k6]) => {
                let series = |a: f64, b: f64, c: f64| 1.0 + square * (a + square * (b + square * c));
                let radial = series(*k1, *k2, *k3) / series(*k4, *k5, *k6);
                let twice = 2.0 * x * y;
                [
                    x * radial + p1 * twice + p2 * (square + 2.0 * x * x),
                    y * radial + p2 * twice + p1 * (square + 2.0 * y * y),
                ]
            }
            Self::Equidistant([k1, k2, k3, k4]) => {
                let radius = square.sqrt();
                if radius < 1e-12 {
                    return [x, y];
                }
                let angle = radius.atan();
                let t = angle * angle;
                let distorted = angle * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))));
                [x * distorted / radius, y * distorted / radius]
            }
        }
    }
}

impl Lens {
    /// Returns the undistorted ray (x/z, y/z) of a pixel by Newton's method; `None` where the model has no such ray.
    pub fn ray(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let measured: [f64; 2] = std::array::from_fn(|k| (pixel[k] - self.center_px[k]) / self.focal_px[k]);
        let mut ray = measured;
        for _ in 0..MAX_STEPS {
            let distorted = self.distortion.distort(ray);
            let residual = [distorted[0] - measured[0], distorted[1] - measured[1]];
            let [[a, b], [c, d]] = numerical_jacobian(|ray| self.distortion.distort(ray), ray, 1e-6);
            let det = a * d - b * c;
            // Where the determinant vanishes, the image folds back: two rays meet in one pixel.
            if det.is_nan() || det <= 1e-6 {
                return None;
            }
            let step = [(d * residual[0] - b * residual[1]) / det, (a * residual[1] - c * residual[0]) / det];
            ray = [ray[0] - step[0], ray[1] - step[1]];
            if step[0].hypot(step[1]) < TOLERANCE * (1.0 + ray[0].hypot(ray[1])) {
                return Some(ray);
            }
        }
        None
    }

    /// Projects a ray (x/z, y/z) to its distorted pixel, px.
    pub fn pixel(&self, ray: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.distortion.distort(ray);
        [self.center_px[0] + self.focal_px[0] * x, self.center_px[1] + self.focal_px[1] * y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(distortion: Distortion) -> Lens {
        Lens { focal_px: [812.3, 809.1], center_px: [255.2, 251.7], distortion }
    }

    #[test]
    fn a_pixel_undistorted_and_distorted_again_is_itself() {
        let models = [
            Distortion::Brown([-0.31, 0.12, 0.001, -0.0007, -0.02, 0.0, 0.0, 0.0]),
            Distortion::Brown([0.21, -0.1, 0.0, 0.0004, 0.03, 0.4, 0.05, 0.0]),
            Distortion::Equidistant([-0.02, 0.004, 0.0, 0.0]),
        ];
        for model in models {
            for at in [[0.0, 0.0], [511.0, 3.0], [255.2, 251.7], [100.5, 400.25]] {
                let back = lens(model).pixel(lens(model).ray(at).unwrap());
                assert!((back[0] - at[0]).hypot(back[1] - at[1]) < 1e-9, "{model:?} {at:?}: {back:?}");
            }
        }
    }

    #[test]
    fn models_distort_as_their_formulas_read() {
        // At r = 0.5: 1 - 0.3 x 0.25 + 0.1 x 0.0625 = 0.93125.
        let brown = Distortion::Brown([-0.3, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]).distort([0.3, 0.4]);
        assert!((brown[0] - 0.3 * 0.93125).abs() < 1e-12 && (brown[1] - 0.4 * 0.93125).abs() < 1e-12);
        // p1 = 0.01, p2 = 0.02: x + 2 p1 x y + p2 (r^2 + 2 x^2), y + p1 (r^2 + 2 y^2) + 2 p2 x y.
        let [x, y] = Distortion::Brown([0.0, 0.0, 0.01, 0.02, 0.0, 0.0, 0.0, 0.0]).distort([0.3, 0.4]);
        assert!((x - (0.3 + 0.0024 + 0.02 * 0.43)).abs() < 1e-12 && (y - (0.4 + 0.01 * 0.57 + 0.0048)).abs() < 1e-12);
        // A ray at 45 deg lies pi/4 focal lengths from the axis.
        let [x, _] = Distortion::Equidistant([0.0; 4]).distort([1.0, 0.0]);
        assert!((x - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
    }

    #[test]
    fn beyond_the_fold_of_a_barrel_there_is_no_ray() {
        let barrel = lens(Distortion::Brown([-0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        assert!(barrel.ray([255.2 + 812.3 * 0.5, 251.7]).is_some());
        // x (1 - x^2 / 2) is highest at x = 0.816, where it is 0.544.
        assert_eq!(barrel.ray([255.2 + 812.3 * 0.6, 251.7]), None);
        assert_eq!(barrel.ray([f64::NAN, 0.0]), None);
    }
}
