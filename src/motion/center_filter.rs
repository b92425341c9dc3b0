//! The body's centre: a Kalman filter that propagates it by the steps and corrects it by the outlines.

use super::Pose;
use crate::results::{Circle, Estimate};

/// The share of an outline's variance that is common to all frames of a film and does not average out.
const COMMON_VARIANCE_SHARE: f64 = 0.5;
/// The drift of the propagated pose per frame, in units of its white sigma.
const DRIFT_SIGMAS: f64 = 0.15;
/// The same where the reference is renewed at every step, since the body turns fast: the whole error of a step stays.
const RENEWED_DRIFT_SIGMAS: f64 = std::f64::consts::SQRT_2;
/// The validation gate: an outline further off than this is rejected, sigmas.
const GATE_SIGMAS: f64 = 6.0;
/// The time of consecutive rejections after which the propagated pose is dropped instead, frames.
const PATIENCE_FRAMES: f64 = 8.0;
/// The number of outlines that the scatter of outlines is averaged over.
const EXCESS_OUTLINES: f64 = 32.0;
/// The number of dropped offsets that are kept, since rows are published some frames later.
const MAX_PAST_OFFSETS: usize = 8;
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
    state: Option<OffsetState>,
    rejection: Option<Rejection>,
    /// Dropped offsets, oldest first.
    past: Vec<PastOffset>,
}

/// Consecutive outlines outside the gate.
#[derive(Debug, Clone, Copy)]
struct Rejection {
    since_frames: f64,
    /// The offset of the newest of them.
    newest: OffsetState,
}

/// An offset that outlines agree on.
#[derive(Debug, Clone, Copy)]
struct OffsetState {
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
    /// Whether the step to that node renewed the reference.
    is_renewed: bool,
}

/// A dropped offset.
#[derive(Debug, Clone, Copy)]
struct PastOffset {
    state: OffsetState,
    /// The time at which its successor took over.
    until_frames: f64,
    /// Whether the pose drifted away gradually; otherwise the body was lost.
    has_drifted_away: bool,
}

impl OffsetState {
    /// Starts with the offset of one outline of this variance, px^2.
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
            is_renewed: is_renewed(node),
        }
    }

    /// Returns the variance by gaps in the steps between a node and the one whose outline was accepted last, along x
    /// and y, px^2. Infinite for a gap that cannot be bridged.
    fn gap_variance(&self, node: &Pose) -> [f64; 2] {
        if node.component == self.component {
            return [0.0; 2];
        }
        std::array::from_fn(|k| {
            let gap = (node.bridged[k] - self.bridged[k]).abs();
            // After a gap that cannot be bridged, a further outline adds nothing of its own.
            if gap.is_nan() { f64::INFINITY } else { gap }
        })
    }

    /// Returns the predicted variance of the offset at a node, along x and y, px^2.
    fn predicted_variance(&self, node: &Pose) -> [f64; 2] {
        let (dt, gap) = ((node.time_frames - self.time_frames).max(0.0), self.gap_variance(node));
        let drift = if self.is_renewed && is_renewed(node) { RENEWED_DRIFT_SIGMAS } else { DRIFT_SIGMAS };
        std::array::from_fn(|k| self.offset[k].sigma.powi(2) + (drift * node.sigma[k]).powi(2) * dt + gap[k])
    }

    /// Returns the state after the Kalman update by an accepted outline at the offset `measured`, px, of this variance.
    fn updated(&self, node: &Pose, measured: [f64; 2], variance: f64) -> Self {
        let prior = self.predicted_variance(node);
        let offset = std::array::from_fn(|k| {
            let (gain, old) = (prior[k] / (prior[k] + variance), self.offset[k].value);
            Estimate { value: old + gain * (measured[k] - old), sigma: (prior[k] * (1.0 - gain)).sqrt() }
        });
        let apart = |k: usize| 0.5 * (measured[k] - self.offset[k].value).powi(2) / (prior[k] + variance);
        let excess = self.excess + (apart(0) + apart(1) - self.excess) / self.outlines;
        Self {
            common: self.common + 0.02 * (variance - self.common),
            excess,
            outlines: (self.outlines + 1.0).min(EXCESS_OUTLINES),
            ..Self::new(node, offset, variance)
        }
    }

    /// Returns the centre at a node by this offset; `None` across a gap that cannot be bridged.
    fn center(&self, node: &Pose) -> Option<Center> {
        let gap = self.gap_variance(node);
        // A turning body is not where its last outline was, by the errors of all steps since then.
        let frames =
            if self.is_renewed && is_renewed(node) { (node.time_frames - self.time_frames).abs() } else { 0.0 };
        let drift = |k: usize| (RENEWED_DRIFT_SIGMAS * node.sigma[k]).powi(2) * frames;
        let own = |k: usize| self.offset[k].sigma.powi(2) + node.sigma[k].powi(2) + gap[k] + drift(k);
        let variance = (0..2).map(own).sum::<f64>() / 2.0 + COMMON_VARIANCE_SHARE * self.common;
        // Outlines that scatter more than they should are less certain than they say.
        let variance = variance * self.excess.max(1.0);
        variance.is_finite().then(|| Center {
            x_px: node.pose[0] + self.offset[0].value,
            y_px: node.pose[1] + self.offset[1].value,
            sigma_px: variance.sqrt(),
        })
    }
}

