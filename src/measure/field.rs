//! From a motion to the field that is looked for, and back.

use crate::dic::{CenterVector, CorrelationParams, GridPoint, RigidMotion, Start, center_fit, growth, rigid_fit_near};
use crate::results::{Estimate, PairField, RigidStep};

/// Fewest subsets a rigid motion is believed from.
const FEWEST_POINTS: u32 = 3;

/// Subsets that are searched for where nothing is known of a ball's motion.
const FIRST_LOOK: usize = 9;

/// Some of the subsets, spread over all; `None` where there are hardly more.
pub(super) fn some_of(points: &[GridPoint]) -> Option<Vec<GridPoint>> {
    (points.len() >= 2 * FIRST_LOOK).then(|| points.iter().copied().step_by(points.len() / FIRST_LOOK).collect())
}

/// Motion of the centre and rotation a frame, from every valid subset; `near` is the motion they were looked for at.
pub(super) fn rigid_step(
    field: &mut PairField,
    center_px: (f64, f64),
    frames: f64,
    subset_size_px: u32,
    near: Start,
) -> Option<RigidStep> {
    let near = match near {
        Start::Motion { u_px, v_px, angle_deg, .. } => Some((u_px, v_px, angle_deg)),
        Start::Search | Start::Neighbor => None,
    };
    let motion = rigid_fit_near(&mut field.points, center_px, subset_size_px, near)?;
    (motion.points >= FEWEST_POINTS).then(|| a_frame(&motion, frames))
}

/// By which share a frame the body grows in the picture; `step` is the rigid motion of its field.
pub(super) fn grown(field: &PairField, step: &RigidStep, frames: f64) -> Option<Estimate> {
    let grown = growth(&field.points)?;
    Some(Estimate { value: grown / frames, sigma: step.sigma_dtheta_deg.to_radians() })
}

/// The same from the field at the centre and its subsets' rotations about it, of the subsets that follow the body.
pub(super) fn center_step(
    field: &PairField,
    center_px: (f64, f64),
    frames: f64,
    params: &CorrelationParams,
) -> Option<RigidStep> {
    let vectors: Vec<_> = field.points.iter().filter_map(|point| CenterVector::of(point, center_px)).collect();
    center_fit(&vectors, params.step_px, params.subset_size_px).map(|motion| a_frame(&motion, frames))
}

fn a_frame(motion: &RigidMotion, frames: f64) -> RigidStep {
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

/// Where subsets are looked for when the body goes on as it moves, for as many frames as a step spans.
pub(super) fn start(step: &RigidStep, (x_px, y_px): (f64, f64), frames: f64) -> Start {
    Start::Motion {
        x_px,
        y_px,
        u_px: frames * step.dx_px,
        v_px: frames * step.dy_px,
        angle_deg: frames * step.dtheta_deg,
    }
}
