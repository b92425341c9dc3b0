//! Conversion between the motion of a body and its displacement field.

use super::outline::Outline;
use super::params::MeasureParams;
use super::pending_frame::{PendingFrame, Target};
use crate::dic::{
    CenterVector, CorrelationParams, Correlator, GridPoint, PlanarMotion, Point, RigidMotion, Sphere, Start,
    center_fit, fit_dilatation, rigid_fit_near,
};
use crate::motion::Rotation;
use crate::results::{BodyStep, Circle, Estimate, PairField, RigidStep};

/// The minimum number of subsets for a rigid motion.
const MIN_POINTS: u32 = 3;

/// The number of subsets that are searched if the motion of a ball is not known.
const INITIAL_POINTS: usize = 9;

/// Returns every n-th subset, so that 9 to 13 remain, spread over all; `None` for fewer than 18.
fn sparse_points(points: &[GridPoint]) -> Option<Vec<GridPoint>> {
    (points.len() >= 2 * INITIAL_POINTS)
        .then(|| points.iter().copied().step_by(points.len() / INITIAL_POINTS).collect())
}

/// Fits the motion of the centre and the rotation, per frame, to all valid subsets.
///
/// `near` is the predicted motion. `None` with fewer than three subsets. Outliers are marked in `field`.
pub(super) fn fit_rigid_step(
    field: &mut PairField,
    outline: &Outline,
    frames: f64,
    subset_size_px: u32,
    near: Start,
) -> Option<RigidStep> {
    let near = match near {
        Start::Motion { u_px, v_px, angle_deg, .. } => Some(PlanarMotion { u_px, v_px, angle_deg }),
        Start::Search | Start::Neighbor => None,
    };
    let (x_px, y_px) = outline.center_px();
    let motion = rigid_fit_near(&mut field.points, Point { x_px, y_px }, subset_size_px, near)?;
    (motion.points >= MIN_POINTS).then(|| per_frame(&motion, frames))
}

/// Fits the dilatation of the body per frame and writes it into `step`, which holds the rigid motion of the field.
///
/// Returns the motion of the centre in x and y, px, and the rotation, deg, per frame, of a ball that may rotate about
/// any axis. `None` for other bodies, or if the subsets do not determine it.
pub(super) fn write_dilatation(
    field: &PairField,
    step: &mut BodyStep,
    outline: &Outline,
    subset_px: u32,
) -> Option<[Estimate; 3]> {
    let ball = match outline {
        Outline::Ball(Circle { x_px, y_px, radius_px, .. }) => {
            Some(Sphere { center_px: [*x_px, *y_px], radius_px: *radius_px, subset_px: f64::from(subset_px) })
        }
        Outline::Rod(_) | Outline::Patch(_) => None,
    };
    let fit = fit_dilatation(&field.points, ball)?;
    // The uncertainty of the rotation per frame.
    let sigma = fit.sigma_ratios.map(|ratio| Some(ratio * step.motion?.sigma_dtheta_deg.to_radians()));
    let frames = f64::from(step.interval_frames);
    let per_frame = |value: f64, sigma: Option<f64>| Some(Estimate { value: value / frames, sigma: sigma? });
    step.growth_fraction = per_frame(fit.dilatation, sigma[0]);
    let [x, y] = fit.center_px?.map(|moved| per_frame(moved, sigma[1]));
    Some([x?, y?, per_frame(fit.angle_deg, sigma[2].map(f64::to_degrees))?])
}

/// Writes the drift of a ball into its step: its fitted motion per frame minus that of the step (px, px, deg).
pub(super) fn set_drift(step: &mut BodyStep, motion: Option<[Estimate; 3]>) {
    let difference = |(step, [x, y, rotation]): (RigidStep, [Estimate; 3])| {
        let minus = |estimate: Estimate, value: f64| Estimate { value: estimate.value - value, ..estimate };
        [minus(x, step.dx_px), minus(y, step.dy_px), minus(rotation, step.dtheta_deg)]
    };
    step.drift = step.motion.zip(motion).map(difference);
}

/// Estimates the unknown motion of a ball per frame from a few subsets, which suffices to match the whole ball.
///
/// `None` for other bodies, unless the rotation method is rigid, for fewer than 18 subsets, or if they do not determine
/// it.
pub(super) fn search_motion(
    correlator: &mut Correlator,
    params: &MeasureParams,
    reference: &PendingFrame,
    target: &Target<'_>,
    outline: &Outline,
    points: &[GridPoint],
) -> Option<RigidStep> {
    let is_enough = matches!(outline, Outline::Ball(_)) && params.rotation == Rotation::Rigid;
    let sparse = sparse_points(points).filter(|_| is_enough)?;
    let (frame, target_frame) = (reference.meta.sequence, target.sequence);
    let mut field = PairField { frame, target_frame, stamp_ns: 0, body: 0, points: Vec::new() };
    correlator.correlate(&reference.prepared, target.prepared, &sparse, Start::Search, &mut field.points);
    let subset_px = params.correlation.subset_size_px;
    fit_rigid_step(&mut field, outline, (target_frame - frame) as f64, subset_px, Start::Search)
}

/// Fits the motion per frame to the displacement at the centre and the rotations of the subsets about it; `None` if
/// they do not determine it.
pub(super) fn fit_center_step(
    field: &PairField,
    outline: &Outline,
    frames: f64,
    params: &CorrelationParams,
) -> Option<RigidStep> {
    let (x_px, y_px) = outline.center_px();
    let vector = |point| CenterVector::from_point(point, Point { x_px, y_px });
    let vectors: Vec<_> = field.points.iter().filter_map(vector).collect();
    center_fit(&vectors, params.step_px, params.subset_size_px).map(|motion| per_frame(&motion, frames))
}

/// Divides a motion by its number of frames.
fn per_frame(motion: &RigidMotion, frames: f64) -> RigidStep {
    RigidStep {
        dx_px: motion.u_px / frames,
        dy_px: motion.v_px / frames,
        dtheta_deg: motion.angle_deg / frames,
        sigma_dx_px: motion.sigma_u_px / frames,
        sigma_dy_px: motion.sigma_v_px / frames,
        sigma_dtheta_deg: motion.sigma_angle_deg / frames,
        points: motion.points,
    }
}

/// Returns the start of a correlation: the displacement predicted over `frames` frames by the motion `step` per frame.
pub(super) fn predicted_start(step: &RigidStep, outline: &Outline, frames: f64) -> Start {
    let (x_px, y_px) = outline.center_px();
    Start::Motion {
        x_px,
        y_px,
        u_px: frames * step.dx_px,
        v_px: frames * step.dy_px,
        angle_deg: frames * step.dtheta_deg,
    }
}
