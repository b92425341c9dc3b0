//! The motion of a whole body and its uncertainty.

use std::f64::consts::TAU;

use super::light_field::LightCorrection;
use super::sector_scatter::shared_variances;
use crate::dic::field::RigidMotion;
use crate::dic::geometry::Point;
use crate::dic::refine::{Match, MatchError, Refiner};
use crate::dic::uncertainty::{GradientNoise, NoisePool, VarianceFactor};
use crate::numeric::{Lanes, map_eigenvalues};
use crate::results::PointStatus;

/// The rotation above which a reference should be renewed, deg.
pub const STALE_DEG: f64 = 3.0;

/// The ZNCC below which a reference should be renewed.
const STALE_ZNCC: f64 = 0.8;

/// The variance of a gradient of fourth order per variance of white noise: 2 (2/3)^2 + 2 (1/12)^2, 1/px^2.
const NOISE_GRADIENT: f64 = 65.0 / 72.0;

/// The minimum fraction of the gradient energy that counts as texture: that of noise is known to a few per cent.
const MIN_TEXTURE_FRACTION: f64 = 0.05;

/// The motion of a body between two frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyMotion {
    /// The motion of the requested point; `points` counts pixels.
    pub motion: RigidMotion,
    /// The zero-mean normalised cross-correlation of the matched pixels, -1 to 1.
    pub zncc: f64,
    /// The visible fraction of the reference pixels, 0 to 1.
    pub visible_fraction: f64,
    /// The rotation by which smooth light was found to have held the match back, deg.
    pub light_deg: f64,
    /// The part of the uncertainty of the rotation that recurs in every frame, deg.
    ///
    /// Light holds a match back alike in all frames. If noise outweighs the texture, a match stays at its start.
    pub misfit_deg: f64,
    /// The part of the uncertainty of the displacement that recurs in every frame, px; 0 for rotations up to 3 deg.
    ///
    /// Stripes and light hold a turning body back to one side.
    pub misfit_px: f64,
    /// The share of the texture of the matched pixels that one octant of the body holds, where a part is not visible; else 0.
    pub octant_share: f64,
}

impl BodyMotion {
    /// Multiplies the standard uncertainties with a factor.
    pub(super) fn with_scaled_sigmas(self, factor: f64) -> Self {
        Self {
            motion: self.motion.with_scaled_sigmas(factor),
            misfit_deg: factor * self.misfit_deg,
            misfit_px: factor * self.misfit_px,
            ..self
        }
    }

    /// Whether the reference should be renewed: the body rotated by more than 3 deg, or the ZNCC is below 0.8.
    pub fn is_stale(&self) -> bool {
        self.motion.angle_deg.abs() > STALE_DEG || !self.is_similar()
    }

    /// Whether the body still looks as in its reference: the ZNCC is at least 0.8.
    pub fn is_similar(&self) -> bool {
        self.zncc >= STALE_ZNCC
    }
}

/// Converts the failure of a match to the status of a point.
pub(super) fn status_of(lost: MatchError) -> PointStatus {
    match lost {
        MatchError::OutOfFrame => PointStatus::OutOfFrame,
        MatchError::NotConverged => PointStatus::LowCorrelation,
    }
}

/// Propagates the inverse Hessian to an offset (px) from the centre of a body rotated by `angle` (rad).
///
/// Returns the variances of u and v there (px^2) and of the angle (rad^2), each per DN^2 of residual variance.
pub(super) fn variance_factors(inverse: &[[f64; 6]; 6], angle: f64, offset: Point) -> [f64; 3] {
    let Point { x_px: dx, y_px: dy } = offset;
    // Derivatives of u and v at the offset with respect to (u, v, angle) of the centre.
    let (sin, cos) = angle.sin_cos();
    let rows = [[1.0, 0.0, -sin * dx + cos * dy], [0.0, 1.0, -cos * dx - sin * dy], [0.0, 0.0, 1.0]];
    rows.map(|a| (0..3).map(|i| (0..3).map(|j| a[i] * inverse[i][j] * a[j]).sum::<f64>()).sum())
}

/// Returns the leading 3 x 3 part of a matrix.
fn leading(matrix: &[[f64; 6]; 6]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[i][j]))
}

