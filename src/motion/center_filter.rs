//! The body's centre: a Kalman filter that propagates it by the steps and corrects it by the outlines.

use super::Pose;
use crate::results::{Circle, Estimate};

/// Share of an outline's variance that is common to all frames of a film and does not average out.
const COMMON: f64 = 0.5;
/// The drift of the propagated pose per frame, in units of its white sigma.
const DRIFT: f64 = 0.15;
/// The gate: an outline further off than this is rejected, sigmas.
const GATE: f64 = 6.0;
/// The time of consecutive rejections after which the propagated pose is dropped instead, frames.
const PATIENCE_FRAMES: f64 = 8.0;
/// The number of outlines that the scatter of outlines is averaged over.
const EXCESS_OUTLINES: f64 = 32.0;
/// The number of dropped offsets that are kept, since rows are published some frames later.
const PAST: usize = 8;
/// Uncertainty of the time at which a pose left its outlines, as a share of the distance.
const LEAVE_TIME_SHARE: f64 = 0.3;

/// The position of a centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Center {
    /// Centre x, px.
    pub x_px: f64,
    /// Centre y (down), px.
    pub y_px: f64,
    /// Standard uncertainty of each coordinate, px.
    pub sigma_px: f64,
}

/// A Kalman filter for the constant offset between a propagated pose and the centre.
///
/// Steps give the centre's motion ten times better than outlines do; outlines give its position. The state is one
/// offset per axis, with a slow drift for the accumulated error of the steps. Where the filter restarts, its earlier
/// state holds for the earlier nodes.
#[derive(Debug, Clone, Default)]
pub struct CenterFilter {
    hold: Option<Offset>,
    /// The start of the current rejections, and the offset of the newest rejected outline.
    disbelieved: Option<(f64, Offset)>,
    /// Dropped offsets, oldest first.
    past: Vec<PastOffset>,
}

/// An offset that outlines agree on.
#[derive(Debug, Clone, Copy)]
struct Offset {
    offset: [Estimate; 2],
    common: f64,
    /// The running mean of the squared distances of outlines from their predictions, relative to the variances.
    excess: f64,
    /// The number of outlines, up to [`EXCESS_OUTLINES`].
    outlines: f64,
    /// The component of the node whose outline was accepted last.
    component: u32,
    bridged: [f64; 2],
    time_frames: f64,
}

/// A dropped offset.
#[derive(Debug, Clone, Copy)]
struct PastOffset {
    hold: Offset,
    /// The time at which its successor took over.
    until_frames: f64,
    /// Whether the pose drifted away gradually; otherwise the body was lost.
    is_left: bool,
}

impl Offset {
    fn new(node: &Pose, offset: [Estimate; 2], variance: f64) -> Self {
        let bridged = [node.bridged[0], node.bridged[1]];
        Self {
            offset,
            common: variance,
            excess: 0.0,
            outlines: 1.0,
            component: node.component,
            bridged,
            time_frames: node.time_frames,
        }
    }

    /// Returns the variance between a node and the one whose outline was accepted last, along x and y, px^2.
    fn gap(&self, node: &Pose) -> [f64; 2] {
        if node.component == self.component {
            return [0.0; 2];
        }
        std::array::from_fn(|k| {
            let gap = (node.bridged[k] - self.bridged[k]).abs();
            // After a gap that cannot be bridged, a further outline adds nothing of its own.
            if gap.is_nan() { f64::INFINITY } else { gap }
        })
    }

    /// Returns the variance of the offset at a node.
    fn prior(&self, node: &Pose) -> [f64; 2] {
        let (dt, gap) = ((node.time_frames - self.time_frames).max(0.0), self.gap(node));
        std::array::from_fn(|k| self.offset[k].sigma.powi(2) + (DRIFT * node.sigma[k]).powi(2) * dt + gap[k])
    }

    /// Returns the state updated by an accepted outline.
    fn with(&self, node: &Pose, seen: [f64; 2], variance: f64) -> Self {
        let prior = self.prior(node);
        let offset = std::array::from_fn(|k| {
            let (gain, old) = (prior[k] / (prior[k] + variance), self.offset[k].value);
            Estimate { value: old + gain * (seen[k] - old), sigma: (prior[k] * (1.0 - gain)).sqrt() }
        });
        let apart = |k: usize| 0.5 * (seen[k] - self.offset[k].value).powi(2) / (prior[k] + variance);
        let excess = self.excess + (apart(0) + apart(1) - self.excess) / self.outlines;
        Self {
            common: self.common + 0.02 * (variance - self.common),
            excess,
            outlines: (self.outlines + 1.0).min(EXCESS_OUTLINES),
            ..Self::new(node, offset, variance)
        }
    }

    fn center(&self, node: &Pose) -> Option<Center> {
        let gap = self.gap(node);
        let own = |k: usize| self.offset[k].sigma.powi(2) + node.sigma[k].powi(2) + gap[k];
        let variance = (0..2).map(own).sum::<f64>() / 2.0 + COMMON * self.common;
        // Outlines that scatter more than they should are less certain than they say.
        let variance = variance * self.excess.max(1.0);
        variance.is_finite().then(|| Center {
            x_px: node.pose[0] + self.offset[0].value,
            y_px: node.pose[1] + self.offset[1].value,
            sigma_px: variance.sqrt(),
        })
    }
}