/// Whether the step to a node renewed the reference of the whole body.
fn is_renewed(node: &Pose) -> bool {
    node.kept.is_some() && node.walk_share[0] > 0.0
}

impl CenterFilter {
    /// Creates a filter without any outline.
    pub fn new() -> Self {
        Self::default()
    }

    /// Updates the offset by the outline detected in the frame of a pose. Outlines must come in frame order.
    ///
    /// An outline outside the gate is rejected. The filter restarts from it after 8 frames of rejections, or after a gap
    /// that cannot be bridged. The old offset stays valid for earlier poses. An outline that is not finite
    /// is ignored.
    pub fn update(&mut self, pose: &Pose, circle: &Circle) {
        let measured = [circle.x_px - pose.pose[0], circle.y_px - pose.pose[1]];
        let variance = circle.sigma_center_px.powi(2).max(1e-12);
        if !(measured.iter().all(|x| x.is_finite()) && variance.is_finite()) {
            return;
        }
        let offset = measured.map(|value| Estimate { value, sigma: variance.sqrt() });
        let restarted = OffsetState::new(pose, offset, variance);
        let Some(state) = self.state else {
            self.state = Some(restarted);
            return;
        };
        let prior = state.predicted_variance(pose);
        let is_lost = prior.iter().any(|prior| prior.is_infinite());
        let is_within_gate = (0..2)
            .all(|k| (measured[k] - state.offset[k].value).powi(2) <= GATE_SIGMAS.powi(2) * (prior[k] + variance));
        let since_frames = self.rejection.map_or(pose.time_frames, |rejection| rejection.since_frames);
        let has_drifted_away = pose.time_frames - since_frames >= PATIENCE_FRAMES;
        if is_lost || (!is_within_gate && has_drifted_away) {
            if self.past.len() == MAX_PAST_OFFSETS {
                self.past.remove(0);
            }
            self.past.push(PastOffset { state, until_frames: pose.time_frames, has_drifted_away: !is_lost });
            self.state = Some(restarted);
        } else if is_within_gate {
            self.state = Some(state.updated(pose, measured, variance));
        } else {
            self.rejection = Some(Rejection { since_frames, newest: restarted });
            return;
        }
        self.rejection = None;
    }