/// Returns the covariance of a rigid match per DN^2 of residual variance, from its inverse Hessian.
///
/// Noise has gradients as well, and the Hessian contains their energy. They do not recur in the target, so they do not
/// constrain the motion: along the stripes of a pattern, a match stays where it began. The energy in one direction is s of
/// the texture and n of the noise. The variance is then (s + n) / s^2, not 1 / (s + n) (errors in variables: W. A. Fuller,
/// Measurement Error Models, 1987).
///
/// `variance` is that of the residual of the two frames, DN^2, over `pixels` pixels of a compact body.
fn without_noise(inverse: &[[f64; 3]; 3], variance: f64, pixels: f64) -> [[f64; 3]; 3] {
    // In units in which noise has the same energy along all three parameters.
    let arm_px = (pixels / TAU).sqrt();
    let units = [1.0, 1.0, arm_px];
    let scaled: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| inverse[i][j] * units[i] * units[j]));
    let noise = pixels * 0.5 * variance * NOISE_GRADIENT;
    let covariance = map_eigenvalues(&scaled, |reciprocal| {
        let energy = 1.0 / reciprocal;
        let texture = (energy - noise).max(MIN_TEXTURE_FRACTION * energy);
        energy / texture.powi(2)
    });
    std::array::from_fn(|i| std::array::from_fn(|j| covariance[i][j] / (units[i] * units[j])))
}

/// Returns an inverse Hessian of three parameters, padded with zeros to six.
fn pad_to_six(inverse: &[[f64; 3]; 3]) -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| if i < 3 && j < 3 { inverse[i][j] } else { 0.0 }))
}

/// Returns the motion of the point at an offset from the centre, with its uncertainty, of a body that is fully visible.
///
/// `pool` holds the texture of the matched pixels and gets the `residual` of the match. `light` removes a smooth light
/// field. The uncertainty is not yet corrected by the gradient gain.
pub(super) fn motion(
    refiner: &Refiner<'_>,
    found: &Match,
    offset: Point,
    pool: &mut NoisePool,
    residual: &[Lanes],
    light: Option<LightCorrection>,
) -> BodyMotion {
    let (subset, window, pixels) = (refiner.subset, refiner.window, refiner.window.pixels);
    pool.set_residual(window, residual);
    let free = (pixels as f64 - 7.0).max(1.0);
    let variance = 2.0 * subset.energy * (1.0 - found.zncc) / free;
    let warp = light.and_then(|light| found.warp.after_inverse(&light.step)).unwrap_or(found.warp);
    let light_deg = LightCorrection::rotation_deg(light.as_ref());
    let noisy = light.map_or_else(|| leading(&subset.inverse), |light| light.inverse);
    let inverse = pad_to_six(&without_noise(&noisy, variance, pixels as f64));
    let angle = warp.uy.atan2(1.0 + warp.ux);
    let Point { x_px: dx, y_px: dy } = offset;
    let (x, y) = warp.apply(dx, dy);
    let [along_u, along_v, along_angle] = variance_factors(&inverse, angle, offset);
    let factor = pool.factor().weighted_by_slopes(&GradientNoise::from_window(subset, window, residual));
    let (var_u, var_v) = factor.variances(variance, along_u, along_v);
    let mean = 0.5 * (factor.x + factor.y);
    let (var_angle, _) = VarianceFactor { x: mean, y: mean }.variances(variance, along_angle, 0.0);
    let noise_fraction = 1.0 - (noisy[2][2] / along_angle).sqrt();
    let misfit = pool.misfit_fraction().sqrt().hypot(noise_fraction);
    let sigma_angle_deg = var_angle.sqrt().to_degrees();
    let is_stale = angle.to_degrees().abs() > STALE_DEG || found.zncc < STALE_ZNCC;
    let shared = if is_stale { shared_variances(subset, window, residual, variance, &inverse) } else { [0.0; 3] };
    let motion = RigidMotion {
        u_px: x - dx,
        v_px: y - dy,
        angle_deg: angle.to_degrees(),
        sigma_u_px: var_u.sqrt(),
        sigma_v_px: var_v.sqrt(),
        sigma_angle_deg,
        points: pixels as u32,
    };
    BodyMotion {
        motion,
        zncc: found.zncc,
        visible_fraction: 1.0,
        light_deg,
        misfit_deg: (misfit * sigma_angle_deg).hypot(shared[2].sqrt().to_degrees()),
        misfit_px: (shared[0] + shared[1]).sqrt(),
        octant_share: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_with_no_more_than_noise_is_uncertain() {
        // Gradient energies along x, y and the angle; 2000 pixels with noise of 2 DN in either frame.
        let (x, y, angle) = (1e6, 8000.0, 1e9);
        let inverse = [[1.0 / x, 0.0, 0.0], [0.0, 1.0 / y, 0.0], [0.0, 0.0, 1.0 / angle]];
        let covariance = without_noise(&inverse, 8.0, 2000.0);
        let noise = 2000.0 * 4.0 * NOISE_GRADIENT;
        assert!((covariance[0][0] * x - 1.0).abs() < 0.03, "{covariance:?}");
        assert!((covariance[1][1] / (y / (y - noise).powi(2)) - 1.0).abs() < 1e-6, "{covariance:?}");
        assert!(covariance[1][1] * y > 50.0);
    }
}
