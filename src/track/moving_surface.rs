//! The motion of a surface that is a body itself, such as a racket.

use crate::impact::{ANGLE, SurfaceNode, nodes_between};

/// The rotation of a surface up to which each point of it has the velocity of its centre, rad, and that which noise explains,
/// sigmas. Over the flights around a contact, 0.2 deg change the velocity of a point 50 px away by 0.002 px per frame.
const MAX_TURN_RAD: f64 = 0.0035;
const NOISE_SIGMAS: f64 = 5.0;

/// The positions of the body that other bodies strike.
#[derive(Debug, Clone, Default)]
pub(super) struct MovingSurface {
    /// In the order of their frames.
    nodes: Vec<SurfaceNode>,
}

impl MovingSurface {
    /// Adds a position and discards those before the frame `kept_from`.
    pub(super) fn push(&mut self, node: SurfaceNode, kept_from: u64) {
        let old = self.nodes.partition_point(|node| node.frame < kept_from);
        // In large steps, since each moves all the others.
        if 2 * old > self.nodes.len() {
            self.nodes.drain(..old);
        }
        self.nodes.push(node);
    }

    /// Whether the surface rotates from one time to another, frames, so that the point of contact and its centre may have
    /// different velocities.
    pub(super) fn has_turned(&self, from_frames: f64, to_frames: f64) -> bool {
        let nodes = nodes_between(&self.nodes, from_frames, to_frames);
        let (Some(first), Some(last)) = (nodes.first(), nodes.last()) else { return false };
        let sigma = first.sigma[ANGLE].hypot(last.sigma[ANGLE]);
        (last.value[ANGLE] - first.value[ANGLE]).abs() > MAX_TURN_RAD.max(NOISE_SIGMAS * sigma)
    }

    /// Returns the positions of a body relative to the surface, in the frames in which both were measured. Angles remain
    /// those of the body.
    pub(super) fn relative(&self, nodes: &[SurfaceNode]) -> Vec<SurfaceNode> {
        let mut relative: Vec<SurfaceNode> = Vec::with_capacity(nodes.len());
        let (mut component, mut linked) = (0, None);
        for node in nodes {
            let Ok(at) = self.nodes.binary_search_by_key(&node.frame, |surface| surface.frame) else { continue };
            let surface = &self.nodes[at];
            // A link between two frames needs both bodies.
            let both = Some((node.component, surface.component));
            component += u32::from(both != linked && linked.is_some());
            linked = both;
            let mut moved = SurfaceNode { component, ..*node };
            for axis in 0..2 {
                moved.value[axis] -= surface.value[axis];
                moved.sigma[axis] = node.sigma[axis].hypot(surface.sigma[axis]);
                moved.walk_share[axis] *= node.sigma[axis] / moved.sigma[axis].max(f64::MIN_POSITIVE);
            }
            relative.push(moved);
        }
        relative
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(frame: u64, component: u32, normal: f64) -> SurfaceNode {
        SurfaceNode {
            frame,
            time_frames: frame as f64,
            component,
            turn: 0,
            value: [normal, 1.0, 0.5],
            sigma: [0.03, 0.03, 0.001],
            walk_share: [1.0, 1.0, 0.0],
            turning_sigma: 0.0,
        }
    }

    #[test]
    fn positions_are_relative_where_both_were_measured() {
        let mut surface = MovingSurface::default();
        for frame in [2, 3, 5] {
            surface.push(SurfaceNode { sigma: [0.04, 0.04, 0.0], ..node(frame, u32::from(frame > 3), 10.0) }, 2);
        }
        let body: Vec<SurfaceNode> = (1..6).map(|frame| node(frame, 0, 12.0 + frame as f64)).collect();
        let relative = surface.relative(&body);
        let frames: Vec<(u64, u32)> = relative.iter().map(|node| (node.frame, node.component)).collect();
        assert_eq!(frames, [(2, 0), (3, 0), (5, 1)]);
        let apart = relative[0].value.iter().zip([4.0, 0.0, 0.5]).map(|(value, truth)| (value - truth).abs());
        assert!(apart.sum::<f64>() < 1e-12, "{:?}", relative[0].value);
        assert!((relative[0].sigma[0] - 0.05).abs() < 1e-12 && (relative[0].walk_share[0] - 0.6).abs() < 1e-12);
    }

    #[test]
    fn a_rotation_beyond_noise_is_detected() {
        let turning = |rad_per_frame: f64| {
            let mut surface = MovingSurface::default();
            (0..100).for_each(|frame| {
                let value = [0.0, 0.0, rad_per_frame * frame as f64];
                surface.push(SurfaceNode { value, sigma: [0.01, 0.01, 0.0005], ..node(frame, 0, 0.0) }, 0);
            });
            surface
        };
        assert!(!turning(1e-5).has_turned(0.0, 99.0));
        assert!(turning(1e-4).has_turned(0.0, 99.0) && !turning(1e-4).has_turned(10.0, 30.0));
    }

    #[test]
    fn only_what_a_body_may_need_is_kept() {
        let mut surface = MovingSurface::default();
        (0..1000).for_each(|frame| surface.push(node(frame, 0, 0.0), frame.saturating_sub(10)));
        assert!(surface.nodes.len() < 40, "{}", surface.nodes.len());
        assert_eq!(surface.relative(&[node(995, 0, 1.0)]).len(), 1);
    }
}