    /// Returns the centre in a node's frame; `None` before the first outline and across a gap that cannot be bridged.
    pub fn center(&self, node: &Pose) -> Option<Center> {
        let leads_to = |past: &PastOffset| past.state.gap_variance(node).iter().all(|gap| gap.is_finite());
        let now = self.past.iter().position(|past| node.time_frames < past.until_frames && leads_to(past));
        let Some(index) = now else { return self.newest_center(node) };
        let past = &self.past[index];
        let center = past.state.center(node)?;
        let began_frames = past.state.time_frames;
        if !past.has_drifted_away || node.time_frames <= began_frames {
            return Some(center);
        }
        // Between one offset and the next.
        let next = self.past.get(index + 1).map_or(self.state, |next| Some(next.state))?.center(node)?;
        let share = (node.time_frames - began_frames) / (past.until_frames - began_frames);
        let shift_px = [next.x_px - center.x_px, next.y_px - center.y_px];
        Some(Center {
            x_px: center.x_px + share * shift_px[0],
            y_px: center.y_px + share * shift_px[1],
            sigma_px: center.sigma_px.max(next.sigma_px).hypot(LEAVE_TIME_SHARE * shift_px[0].hypot(shift_px[1])),
        })
    }

    /// Returns the centre by the newest offset. Its uncertainty includes the outlines that are rejected so far.
    fn newest_center(&self, node: &Pose) -> Option<Center> {
        let state = self.state?;
        let center = state.center(node)?;
        let Some(rejection) = self.rejection.filter(|_| node.time_frames > state.time_frames) else {
            return Some(center);
        };
        let shift_px = [0, 1].map(|k| rejection.newest.offset[k].value - state.offset[k].value);
        let share = (node.time_frames - state.time_frames) / (rejection.newest.time_frames - state.time_frames);
        Some(Center { sigma_px: center.sigma_px.hypot(share.min(2.0) * shift_px[0].hypot(shift_px[1])), ..center })
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
        let mut filter = CenterFilter::new();
        let nodes = [node(3.0, 0, 0.0), node(40.0, 1, f64::INFINITY), node(90.0, 2, f64::INFINITY)];
        for (node, x_px) in nodes.iter().zip([50.0, 70.0, 40.0]) {
            filter.update(node, &circle(x_px));
            assert!((filter.center(node).unwrap().x_px - x_px).abs() < 1e-9);
        }
        // Earlier nodes follow their own offset, not this one.
        assert!((filter.center(&nodes[0]).unwrap().x_px - 50.0).abs() < 1e-9);
        assert!((filter.center(&node(50.0, 1, f64::INFINITY)).unwrap().x_px - 75.0).abs() < 1e-9);
        assert!((filter.center(&node(85.0, 2, f64::INFINITY)).unwrap().x_px - 37.5).abs() < 1e-9);
    }

    #[test]
    fn a_pose_that_outlines_have_left_for_eight_frames_is_given_up() {
        for every in [1, 4] {
            let mut filter = CenterFilter::new();
            filter.update(&node(0.0, 0, 0.0), &circle(50.0));
            for frame in (4..=11).step_by(every) {
                filter.update(&node(f64::from(frame), 0, 0.0), &circle(90.0));
            }
            let last = node(12.0, 0, 0.0);
            assert!(filter.center(&last).unwrap().sigma_px > 30.0, "the outlines place it elsewhere");
            assert!((filter.center(&last).unwrap().x_px - 56.0).abs() < 0.1);
            filter.update(&last, &circle(90.0));
            assert!((filter.center(&last).unwrap().x_px - 90.0).abs() < 0.1);
            // The offset holds from there on; earlier nodes keep the old one, and in between it is uncertain.
            assert!((filter.center(&node(0.0, 0, 0.0)).unwrap().x_px - 50.0).abs() < 0.1);
            let between = filter.center(&node(6.0, 0, 0.0)).unwrap();
            assert!(between.x_px > 53.0 && between.x_px < 87.0 && between.sigma_px > 8.0, "{between:?}");
        }
    }
}
