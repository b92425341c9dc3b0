//! The body's centre: carried by its steps, anchored by its outlines.

use super::Node;
use crate::results::{Circle, Estimate};

/// Share of an outline's variance that is common to all frames of a film and does not average.
const COMMON: f64 = 0.5;
/// Drift of the carried pose per frame, in units of its white sigma.
const DRIFT: f64 = 0.15;
/// An outline further off than this is not believed, sigmas.
const GATE: f64 = 6.0;
/// Disbelieved on end for so many frames and the carried pose is given up instead.
const PATIENCE_FRAMES: f64 = 8.0;

/// Where a centre is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Center {
    /// Centre, px.
    pub x_px: f64,
    /// Centre, px (down).
    pub y_px: f64,
    /// Standard uncertainty of each coordinate, px.
    pub sigma_px: f64,
}

/// Running estimate of the constant between a carried pose and the centre.
///
/// Steps give the centre's motion ten times better than outlines do, outlines
/// its place: one offset, a scalar Kalman filter an axis with a slow drift for
/// what summed steps may gather.
#[derive(Debug, Clone)]
pub struct Anchor {
    offset: Option<[Estimate; 2]>,
    common: f64,
    /// Of the node whose outline was believed last.
    component: u32,
    bridged: [f64; 2],
    time_frames: f64,
    /// Since when outlines are disbelieved.
    disbelieved_frames: Option<f64>,
}

impl Anchor {
    /// Nothing seen yet.
    pub fn new() -> Self {
        let disbelieved_frames = None;
        Self { offset: None, common: 0.0, component: 0, bridged: [0.0; 2], time_frames: 0.0, disbelieved_frames }
    }

    /// Variance of what lies between a node and the one whose outline was believed last, along x and y, px^2.
    fn gap(&self, node: &Node) -> [f64; 2] {
        if node.component == self.component {
            return [0.0; 2];
        }
        std::array::from_fn(|k| {
            let gap = (node.bridged[k] - self.bridged[k]).abs();
            // Behind a gap that cannot be bridged another one tells nothing of its own.
            if gap.is_nan() { f64::INFINITY } else { gap }
        })
    }

    /// Takes the outline found in a node's frame.
    pub fn push(&mut self, node: &Node, circle: &Circle) {
        let seen = [circle.x_px - node.pose[0], circle.y_px - node.pose[1]];
        let variance = circle.sigma_center_px.powi(2).max(1e-12);
        if !(seen.iter().all(|x| x.is_finite()) && variance.is_finite()) {
            return;
        }
        let fresh = seen.map(|value| Estimate { value, sigma: variance.sqrt() });
        let old = self.offset.unwrap_or(fresh);
        let dt = node.time_frames - self.time_frames;
        let gap = self.gap(node);
        let prior: [f64; 2] = std::array::from_fn(|k| {
            let drift = (DRIFT * node.sigma[k]).powi(2) * dt.max(0.0);
            old[k].sigma.powi(2) + drift + gap[k]
        });
        let believed = (0..2).all(|k| (seen[k] - old[k].value).powi(2) <= GATE.powi(2) * (prior[k] + variance));
        let is_given_up = self.disbelieved_frames.is_some_and(|since| node.time_frames - since >= PATIENCE_FRAMES);
        let start = self.offset.is_none() || prior.iter().any(|p| p.is_infinite()) || is_given_up;
        if !believed && !start {
            self.disbelieved_frames.get_or_insert(node.time_frames);
            return;
        }
        self.disbelieved_frames = None;
        self.time_frames = node.time_frames;
        self.component = node.component;
        self.bridged = [node.bridged[0], node.bridged[1]];
        self.common = if start { variance } else { self.common + 0.02 * (variance - self.common) };
        self.offset = Some(if start {
            fresh
        } else {
            std::array::from_fn(|k| {
                let gain = prior[k] / (prior[k] + variance);
                Estimate {
                    value: old[k].value + gain * (seen[k] - old[k].value),
                    sigma: (prior[k] * (1.0 - gain)).sqrt(),
                }
            })
        });
    }

    /// The centre in a node's frame; `None` before the first outline and over a gap that cannot be bridged.
    pub fn center(&self, node: &Node) -> Option<Center> {
        let offset = self.offset?;
        let gap = self.gap(node);
        let variance: f64 = (0..2).map(|k| offset[k].sigma.powi(2) + node.sigma[k].powi(2) + gap[k]).sum::<f64>() / 2.0
            + COMMON * self.common;
        variance.is_finite().then(|| Center {
            x_px: node.pose[0] + offset[0].value,
            y_px: node.pose[1] + offset[1].value,
            sigma_px: variance.sqrt(),
        })
    }
}

impl Default for Anchor {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(time_frames: f64, component: u32, bridged: f64) -> Node {
        Node {
            frame: time_frames as u64,
            time_frames,
            component,
            pose: [0.5 * time_frames, 0.0, 0.0],
            sigma: [1e-3; 3],
            bridged: [bridged; 3],
            walk_share: [0.0; 3],
            kept: None,
        }
    }

    fn circle(x_px: f64) -> Circle {
        let (sigma_center_px, sigma_radius_px) = (0.02, 0.02);
        Circle { x_px, y_px: 80.0, radius_px: 60.0, sigma_center_px, sigma_radius_px, visible_fraction: 1.0 }
    }

    #[test]
    fn behind_each_gap_that_cannot_be_bridged_the_first_outline_is_believed() {
        let mut anchor = Anchor::new();
        let nodes = [node(3.0, 0, 0.0), node(40.0, 1, f64::INFINITY), node(90.0, 2, f64::INFINITY)];
        for (node, x_px) in nodes.iter().zip([50.0, 70.0, 40.0]) {
            anchor.push(node, &circle(x_px));
            assert!((anchor.center(node).unwrap().x_px - x_px).abs() < 1e-9);
        }
        // What lay before is not where this offset leads to.
        assert_eq!(anchor.center(&nodes[1]), None);
    }

    #[test]
    fn a_pose_that_outlines_have_left_for_eight_frames_is_given_up() {
        for every in [1, 4] {
            let mut anchor = Anchor::new();
            anchor.push(&node(0.0, 0, 0.0), &circle(50.0));
            for frame in (4..=11).step_by(every) {
                anchor.push(&node(f64::from(frame), 0, 0.0), &circle(90.0));
            }
            let last = node(12.0, 0, 0.0);
            assert!((anchor.center(&last).unwrap().x_px - 56.0).abs() < 0.1);
            anchor.push(&last, &circle(90.0));
            assert!((anchor.center(&last).unwrap().x_px - 90.0).abs() < 0.1);
        }
    }
}
