//! Jumps of a ball to another object, detected from the motions in the neighbouring frames.

use crate::results::{BodyStep, MotionMethod, RigidStep};

/// The distance from its neighbours that a motion of outlines may always have, px/frame.
const OUTLINE_TOLERANCE_PX: f64 = 1.0;
/// The same of a motion of a texture, in addition to the change between its neighbours.
const TEXTURE_TOLERANCE_PX: f64 = 0.3;
/// The same of any motion, in standard uncertainties.
const TOLERANCE_SIGMAS: f64 = 8.0;
/// The distance from the only neighbour, in speeds: a ball may rebound there.
const REBOUND_SPEEDS: f64 = 2.0;

/// Whether the motion of a step contradicts those before and after it.
///
/// In a frame in which a ball is struck, its displacement lies between the two. A jump to another object does not, nor does
/// a mean of two objects. Without neighbours, no motion is a jump.
pub(super) fn is_jump(step: &BodyStep, before: Option<&RigidStep>, after: Option<&RigidStep>) -> bool {
    let Some(motion) = &step.motion else { return false };
    let sigma_px = |neighbour: &RigidStep| {
        motion.sigma_dx_px.hypot(motion.sigma_dy_px).hypot(neighbour.sigma_dx_px.hypot(neighbour.sigma_dy_px))
    };
    let (here, is_outline) = (velocity_px(motion), step.method == MotionMethod::Outlines);
    match (before, after) {
        (None, None) => false,
        (Some(before), Some(after)) => {
            let ends = [velocity_px(before), velocity_px(after)];
            let change_px = distance_px(ends[0], ends[1]);
            let tolerance_px = if is_outline { OUTLINE_TOLERANCE_PX } else { TEXTURE_TOLERANCE_PX + change_px };
            distance_to_segment_px(here, ends) > tolerance_px + TOLERANCE_SIGMAS * sigma_px(before).max(sigma_px(after))
        }
        (Some(neighbour), None) | (None, Some(neighbour)) => {
            let tolerance_px = OUTLINE_TOLERANCE_PX + REBOUND_SPEEDS * distance_px(velocity_px(neighbour), [0.0; 2]);
            distance_px(here, velocity_px(neighbour)) > tolerance_px + TOLERANCE_SIGMAS * sigma_px(neighbour)
        }
    }
}

fn velocity_px(motion: &RigidStep) -> [f64; 2] {
    [motion.dx_px, motion.dy_px]
}

fn distance_px([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
    (ax - bx).hypot(ay - by)
}

/// Returns the distance of a point from the segment between two others.
fn distance_to_segment_px(point: [f64; 2], [from, to]: [[f64; 2]; 2]) -> f64 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let length2 = along[0].powi(2) + along[1].powi(2);
    let product = (point[0] - from[0]) * along[0] + (point[1] - from[1]) * along[1];
    let share = if length2 > 0.0 { (product / length2).clamp(0.0, 1.0) } else { 0.0 };
    distance_px(point, [from[0] + share * along[0], from[1] + share * along[1]])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moved(dx_px: f64, dy_px: f64) -> RigidStep {
        RigidStep { dx_px, dy_px, sigma_dx_px: 0.02, sigma_dy_px: 0.02, ..RigidStep::STILL }
    }

    fn step(dx_px: f64, dy_px: f64, method: MotionMethod) -> BodyStep {
        BodyStep { motion: Some(moved(dx_px, dy_px)), method, ..BodyStep::default() }
    }

    #[test]
    fn an_outline_that_passes_to_another_object_and_stays_there_jumped() {
        let (before, after) = (moved(-0.2, 0.5), moved(-0.3, -0.7));
        let jump = step(-0.2, 44.3, MotionMethod::Outlines);
        assert!(is_jump(&jump, Some(&before), Some(&after)));
        assert!(is_jump(&jump, Some(&before), None) && is_jump(&jump, None, Some(&after)));
        assert!(!is_jump(&jump, None, None), "it may be as fast");
    }

    #[test]
    fn a_mean_of_two_objects_is_no_motion_of_either() {
        let neighbour = moved(0.63, -0.21);
        let mixed = |method| is_jump(&step(1.2, -0.51, method), Some(&neighbour), Some(&neighbour));
        assert!(mixed(MotionMethod::Subsets) && !mixed(MotionMethod::Outlines), "outlines are less certain");
    }

    #[test]
    fn a_ball_that_is_struck_or_stopped_within_a_frame_does_not_jump() {
        for method in [MotionMethod::Outlines, MotionMethod::WholeBody] {
            let (still, fast) = (moved(0.0, 0.0), moved(40.0, -3.0));
            assert!(!is_jump(&step(25.0, -2.0, method), Some(&still), Some(&fast)));
            assert!(!is_jump(&step(25.0, -2.0, method), Some(&fast), Some(&still)));
            assert!(!is_jump(&step(4.0, 1.0, method), Some(&moved(4.0, 9.0)), Some(&moved(3.5, -7.0))));
            assert!(!is_jump(&step(9.0, 0.0, method), None, Some(&moved(5.0, 0.0))), "it may have lost speed");
        }
    }
}
