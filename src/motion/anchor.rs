//! The body's centre: carried by its steps, anchored by its outlines.

use super::Node;
use crate::results::{Circle, Estimate};

/// Share of an outline's variance that is common to all frames of a film and does not average.
const COMMON: f64 = 0.5;
/// Drift of the carried pose per frame, in units of its white sigma.
const DRIFT: f64 = 0.15;
/// An outline further off than this is not believed, sigmas.
const GATE: f64 = 6.0;
/// So many disbelieved in a row and the carried pose is given up instead.
const PATIENCE: u32 = 8;

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
    bridged: [f64; 2],
    time_frames: f64,
    disbelieved: u32,
}

impl Anchor {
    /// Nothing seen yet.
    pub fn new() -> Self {
        Self { offset: None, common: 0.0, bridged: [0.0; 2], time_frames: 0.0, disbelieved: 0 }
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
        let prior: [f64; 2] = std::array::from_fn(|k| {
            let gap = (node.bridged[k] - self.bridged[k]).max(0.0);
            let drift = (DRIFT * node.sigma[k]).powi(2) * dt.max(0.0);
            old[k].sigma.powi(2) + drift + if gap.is_nan() { 0.0 } else { gap }
        });
        let believed = (0..2).all(|k| (seen[k] - old[k].value).powi(2) <= GATE.powi(2) * (prior[k] + variance));
        let start = self.offset.is_none() || prior.iter().any(|p| p.is_infinite()) || self.disbelieved >= PATIENCE;
        if !believed && !start {
            self.disbelieved += 1;
            return;
        }
        self.disbelieved = 0;
        self.time_frames = node.time_frames;
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
        let variance: f64 = (0..2)
            .map(|k| {
                let gap = node.bridged[k] - self.bridged[k];
                let gap = if gap.is_nan() { 0.0 } else { gap.abs() };
                offset[k].sigma.powi(2) + node.sigma[k].powi(2) + gap
            })
            .sum::<f64>()
            / 2.0
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
