//! How the outline of a body leaves the pose that its pattern leads to.

use super::{Center, Node, PixelRates, Polynomial, Regime, Sample};
use crate::results::{BodyStep, Circle, Estimate, RigidStep};

/// Fewest outlines whose word is taken.
const LEAST_SEEN: usize = 3;
/// Drift of fewer sigmas may be chance: outlines see light and ground, which a pattern does not.
const CHANCE_SIGMAS: f64 = 3.5;
/// How far off the drift of steps may be: a share of it, and of the speed, which a lens bends.
const UNEVEN: f64 = 0.01;
const BENT: f64 = 0.001;
/// From such a share on the outlines tell the centre, not the poses.
const SURE_SHARE: f64 = 0.5;
/// So many frames before and after a moment tell the drift there, in flight.
const BACK: u64 = 128;
const AHEAD: u64 = 14;
/// Outlines kept: the longest contact that is followed, and the flights beside it.
const KEPT: usize = 4608;
/// Outlines may be alike in their errors from frame to frame up to here.
const MOST_ALIKE: f64 = 0.9;

/// Centres of outlines beside carried poses.
///
/// The pattern of a ball that turns about an axis in the picture's plane moves with its front, faster than its centre or
/// slower; its outline does not.
#[derive(Debug, Clone, Default)]
pub struct Drift {
    seen: Vec<[Sample; 2]>,
    steps: Vec<Moved>,
}

/// By how much a frame a centre moves beside its step.
#[derive(Debug, Clone, Copy)]
struct Moved {
    time_frames: f64,
    drift_px: [Estimate; 2],
    speed_px: f64,
}

impl Drift {
    /// Takes the outline found in a node's frame.
    pub fn push(&mut self, node: &Node, circle: &Circle) {
        let sigma = circle.sigma_center_px;
        let apart = [circle.x_px - node.pose[0], circle.y_px - node.pose[1]];
        if !(sigma > 0.0 && sigma.is_finite() && apart.iter().all(|apart| apart.is_finite())) {
            return;
        }
        let (time_frames, component) = (node.time_frames, node.component);
        keep(&mut self.seen, apart.map(|value| Sample { time_frames, component, value, sigma, walk: 0.0 }));
    }

    /// Takes what the step from a frame on shows of it.
    pub fn push_step(&mut self, time_frames: f64, step: &BodyStep) {
        let Some((drift_px, step)) = step.drift_px.zip(step.step) else { return };
        if drift_px.iter().all(|drift| drift.value.is_finite() && drift.sigma > 0.0 && drift.sigma.is_finite()) {
            keep(&mut self.steps, Moved { time_frames, drift_px, speed_px: step.dx_px.hypot(step.dy_px) });
        }
    }

    /// What steps say of the drift between two times.
    ///
    /// Their noise is taken for that of as many that know nothing of each other, which is more than it is.
    fn by_steps(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 2]> {
        let steps = within(&self.steps, from_frames, to_frames, |step| step.time_frames);
        let speed_px =
            steps.iter().map(|step| step.speed_px).sum::<f64>() / (!steps.is_empty()).then_some(steps.len())? as f64;
        let along = |axis: usize| {
            let weight: f64 = steps.iter().map(|step| step.drift_px[axis].sigma.powi(-2)).sum();
            let weighted = |step: &Moved| step.drift_px[axis].value * step.drift_px[axis].sigma.powi(-2);
            let value = steps.iter().map(weighted).sum::<f64>() / weight;
            Estimate { value, sigma: weight.powf(-0.5).hypot(UNEVEN * value).hypot(BENT * speed_px) }
        };
        Some([along(0), along(1)])
    }

    /// What outlines say of it.
    fn by_outlines(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 2]> {
        let seen = self.between(from_frames, to_frames);
        let span = seen.last()?[0].time_frames - seen[0][0].time_frames;
        // What an outline errs by changes with the ground it passes.
        let shifts = |axis: usize| 4.0 * seen[0][axis].sigma / span;
        let slope = |axis: usize| {
            let (fit, fewer) = line(&seen.iter().map(|seen| seen[axis]).collect::<Vec<_>>())?;
            let rate = fit.rate(seen[0][axis].time_frames);
            Some(Estimate { value: rate.value, sigma: (rate.sigma * fit.excess() * fewer).hypot(shifts(axis)) })
        };
        if seen.len() < LEAST_SEEN {
            return None;
        }
        Some([slope(0)?, slope(1)?])
    }

