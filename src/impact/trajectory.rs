//! A body's positions along the surface's axes.

use crate::motion::{Axes, Pose};
use crate::numeric::Sample;
use crate::results::{BodyStep, RigidStep};

/// One pose along the surface's normal and tangent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceNode {
    /// Sequence number of the frame.
    pub frame: u64,
    /// Time since the stream's first frame, nominal frame periods.
    pub time_frames: f64,
    /// The component; nodes of one component are linked by steps.
    pub component: u32,
    /// The component of the angle; nodes of one are linked by measured rotations.
    pub turn: u32,
    /// Along the outward normal px, along the tangent px, angle rad (counter-clockwise).
    pub value: [f64; 3],
    /// White standard uncertainty of each.
    pub sigma: [f64; 3],
    /// The random-walk part of the step to this node, as a share of `sigma`.
    pub walk_share: [f64; 3],
    /// The standard uncertainty that an error of the centre adds to the velocity while the body turns, px/frame. It is
    /// about the same in neighbouring frames, and may change from one block to the next.
    pub turning_sigma: f64,
}

/// Index of the normal coordinate.
pub const NORMAL: usize = 0;
/// Index of the tangential coordinate.
pub const TANGENTIAL: usize = 1;
/// Index of the angle.
pub const ANGLE: usize = 2;

impl SurfaceNode {
    /// Rotates a pose into the surface's axes. `step` is that of its frame.
    pub fn new(node: &Pose, axes: Axes, step: &BodyStep) -> Self {
        let position = axes.surface(node.pose[0], node.pose[1]);
        let sigma = axes.surface_sigma(node.sigma[0], node.sigma[1]);
        Self {
            frame: node.frame,
            time_frames: node.time_frames,
            component: node.component,
            turn: node.turn,
            value: [position.normal, position.tangential, node.pose[2].to_radians()],
            sigma: [sigma.normal, sigma.tangential, node.sigma[2].to_radians()],
            walk_share: node.walk_share,
            turning_sigma: turning_sigma_of(step),
        }
    }

    /// Returns the node with time in units of `periods` frames, for a series that skips all frames between.
    pub(super) fn with_period(&self, periods: f64) -> Self {
        Self {
            time_frames: self.time_frames / periods,
            walk_share: self.walk_share.map(|share| share * periods.sqrt()),
            turning_sigma: self.turning_sigma * periods,
            ..*self
        }
    }

    /// Returns one coordinate (`NORMAL`, `TANGENTIAL` or `ANGLE`), px or rad.
    pub fn sample(&self, coordinate: usize) -> Sample {
        Sample {
            time_frames: self.time_frames,
            component: if coordinate == ANGLE { self.turn } else { self.component },
            value: self.value[coordinate],
            sigma: self.sigma[coordinate],
            walk: self.walk_share[coordinate] * self.sigma[coordinate],
        }
    }
}

/// Returns the uncertainty that an error of the centre of a ball adds to the velocity of a step, px/frame.
///
/// 0 for a patch, whose centre is a point of its pattern, and for a rod.
fn turning_sigma_of(step: &BodyStep) -> f64 {
    let turn_deg = step.motion.filter(RigidStep::has_rotation).map_or(0.0, |motion| motion.dtheta_deg);
    let center = step.circle().filter(|_| step.angle_deg.is_none());
    center.map_or(0.0, |center| center.sigma_center_px * turn_deg.to_radians().abs())
}

/// Returns the largest uncertainty of a velocity from the centre, px/frame; 0 without nodes.
pub fn turning_sigma(nodes: &[SurfaceNode]) -> f64 {
    nodes.iter().map(|node| node.turning_sigma).fold(0.0, f64::max)
}

/// Whether measured rotations link some of the nodes. Steps over n frames make n interleaved components.
pub fn has_measured_rotation(nodes: &[SurfaceNode]) -> bool {
    let mut turns: Vec<u32> = nodes.iter().map(|node| node.turn).collect();
    turns.sort_unstable();
    turns.windows(2).any(|pair| pair[0] == pair[1])
}

/// Returns one coordinate of every node, px or rad.
pub fn samples(nodes: &[SurfaceNode], coordinate: usize) -> Vec<Sample> {
    nodes.iter().map(|n| n.sample(coordinate)).collect()
}

/// Returns the nodes from one time to another, both included.
pub fn nodes_between(nodes: &[SurfaceNode], from_frames: f64, to_frames: f64) -> &[SurfaceNode] {
    let first = nodes.partition_point(|n| n.time_frames < from_frames);
    let end = nodes.partition_point(|n| n.time_frames <= to_frames);
    &nodes[first..end.max(first)]
}
