//! The scatter of a path: how much more its poses jump from frame to frame than their uncertainties allow.
//!
//! The uncertainty of a match follows from its residual. An encoder of films moves blocks by whole pixels and removes
//! the residual, and regular paint matches at wrong places as well as at the right one. Neither shows in the residual
//! of a pair of frames, but both show in the path: a body moves smoothly, and the poses jump about it.

use super::velocity_fit::{Regime, fit_window, nodes_between};
use super::{KnownMotion, PixelRates, Pose};
use crate::results::{Estimate, FrameCoding, RigidStep};

/// The number of frames that the size of the scatter is measured over.
const WINDOW_FRAMES: u64 = 17;
/// The number of frames that must show it, and how far they reach ahead. In fewer, noise scatters as much by chance.
const EVIDENCE_FRAMES: u64 = 61;
const EVIDENCE_AHEAD: u64 = 20;
/// The weights of neighbouring poses in a fourth difference, in which a smooth path vanishes, and their length.
const WEIGHTS: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
const LENGTH: f64 = 8.366_600_265_340_756;
/// The minimum number of differences that show it.
const MIN_DIFFERENCES: usize = 15;
/// The minimum ratio of the median difference to that of noise.
///
/// An impact makes a few differences large, but not most of them.
const MIN_RATIO: f32 = 1.9;
/// The median of the absolute value of a standard normal variable.
const NORMAL_MEDIAN: f32 = 0.6745;

/// The standard uncertainty of the step of a body in a film whose frames were predicted from each other, px.
///
/// Encoders move blocks by quarters of a pixel, or leave them where they were. On 65 random films of H.264, crf 16 to 28,
/// steps were off by up to 0.3 px where their path did not show it.
const PREDICTED_STEP_PX: f64 = 0.1;
/// The same of a rotation, as a share of it: encoders move blocks and do not turn them.
///
/// In the same films, rotations of 2 to 6 deg were off by up to a third, with either sign.
const PREDICTED_ROTATION_SHARE: f64 = 0.15;
/// The same of a speed, which is fitted to several frames, px/frame.
const PREDICTED_SPEED_PX: f64 = 0.02;

/// The factors by which the uncertainties of steps near a frame are too small: x, y and the angle, at least 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    factors: [f64; 3],
    coding: FrameCoding,
}

impl Scatter {
    /// Measures the scatter of the path near a frame.
    ///
    /// Within a window, the root mean square of the differences bounds each of them, however they are distributed.
    pub fn near(known: KnownMotion<'_>, frame: u64, regime: Regime, coding: FrameCoding) -> Self {
        let nodes = known.nodes;
        let free = match regime {
            Regime::Unknown => nodes,
            Regime::Flight { from, to } => nodes_between(nodes, from, to),
            // The force bends the path, and the flight before shows the scatter.
            Regime::Contact { from, .. } => nodes_between(nodes, 0, from.saturating_sub(1)),
        };
        let all = fit_window(free, frame, EVIDENCE_FRAMES, EVIDENCE_AHEAD);
        let near = fit_window(free, frame, WINDOW_FRAMES, WINDOW_FRAMES / 2);
        let factor = |axis: usize| if is_scattered(all, axis) { size(near, axis).max(1.0) } else { 1.0 };
        Self { factors: std::array::from_fn(factor), coding }
    }

    /// Widens the uncertainties of a step.
    pub fn apply_to_step(&self, step: RigidStep) -> RigidStep {
        let step = step.with_sigmas(self.factors);
        match self.coding {
            FrameCoding::Independent => step,
            FrameCoding::Predicted => {
                let step = step.with_sigmas(floor_factors([step.sigma_dx_px, step.sigma_dy_px], PREDICTED_STEP_PX));
                let turned_deg = PREDICTED_ROTATION_SHARE * step.dtheta_deg;
                RigidStep { sigma_dtheta_deg: step.sigma_dtheta_deg.hypot(turned_deg), ..step }
            }
        }
    }

    /// Widens the uncertainties of rates at a node: errors that are no noise do not average out over the frames.
    pub fn apply_to_rates(&self, rates: PixelRates, node: &Pose) -> PixelRates {
        let is_scattered = self.factors.iter().any(|factor| *factor > 1.0);
        if !is_scattered && self.coding == FrameCoding::Independent {
            return rates;
        }
        let [x, y, _] = node.sigma;
        let factors = match self.coding {
            FrameCoding::Independent => self.factors,
            FrameCoding::Predicted => {
                let floors = floor_factors([x, y], PREDICTED_SPEED_PX);
                std::array::from_fn(|k| self.factors[k].max(floors[k]))
            }
        };
        let floor = |rate: Estimate, k: usize| Estimate { sigma: rate.sigma.max(factors[k] * node.sigma[k]), ..rate };
        PixelRates { x: floor(rates.x, 0), y: floor(rates.y, 1), theta: floor(rates.theta, 2), ..rates }
    }
}

/// Returns the factors that bring the uncertainties of x and y, px, to at least `floor_px`, in quadrature, and that of the
/// angle by as much.
fn floor_factors(sigmas_px: [f64; 2], floor_px: f64) -> [f64; 3] {
    let factor = |sigma_px: f64| sigma_px.hypot(floor_px) / sigma_px.max(f64::MIN_POSITIVE);
    let [x, y] = sigmas_px;
    [factor(x), factor(y), factor(x.hypot(y) / f64::sqrt(2.0))]
}