    fn between(&self, from_frames: f64, to_frames: f64) -> &[[Sample; 2]] {
        within(&self.seen, from_frames, to_frames, |seen| seen[0].time_frames)
    }

    /// The drift a frame along x and y between two times, px, and the share of it that is no chance.
    fn rates(&self, from_frames: f64, to_frames: f64) -> Option<([Estimate; 2], f64)> {
        let rates = match (self.by_outlines(from_frames, to_frames), self.by_steps(from_frames, to_frames)) {
            (Some(outlines), Some(steps)) => std::array::from_fn(|axis| both(outlines[axis], steps[axis])),
            (outlines, steps) => outlines.or(steps)?,
        };
        // Along both axes at once, as one length.
        let square: f64 = rates.iter().map(|rate| (rate.value / rate.sigma).powi(2)).sum();
        Some((rates, (1.0 - (CHANCE_SIGMAS * CHANCE_SIGMAS / square).powi(2)).max(0.0)))
    }

    /// By how much a frame the outline surely leaves the pose between two times, along x and y, px: 0 where it may be
    /// chance. `None` where too little is seen.
    pub fn surely(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 2]> {
        let (rates, share) = self.rates(from_frames, to_frames)?;
        let told = |rate: Estimate| Estimate {
            value: share * rate.value,
            sigma: share.sqrt() * rate.sigma.hypot((1.0 - share) * rate.value),
        };
        Some(rates.map(told))
    }

    /// The drift a frame at a node, as far as it is sure.
    fn at(&self, node: &Node, regime: Regime) -> [Estimate; 2] {
        let (from, to) = window(node, regime);
        // A contact changes a spin, and how soon is not seen.
        let changed = if matches!(regime, Regime::Contact { .. }) { 0.5 } else { 0.0 };
        let unsure = |drift: Estimate| Estimate { sigma: drift.sigma.hypot(changed * drift.value), ..drift };
        self.surely(from, to).unwrap_or([Estimate { value: 0.0, sigma: 0.0 }; 2]).map(unsure)
    }

    /// The rates of the centre, where those of the pose are others.
    pub fn taken(&self, rates: PixelRates, regime: Regime, node: &Node) -> PixelRates {
        let [x, y] = self.at(node, regime);
        PixelRates { x: sum(rates.x, x), y: sum(rates.y, y), ..rates }
    }

    /// The step of the centre from a node on, where that of the pose is another.
    pub fn stepped(&self, step: RigidStep, regime: Regime, node: &Node) -> RigidStep {
        let [x, y] = self.at(node, regime);
        RigidStep {
            dx_px: step.dx_px + x.value,
            dy_px: step.dy_px + y.value,
            sigma_dx_px: step.sigma_dx_px.hypot(x.sigma),
            sigma_dy_px: step.sigma_dy_px.hypot(y.sigma),
            ..step
        }
    }

    /// The centre at a node, where it surely leaves the poses.
    pub fn center(&self, node: &Node, regime: Regime) -> Option<Center> {
        let (from, to) = window(node, regime);
        let (_, share) = self.rates(from, to).filter(|(_, share)| *share >= SURE_SHARE)?;
        let rates = self.at(node, regime).map(|rate| Estimate { value: rate.value / share, ..rate });
        let before = self.seen.partition_point(|seen| seen[0].time_frames <= to);
        let near = match self.between(from, to) {
            [] => self.seen.get(before.checked_sub(1)?..before)?,
            near => near,
        };
        let count = near.len() as f64;
        let away = node.time_frames - near.iter().map(|seen| seen[0].time_frames).sum::<f64>() / count;
        let at = |axis: usize| {
            let place = near.iter().map(|seen| seen[axis].value).sum::<f64>() / count + rates[axis].value * away;
            // Outlines of a film err alike.
            (place, near[0][axis].sigma.hypot(rates[axis].sigma * away))
        };
        let ((x, sigma_x), (y, sigma_y)) = (at(0), at(1));
        Some(Center { x_px: node.pose[0] + x, y_px: node.pose[1] + y, sigma_px: sigma_x.max(sigma_y) })
    }
}

