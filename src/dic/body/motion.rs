//! The motion of a whole body and its uncertainty.

use super::light_field::LightCorrection;
use crate::dic::field::RigidMotion;
use crate::dic::geometry::Point;
use crate::dic::refine::{Match, MatchError, Refiner};
use crate::dic::uncertainty::{GradientNoise, NoisePool, VarianceFactor};
use crate::numeric::Lanes;
use crate::results::PointStatus;

/// The rotation above which a reference should be renewed, deg.
pub const STALE_DEG: f64 = 3.0;

/// The ZNCC below which a reference should be renewed.
const STALE_ZNCC: f64 = 0.8;

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
}

impl BodyMotion {
    /// Whether the reference should be renewed: the body rotated by more than 3 deg, or the ZNCC is below 0.8.
    pub fn is_stale(&self) -> bool {
        self.motion.angle_deg.abs() > STALE_DEG || self.zncc < STALE_ZNCC
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

/// Returns an inverse Hessian of three parameters, padded with zeros to six.
fn pad_to_six(inverse: &[[f64; 3]; 3]) -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| if i < 3 && j < 3 { inverse[i][j] } else { 0.0 }))
}

/// Returns the motion of the point at an offset from the centre, with its uncertainty.
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
) -> RigidMotion {
    let (subset, window, pixels) = (refiner.subset, refiner.window, refiner.window.pixels);
    pool.set_residual(window, residual);
    let free = (pixels as f64 - 7.0).max(1.0);
    let variance = 2.0 * subset.energy * (1.0 - found.zncc) / free;
    let warp = light.and_then(|light| found.warp.after_inverse(&light.step)).unwrap_or(found.warp);
    let inverse = light.map_or(subset.inverse, |light| pad_to_six(&light.inverse));
    let angle = warp.uy.atan2(1.0 + warp.ux);
    let Point { x_px: dx, y_px: dy } = offset;
    let (x, y) = warp.apply(dx, dy);
    let [along_u, along_v, along_angle] = variance_factors(&inverse, angle, offset);
    let factor = pool.factor().weighted_by_slopes(&GradientNoise::from_window(subset, window, residual));
    let (var_u, var_v) = factor.variances(variance, along_u, along_v);
    let mean = 0.5 * (factor.x + factor.y);
    let (var_angle, _) = VarianceFactor { x: mean, y: mean }.variances(variance, along_angle, 0.0);
    RigidMotion {
        u_px: x - dx,
        v_px: y - dy,
        angle_deg: angle.to_degrees(),
        sigma_u_px: var_u.sqrt(),
        sigma_v_px: var_v.sqrt(),
        sigma_angle_deg: var_angle.sqrt().to_degrees(),
        points: pixels as u32,
    }
}
