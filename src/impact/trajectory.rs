//! A body's positions along the surface's axes.

use crate::motion::{Axes, Pose};
use crate::numeric::Sample;

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
}

/// Index of the normal coordinate.
pub const NORMAL: usize = 0;
/// Index of the tangential coordinate.
pub const TANGENTIAL: usize = 1;
/// Index of the angle.
pub const ANGLE: usize = 2;

impl SurfaceNode {
    /// Rotates a pose into the surface's axes.
    pub fn new(node: &Pose, axes: Axes) -> Self {
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