/// Whether most of the differences of one coordinate are larger than noise.
fn is_scattered(nodes: &[Pose], axis: usize) -> bool {
    let (mut count, mut larger) = (0, 0);
    for size in differences(nodes, axis) {
        count += 1;
        larger += usize::from(size > MIN_RATIO * NORMAL_MEDIAN);
    }
    // The median is larger.
    count >= MIN_DIFFERENCES && larger >= count - count / 2
}

/// Returns the root mean square of the differences of one coordinate; 0 without any.
fn size(nodes: &[Pose], axis: usize) -> f64 {
    let add = |(sum, count): (f64, f64), size: f32| (sum + f64::from(size).powi(2), count + 1.0);
    let (squares, count) = differences(nodes, axis).fold((0.0, 0.0), add);
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Returns the absolute fourth differences of a coordinate (`axis` 0 is x, 1 is y, 2 the angle) of the nodes.
///
/// They are in standard deviations of their noise. Those across a gap are left out.
fn differences(nodes: &[Pose], axis: usize) -> impl Iterator<Item = f32> {
    nodes.windows(WEIGHTS.len()).filter_map(move |nodes| difference(nodes, axis))
}

/// Returns the absolute fourth difference of poses in successive frames, in standard deviations of its noise; `None`
/// across a gap or if all sigmas are 0.
fn difference(nodes: &[Pose], axis: usize) -> Option<f32> {
    let (first, last) = (nodes.first()?, nodes.last()?);
    let part = |node: &Pose| if axis == 2 { node.turn } else { node.component };
    let is_linked = nodes.iter().all(|node| part(node) == part(first));
    if !is_linked || last.frame - first.frame + 1 != WEIGHTS.len() as u64 {
        return None;
    }
    let sum: f64 = nodes.iter().zip(WEIGHTS).map(|(node, weight)| weight * node.pose[axis]).sum();
    let squares: f64 = nodes.iter().map(|node| node.sigma[axis].powi(2)).sum();
    let noise = LENGTH * (squares / WEIGHTS.len() as f64).sqrt();
    (noise > 0.0).then(|| (sum.abs() / noise) as f32)
}

#[cfg(test)]
mod tests {
    use super::super::velocity_fit::fit_rates;
    use super::*;

    /// The nodes of a body that falls, with an error of x in each frame, px; the sigmas are 0.01.
    fn nodes(error_px: impl Fn(u64) -> f64) -> Vec<Pose> {
        let node = |frame: u64| {
            let t = frame as f64;
            Pose {
                frame,
                time_frames: t,
                component: 0,
                turn: 0,
                pose: [0.3 * t + error_px(frame), 0.2 * t + 0.01 * t * t, 0.5 * t],
                sigma: [0.01; 3],
                bridged: [0.0; 3],
                walk_share: [0.0; 3],
                kept: None,
            }
        };
        (0..40).map(node).collect()
    }

    fn near(nodes: &[Pose]) -> Scatter {
        Scatter::near(KnownMotion { nodes, to_frame: 39, gravity: None }, 20, Regime::Unknown, FrameCoding::Independent)
    }

    #[test]
    fn jumps_by_whole_pixels_widen_steps_and_rates_and_an_impact_does_not() {
        // A path of 0.3 px per frame, rounded to whole pixels.
        let snapped = near(&nodes(|frame| (0.3 * frame as f64).round() - 0.3 * frame as f64));
        let [x, y, rotation] = snapped.factors;
        assert!(x > 15.0 && (y - 1.0).abs() < 1e-12 && (rotation - 1.0).abs() < 1e-12, "{snapped:?}");
        let rates = fit_rates(&nodes(|_| 0.0), 20.0, 1, [0.0; 2]).unwrap();
        let widened = snapped.apply_to_rates(rates, &nodes(|_| 0.0)[20]);
        assert!(widened.x.sigma >= 0.15 && widened.y.sigma >= 0.01);
        let struck = near(&nodes(|frame| if frame < 20 { 0.0 } else { -0.6 * (frame - 20) as f64 }));
        assert_eq!(struck, Scatter { factors: [1.0; 3], coding: FrameCoding::Independent });
    }

    #[test]
    fn steps_of_predicted_frames_are_no_more_certain_than_an_encoder_leaves_them() {
        let nodes = nodes(|_| 0.0);
        let known = KnownMotion { nodes: &nodes, to_frame: 39, gravity: None };
        let scatter = Scatter::near(known, 20, Regime::Unknown, FrameCoding::Predicted);
        let step = RigidStep { sigma_dx_px: 0.002, sigma_dy_px: 0.004, sigma_dtheta_deg: 0.006, ..RigidStep::STILL };
        let widened = scatter.apply_to_step(step);
        assert!((0.1..0.1003).contains(&widened.sigma_dx_px) && (0.1..0.1003).contains(&widened.sigma_dy_px));
        // The arm of the angle is that of the match.
        assert!((0.15..0.25).contains(&widened.sigma_dtheta_deg), "{widened:?}");
        let turned = scatter.apply_to_step(RigidStep { dtheta_deg: -6.0, ..step });
        assert!((0.9..0.95).contains(&turned.sigma_dtheta_deg), "blocks do not turn: {turned:?}");
        let rates = scatter.apply_to_rates(fit_rates(&nodes, 20.0, 1, [0.0; 2]).unwrap(), &nodes[20]);
        assert!((0.02..0.03).contains(&rates.x.sigma), "{}", rates.x.sigma);
    }
}