/// Adds to what is kept, and drops the oldest half of it when it is too much.
fn keep<T>(kept: &mut Vec<T>, new: T) {
    if kept.len() >= 2 * KEPT {
        kept.drain(..KEPT);
    }
    kept.push(new);
}

/// What lies between two times.
fn within<T>(kept: &[T], from_frames: f64, to_frames: f64, time_frames: impl Fn(&T) -> f64) -> &[T] {
    let first = kept.partition_point(|kept| time_frames(kept) < from_frames);
    let end = kept.partition_point(|kept| time_frames(kept) <= to_frames);
    kept.get(first..end).unwrap_or_default()
}

fn sum(a: Estimate, b: Estimate) -> Estimate {
    Estimate { value: a.value + b.value, sigma: a.sigma.hypot(b.sigma) }
}

/// Two that say the same.
fn both(a: Estimate, b: Estimate) -> Estimate {
    let (of_a, of_b) = (a.sigma.powi(-2), b.sigma.powi(-2));
    Estimate { value: (of_a * a.value + of_b * b.value) / (of_a + of_b), sigma: (of_a + of_b).powf(-0.5) }
}

/// From when to when outlines tell the drift at a node.
fn window(node: &Node, regime: Regime) -> (f64, f64) {
    let frame = node.frame;
    let (from, to) = match regime {
        Regime::Flight { from, to } => (from.max(frame.saturating_sub(BACK)), to.min(frame + AHEAD)),
        Regime::Contact { from, .. } => (from.saturating_sub(BACK), from.saturating_sub(1)),
        Regime::Unknown => (frame.saturating_sub(BACK), frame + AHEAD),
    };
    let time = |at: u64| node.time_frames + at as f64 - frame as f64;
    (time(from) - 0.5, time(to) + 0.5)
}