impl CenterFilter {
    /// Creates a filter without any outline.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the outline detected in a node's frame.
    pub fn push(&mut self, node: &Pose, circle: &Circle) {
        let seen = [circle.x_px - node.pose[0], circle.y_px - node.pose[1]];
        let variance = circle.sigma_center_px.powi(2).max(1e-12);
        if !(seen.iter().all(|x| x.is_finite()) && variance.is_finite()) {
            return;
        }
        let fresh = Offset::new(node, seen.map(|value| Estimate { value, sigma: variance.sqrt() }), variance);
        let Some(hold) = self.hold else {
            self.hold = Some(fresh);
            return;
        };
        let prior = hold.prior(node);
        let is_lost = prior.iter().any(|prior| prior.is_infinite());
        let believed = (0..2).all(|k| (seen[k] - hold.offset[k].value).powi(2) <= GATE.powi(2) * (prior[k] + variance));
        let is_left = self.disbelieved.is_some_and(|(since, _)| node.time_frames - since >= PATIENCE_FRAMES);
        if is_lost || (!believed && is_left) {
            if self.past.len() == PAST {
                self.past.remove(0);
            }
            self.past.push(PastOffset { hold, until_frames: node.time_frames, is_left: !is_lost });
            self.hold = Some(fresh);
        } else if believed {
            self.hold = Some(hold.with(node, seen, variance));
        } else {
            let since = self.disbelieved.map_or(node.time_frames, |(since, _)| since);
            self.disbelieved = Some((since, fresh));
            return;
        }
        self.disbelieved = None;
    }

    /// Returns the centre in a node's frame; `None` before the first outline and across a gap that cannot be bridged.
    pub fn center(&self, node: &Pose) -> Option<Center> {
        let leads_to = |past: &PastOffset| past.hold.gap(node).iter().all(|gap| gap.is_finite());
        let now = self.past.iter().position(|past| node.time_frames < past.until_frames && leads_to(past));
        let Some(index) = now else { return self.newest(node) };
        let past = &self.past[index];
        let center = past.hold.center(node)?;
        let began_frames = past.hold.time_frames;
        if !past.is_left || node.time_frames <= began_frames {
            return Some(center);
        }
        // Between one offset and the next.
        let next = self.past.get(index + 1).map_or(self.hold, |next| Some(next.hold))?.center(node)?;
        let share = (node.time_frames - began_frames) / (past.until_frames - began_frames);
        let way = [next.x_px - center.x_px, next.y_px - center.y_px];
        Some(Center {
            x_px: center.x_px + share * way[0],
            y_px: center.y_px + share * way[1],
            sigma_px: center.sigma_px.max(next.sigma_px).hypot(LEAVE_TIME_SHARE * way[0].hypot(way[1])),
        })
    }

    /// Returns the centre by the newest offset. Its uncertainty includes the outlines that are rejected so far.
    fn newest(&self, node: &Pose) -> Option<Center> {
        let hold = self.hold?;
        let center = hold.center(node)?;
        let Some((_, doubt)) = self.disbelieved.filter(|_| node.time_frames > hold.time_frames) else {
            return Some(center);
        };
        let way = [0, 1].map(|k| doubt.offset[k].value - hold.offset[k].value);
        let share = (node.time_frames - hold.time_frames) / (doubt.time_frames - hold.time_frames);
        Some(Center { sigma_px: center.sigma_px.hypot(share.min(2.0) * way[0].hypot(way[1])), ..center })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(time_frames: f64, component: u32, bridged: f64) -> Pose {
        Pose {
            frame: time_frames as u64,
            time_frames,
            component,
            turn: 0,
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
        let mut anchor = CenterFilter::new();
        let nodes = [node(3.0, 0, 0.0), node(40.0, 1, f64::INFINITY), node(90.0, 2, f64::INFINITY)];
        for (node, x_px) in nodes.iter().zip([50.0, 70.0, 40.0]) {
            anchor.push(node, &circle(x_px));
            assert!((anchor.center(node).unwrap().x_px - x_px).abs() < 1e-9);
        }
        // Earlier nodes follow their own offset, not this one.
        assert!((anchor.center(&nodes[0]).unwrap().x_px - 50.0).abs() < 1e-9);
        assert!((anchor.center(&node(50.0, 1, f64::INFINITY)).unwrap().x_px - 75.0).abs() < 1e-9);
        assert!((anchor.center(&node(85.0, 2, f64::INFINITY)).unwrap().x_px - 37.5).abs() < 1e-9);
    }

    #[test]
    fn a_pose_that_outlines_have_left_for_eight_frames_is_given_up() {
        for every in [1, 4] {
            let mut anchor = CenterFilter::new();
            anchor.push(&node(0.0, 0, 0.0), &circle(50.0));
            for frame in (4..=11).step_by(every) {
                anchor.push(&node(f64::from(frame), 0, 0.0), &circle(90.0));
            }
            let last = node(12.0, 0, 0.0);
            assert!(anchor.center(&last).unwrap().sigma_px > 30.0, "the outlines place it elsewhere");
            assert!((anchor.center(&last).unwrap().x_px - 56.0).abs() < 0.1);
            anchor.push(&last, &circle(90.0));
            assert!((anchor.center(&last).unwrap().x_px - 90.0).abs() < 0.1);
            // The offset holds from there on; earlier nodes keep the old one, and in between it is uncertain.
            assert!((anchor.center(&node(0.0, 0, 0.0)).unwrap().x_px - 50.0).abs() < 0.1);
            let between = anchor.center(&node(6.0, 0, 0.0)).unwrap();
            assert!(between.x_px > 53.0 && between.x_px < 87.0 && between.sigma_px > 8.0, "{between:?}");
        }
    }
}
