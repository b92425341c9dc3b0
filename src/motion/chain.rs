//! From steps to positions.

use std::collections::VecDeque;

use crate::results::{BodyStep, RigidStep};

/// Longest gap the carried pose is extrapolated over, frames.
const BRIDGE_FRAMES: f64 = 8.0;
/// A step's sigma is not taken for smaller than this, px or deg.
const SIGMA_FLOOR: f64 = 1e-7;

/// A body's pose in one frame, carried there by its steps.
///
/// Poses of one component differ exactly by the measured steps between them.
/// The noise of successive steps is that of the frames they share, with
/// opposite signs, so a pose scatters like the steps' sigma / sqrt(2), whatever
/// the number of steps summed. A missing step starts a new component, and steps
/// over n frames make n interleaved ones: between components the pose is only
/// extrapolated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Sequence number of the frame.
    pub frame: u64,
    /// Time since the stream's first frame, nominal frame periods.
    pub time_frames: f64,
    /// Nodes of one component are linked by steps.
    pub component: u32,
    /// x px, y px (down), angle deg (counter-clockwise) since the body's first node.
    pub pose: [f64; 3],
    /// White standard uncertainty of each.
    pub sigma: [f64; 3],
    /// Variance that extrapolation over gaps has added to each since the first node; infinite where a gap was too long.
    pub bridged: [f64; 3],
    /// What a step adds to it and all later ones for good, as a share of `sigma`.
    pub walk_share: f64,
}

#[derive(Debug, Clone, Copy)]
struct Arrival {
    frame: u64,
    node: Node,
}

/// Adds up the steps of one body.
#[derive(Debug, Clone)]
pub struct Chain {
    walk_share: f64,
    components: u32,
    arrivals: VecDeque<Arrival>,
    /// The newest node with a step from it, its rates per nominal frame, and the rates before.
    last: Option<(Node, [f64; 3], [f64; 3])>,
}

fn sound(step: &RigidStep) -> bool {
    let numbers = [step.dx_px, step.dy_px, step.dtheta_deg, step.sigma_dx_px, step.sigma_dy_px, step.sigma_dtheta_deg];
    numbers.iter().all(|x| x.is_finite())
}

impl Chain {
    /// An empty chain of steps of which `walk_share` of a pose's sigma is not taken back by the next.
    pub fn new(walk_share: f64) -> Self {
        Self { walk_share, components: 0, arrivals: VecDeque::new(), last: None }
    }

    /// Takes the next step in frame order; gives the frame's node unless no step leads to or from it.
    pub fn push(&mut self, step: &BodyStep, time_frames: f64) -> Option<Node> {
        while self.arrivals.front().is_some_and(|a| a.frame < step.frame) {
            self.arrivals.pop_front();
        }
        let arrived = match self.arrivals.front() {
            Some(a) if a.frame == step.frame => self.arrivals.pop_front().map(|a| a.node),
            _ => None,
        };
        let outgoing = step.step.filter(sound);
        let n = f64::from(step.interval_frames.max(1));
        let sigma_out = outgoing.map(|s| {
            [s.sigma_dx_px, s.sigma_dy_px, s.sigma_dtheta_deg]
                .map(|sigma| (sigma.abs() * n * std::f64::consts::FRAC_1_SQRT_2).max(SIGMA_FLOOR))
        });
        let mut node = match (arrived, sigma_out) {
            (None, None) => return None,
            (Some(node), None) => node,
            (Some(node), Some(out)) => {
                let sigma = std::array::from_fn(|k| ((node.sigma[k].powi(2) + out[k].powi(2)) / 2.0).sqrt());
                Node { sigma, ..node }
            }
            (None, Some(sigma)) => self.begin(time_frames, sigma),
        };
        node.frame = step.frame;
        node.time_frames = time_frames;
        if let (Some(out), Some(sigma)) = (outgoing, sigma_out) {
            let rates = [out.dx_px, out.dy_px, out.dtheta_deg];
            let pose = std::array::from_fn(|k| node.pose[k] + n * rates[k]);
            let target = step.frame + u64::from(step.interval_frames.max(1));
            self.arrivals.push_back(Arrival { frame: target, node: Node { pose, sigma, ..node } });
            let before = self.last.map_or(rates, |(_, rates, _)| rates);
            self.last = Some((node, rates, before));
        }
        Some(node)
    }

    /// A node of a new component, extrapolated from the newest node there is.
    fn begin(&mut self, time_frames: f64, sigma: [f64; 3]) -> Node {
        let component = self.components;
        self.components += 1;
        let Some((last, rates, before)) = self.last else {
            return Node {
                frame: 0,
                time_frames,
                component,
                pose: [0.0; 3],
                sigma,
                bridged: [0.0; 3],
                walk_share: self.walk_share,
            };
        };
        let dt = time_frames - last.time_frames;
        let pose = std::array::from_fn(|k| last.pose[k] + dt * rates[k]);
        let bridged = std::array::from_fn(|k| {
            if dt.abs() > BRIDGE_FRAMES {
                return f64::INFINITY;
            }
            // The rate's own noise, and as much change again as it showed over the last frame.
            let rate = 2.0 * last.sigma[k].powi(2) + (0.5 * dt * (rates[k] - before[k])).powi(2);
            last.bridged[k] + dt * dt * rate
        });
        Node { frame: 0, time_frames, component, pose, sigma, bridged, walk_share: self.walk_share }
    }
}
