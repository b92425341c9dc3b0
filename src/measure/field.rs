//! From a motion to the field that is looked for, and back.

use super::outline::Outline;
use super::params::MeasureParams;
use super::reference::Reference;
use super::target::Target;
use crate::dic::{
    CenterVector, CorrelationParams, Correlator, GridPoint, RigidMotion, Sphere, Start, center_fit, rigid_fit_near,
    swell,
};
use crate::motion::Rotation;
use crate::results::{BodyStep, Circle, Estimate, PairField, RigidStep};

/// Fewest subsets a rigid motion is believed from.
const FEWEST_POINTS: u32 = 3;

/// Subsets that are searched for where nothing is known of a ball's motion.
const FIRST_LOOK: usize = 9;

/// Some of the subsets, spread over all; `None` where there are hardly more.
fn some_of(points: &[GridPoint]) -> Option<Vec<GridPoint>> {
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

/// Tells by which share a frame the body grows, and gives the motion of a ball a frame whatever axis it turns about: of its
/// centre, px, and its rotation, deg; the body's step is the rigid motion of its field.
pub(super) fn swollen(
    field: &PairField,
    told: &mut BodyStep,
    outline: &Outline,
    subset_px: u32,
) -> Option<[Estimate; 3]> {
    let ball = match outline {
        Outline::Ball(Circle { x_px, y_px, radius_px, .. }) => {
            Some(Sphere { center_px: [*x_px, *y_px], radius_px: *radius_px, subset_px: f64::from(subset_px) })
        }
        Outline::Rod(_) | Outline::Patch(_) => None,
    };
    let found = swell(&field.points, ball)?;
    // Of the rotation a frame.
    let sigma = found.levers.map(|lever| Some(lever * told.step?.sigma_dtheta_deg.to_radians()));
    let frames = f64::from(told.interval_frames);
    let a_frame = |value: f64, sigma: Option<f64>| Some(Estimate { value: value / frames, sigma: sigma? });
    told.growth_fraction = a_frame(found.growth, sigma[0]);
    let [x, y] = found.center_px?.map(|moved| a_frame(moved, sigma[1]));
    Some([x?, y?, a_frame(found.angle_deg, sigma[2].map(f64::to_degrees))?])
}

/// Tells how much farther a frame than its step a ball moves and turns that moves so.
pub(super) fn drift(told: &mut BodyStep, moved: Option<[Estimate; 3]>) {
    let beside = |(step, [x, y, turn]): (RigidStep, [Estimate; 3])| {
        let less = |moved: Estimate, told: f64| Estimate { value: moved.value - told, ..moved };
        [less(x, step.dx_px), less(y, step.dy_px), less(turn, step.dtheta_deg)]
    };
    told.drift = told.step.zip(moved).map(beside);
}

/// About how a ball moves of which nothing is known, from some of its subsets: a match of the whole ball needs no more.
pub(super) fn first_look(
    correlator: &mut Correlator,
    params: &MeasureParams,
    (reference, target): (&Reference, &Target<'_>),
    outline: &Outline,
    points: &[GridPoint],
) -> Option<RigidStep> {
    let is_enough = matches!(outline, Outline::Ball(_)) && params.rotation == Rotation::Rigid;
    let some = some_of(points).filter(|_| is_enough)?;
    let (frame, target_frame) = (reference.meta.sequence, target.sequence);
    let mut field = PairField { frame, target_frame, stamp_ns: 0, body: 0, points: Vec::new() };
    correlator.correlate(&reference.prepared, target.prepared, &some, Start::Search, &mut field.points);
    let subset_px = params.correlation.subset_size_px;
    rigid_step(&mut field, outline.center_px(), (target_frame - frame) as f64, subset_px, Start::Search)
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
