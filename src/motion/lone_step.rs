//! Steps that their neighbours contradict.
//!
//! The uncertainty of a match follows from its residual. A match of a few marks, of stripes or under a highlight may settle
//! next to the right place and leave no more residual than another. The body moves smoothly, so the steps before and after
//! agree with each other, and this one differs from them.

use super::Pose;
use super::velocity_fit::KnownMotion;
use crate::results::RigidStep;

/// The number of steps that a step is compared with, and how far they lie from it, frames.
const NEIGHBOURS: usize = 4;
const REACH_FRAMES: u64 = 4;
/// The difference that noise explains, sigmas.
const NOISE_SIGMAS: f64 = 3.0;
/// The minimum ratio of the difference to that between the two middle neighbours.
///
/// Where the body is struck, its neighbours lie on both sides of a jump, and the step between them.
const MIN_RATIO: f64 = 3.0;

/// The rate of one coordinate over a step, per frame, and its standard uncertainty.
#[derive(Debug, Clone, Copy)]
struct Rate {
    value: f64,
    sigma: f64,
}

/// Returns the motion from a frame with the uncertainties by which its neighbours contradict it: x, y and the angle.
///
/// The four nearest steps are sorted, so that one wrong neighbour does not matter. A step is as uncertain as it differs from
/// the mean of the middle two.
pub fn widened_by_neighbours(known: KnownMotion<'_>, frame: u64, interval: u64, moved: RigidStep) -> RigidStep {
    let off = [0, 1, 2].map(|axis| contradiction(known.nodes, frame, interval.max(1), axis));
    RigidStep {
        sigma_dx_px: moved.sigma_dx_px.hypot(off[0]),
        sigma_dy_px: moved.sigma_dy_px.hypot(off[1]),
        sigma_dtheta_deg: moved.sigma_dtheta_deg.hypot(off[2]),
        ..moved
    }
}

/// Returns the difference of a step from its neighbours that they and noise do not explain; 0 if they explain it.
fn contradiction(nodes: &[Pose], frame: u64, interval: u64, axis: usize) -> f64 {
    let rate = |frame: u64| rate_from(nodes, frame, interval, axis);
    let Some(own) = rate(frame) else { return 0.0 };
    let frames = (1..=REACH_FRAMES).flat_map(|apart| [frame.checked_sub(apart), frame.checked_add(apart)]);
    let mut neighbours: Vec<Rate> = frames.flatten().filter_map(rate).take(NEIGHBOURS).collect();
    if neighbours.len() < NEIGHBOURS {
        return 0.0;
    }
    neighbours.sort_by(|a, b| a.value.total_cmp(&b.value));
    let [low, high] = [neighbours[1], neighbours[2]];
    let off = (own.value - 0.5 * (low.value + high.value)).abs();
    let noise = NOISE_SIGMAS * own.sigma.hypot(0.5 * low.sigma.hypot(high.sigma));
    if off > noise && off > MIN_RATIO * (high.value - low.value) { off } else { 0.0 }
}

/// Returns the rate of a coordinate over the step from a frame; `None` unless the step was measured.
fn rate_from(nodes: &[Pose], frame: u64, interval: u64, axis: usize) -> Option<Rate> {
    let at = |frame: u64| nodes.binary_search_by_key(&frame, |node| node.frame).ok().map(|index| &nodes[index]);
    let (from, to) = (at(frame)?, at(frame + interval)?);
    let is_linked = if axis == 2 { from.turn == to.turn } else { from.component == to.component };
    let frames = interval as f64;
    is_linked.then(|| Rate {
        value: (to.pose[axis] - from.pose[axis]) / frames,
        sigma: from.sigma[axis].hypot(to.sigma[axis]) / frames,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The nodes of a body along y at these positions, px, with noise of 0.01 px.
    fn nodes(positions_px: &[f64]) -> Vec<Pose> {
        let node = |(frame, y_px): (usize, &f64)| Pose {
            frame: frame as u64,
            time_frames: frame as f64,
            component: 0,
            turn: 0,
            pose: [0.0, *y_px, 0.0],
            sigma: [0.01; 3],
            bridged: [0.0; 3],
            walk_share: [0.0; 3],
            kept: None,
        };
        positions_px.iter().enumerate().map(node).collect()
    }

    fn off_px(positions_px: &[f64], frame: u64) -> f64 {
        let nodes = nodes(positions_px);
        let known = KnownMotion { nodes: &nodes, to_frame: positions_px.len() as u64 - 1, gravity: None };
        widened_by_neighbours(known, frame, 1, RigidStep::STILL).sigma_dy_px
    }

    #[test]
    fn both_steps_of_a_pose_off_the_path_are_as_uncertain_as_it_is_off() {
        let mut path: Vec<f64> = (0..12).map(|k| 1.4 * f64::from(k) + 0.01 * f64::from(k * k)).collect();
        assert!((0..11).all(|frame| off_px(&path, frame) <= 0.0), "gravity is no contradiction");
        path[5] += 0.3;
        for frame in [4, 5] {
            assert!((off_px(&path, frame) - 0.3).abs() < 0.05, "frame {frame}: {}", off_px(&path, frame));
        }
        assert!([2, 3, 6, 7].iter().all(|frame| off_px(&path, *frame) <= 0.0));
    }

    #[test]
    fn a_body_that_is_struck_contradicts_nothing() {
        for contact in [[0.0; 0].as_slice(), &[0.3], &[0.9, 0.0, -0.8]] {
            let steps = [[1.4; 6].as_slice(), contact, [-1.2; 6].as_slice()].concat();
            let path: Vec<f64> = (0..=steps.len()).map(|k| steps[..k].iter().sum()).collect();
            assert!((0..steps.len() as u64).all(|frame| off_px(&path, frame) <= 0.0), "{contact:?}");
        }
    }
}