/// A line through samples whose errors are alike from one to the next, and how many times more unsure that makes it.
fn line(samples: &[Sample]) -> Option<(Polynomial, f64)> {
    let middle = 0.5 * (samples.first()?.time_frames + samples.last()?.time_frames);
    let fit = Polynomial::fit(samples, middle, 1, 0.0)?;
    let left = |sample: &Sample| {
        fit.predict(sample.time_frames, sample.component).map_or(0.0, |at| (sample.value - at.value) / sample.sigma)
    };
    let left: Vec<f64> = samples.iter().map(left).collect();
    let square: f64 = left.iter().map(|left| left * left).sum();
    let next: f64 = left.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let alike = if square > 0.0 { (next / square).clamp(0.0, MOST_ALIKE) } else { 0.0 };
    // Of n samples whose errors follow one another with this correlation, so many tell something of their own.
    Some((fit, ((1.0 + alike) / (1.0 - alike)).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::PointStatus;

    const FLIGHT: Regime = Regime::Flight { from: 0, to: u64::MAX };

    fn node(frame: u64) -> Node {
        Node {
            frame,
            time_frames: frame as f64,
            component: 0,
            pose: [1.5 * frame as f64, 0.0, 0.0],
            sigma: [1e-3; 3],
            bridged: [0.0; 3],
            walk_share: [0.0; 3],
            kept: None,
        }
    }

    fn circle(frame: u64, [x, y]: [f64; 2]) -> Circle {
        let (x_px, y_px) = (90.0 + 1.5 * frame as f64 + x, 80.0 + y);
        Circle { x_px, y_px, radius_px: 57.0, sigma_center_px: 0.03, sigma_radius_px: 0.03, visible_fraction: 1.0 }
    }

    fn step(frame: u64, drift_px: [f64; 2]) -> BodyStep {
        BodyStep {
            is_carried: false,
            is_whole: true,
            rim_fraction: None,
            fixed_fraction: None,
            growth_fraction: None,
            drift_px: Some(drift_px.map(|value| Estimate { value, sigma: 0.01 })),
            frame,
            stamp_ns: frame,
            body: 0,
            interval_frames: 1,
            circle: None,
            rod: None,
            step: Some(RigidStep { dx_px: 1.5, ..RigidStep::STILL }),
            status: PointStatus::Valid,
        }
    }

    /// A scatter without a mean, up to 1.
    fn scatter(frame: u64) -> f64 {
        ((frame * 37 % 17) as f64 - 8.0) / 8.0
    }

    fn steps(drift_px: [f64; 2]) -> Drift {
        let mut drift = Drift::default();
        for frame in 0..100 {
            drift.push_step(frame as f64, &step(frame, drift_px.map(|px| px + 0.015 * scatter(frame))));
        }
        drift
    }

    fn outlines(drift_px: [f64; 2], frames: u64) -> Drift {
        let mut drift = Drift::default();
        for frame in 0..frames {
            let place = drift_px.map(|px| px * frame as f64 + 0.04 * scatter(frame));
            drift.push(&node(frame), &circle(frame, place));
        }
        drift
    }

    #[test]
    fn steps_and_outlines_alike_tell_how_a_centre_leaves_its_poses() {
        for drift in [steps([-0.21, 0.05]), outlines([-0.21, 0.05], 100)] {
            let [x, y] = drift.surely(0.0, 99.0).unwrap();
            assert!((x.value + 0.21).abs() < 3.0 * x.sigma && x.sigma < 5e-3, "{x:?}");
            assert!((y.value - 0.05).abs() < 3.0 * y.sigma && y.sigma < 5e-3, "{y:?}");
        }
        assert_eq!(Drift::default().surely(0.0, 99.0), None, "nothing is seen");
    }

    #[test]
    fn what_may_be_chance_is_left_out() {
        for drift in [steps([0.002, -0.001]), outlines([1e-4, -2e-4], 100)] {
            let told = drift.surely(0.0, 99.0).unwrap();
            assert!(told.iter().all(|drift| drift.value.abs() <= 0.0 && drift.sigma.abs() <= 0.0), "{told:?}");
            assert_eq!(drift.center(&node(50), FLIGHT), None);
        }
    }

    #[test]
    fn outlines_that_err_alike_for_a_while_tell_less() {
        let mut drift = Drift::default();
        for frame in 0..100 {
            let slow = 0.05 * (frame as f64 / 30.0).sin();
            drift.push(&node(frame), &circle(frame, [slow, slow]));
        }
        let told = drift.surely(0.0, 40.0).unwrap();
        assert!(told.iter().all(|drift| drift.value.abs() < 1e-3), "{told:?}");
    }

    #[test]
    fn a_centre_goes_on_where_its_outline_is_not_seen() {
        let mut drift = outlines([-0.2, 0.0], 40);
        for frame in 0..100 {
            drift.push_step(frame as f64, &step(frame, [-0.2, 0.0]));
        }
        for frame in [20, 60, 90] {
            let center = drift.center(&node(frame), FLIGHT).unwrap();
            let off = center.x_px - (90.0 + 1.3 * frame as f64);
            assert!(off.abs() < 3.0 * center.sigma_px && center.sigma_px < 0.3, "{frame}: off {off}, {center:?}");
        }
        let contact = Regime::Contact { from: 60, to: Some(80), acceleration_px: 0.0, speed_px: 1.5 };
        let still = |value: f64| Estimate { value, sigma: 1e-3 };
        let rates = PixelRates { x: still(1.5), y: still(0.0), theta: still(0.1), window_frames: 9, order: 2 };
        let (flies, touches) = (drift.taken(rates, FLIGHT, &node(50)), drift.taken(rates, contact, &node(70)));
        assert!((flies.x.value - 1.3).abs() < 3.0 * flies.x.sigma && flies.x.sigma < 0.01, "{flies:?}");
        assert!((touches.x.value - 1.3).abs() < 0.01 && touches.x.sigma > 0.09, "a contact turns it: {touches:?}");
        let moved = drift.stepped(RigidStep { dx_px: 1.5, ..RigidStep::STILL }, FLIGHT, &node(50));
        assert!((moved.dx_px - 1.3).abs() < 3.0 * moved.sigma_dx_px && moved.sigma_dx_px < 0.01, "{moved:?}");
    }
}
