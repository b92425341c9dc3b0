//! Integration of steps to poses.

use std::collections::BTreeMap;

use super::patch_repeat::{ExpectedAngle, PatchRepeat};
use super::random_walk::{KeptReference, LONG_STEP_WEIGHT, RandomWalk};
use crate::results::{BodyStep, MotionMethod, RigidStep};

/// The maximum gap over which a pose is extrapolated, frames.
const BRIDGE_FRAMES: f64 = 8.0;
/// The minimum sigma of a step, px or deg.
const SIGMA_FLOOR: f64 = 1e-7;

/// A body's pose in one frame, integrated from its steps.
///
/// Poses of one component differ exactly by the measured steps between them. The noise of successive steps is that of
/// the frames they share, with opposite signs. A pose therefore scatters by the steps' sigma / sqrt(2), however many
/// steps are summed. A missing step starts a new component, and steps over n frames make n interleaved components.
/// Between components the pose is extrapolated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Sequence number of the frame.
    pub frame: u64,
    /// Time since the stream's first frame, nominal frame periods.
    pub time_frames: f64,
    /// The component; nodes of one component are linked by steps.
    pub component: u32,
    /// The component of the angle; nodes of one are linked by measured rotations.
    pub turn: u32,
    /// x px, y px (down), angle deg (counter-clockwise) since the body's first node.
    pub pose: [f64; 3],
    /// White standard uncertainty of each.
    pub sigma: [f64; 3],
    /// Variance added to each coordinate by extrapolation over gaps since the first node; infinite where a gap was too
    /// long.
    pub bridged: [f64; 3],
    /// The random-walk part of the step to this node, as a share of `sigma`. It stays in all later nodes.
    pub walk_share: [f64; 3],
    /// The reference of the last whole-body match on the way here.
    pub kept: Option<KeptReference>,
}

/// The integrator of one body's steps.
#[derive(Debug, Clone)]
pub struct PoseIntegrator {
    walk: RandomWalk,
    components: u32,
    turns: u32,
    source: PoseSource,
    /// The last measured rotation.
    spin: Option<Spin>,
    /// Poses at the ends of steps, by frame and interval.
    arrivals: BTreeMap<(u64, u32), Pose>,
    newest: Option<Pose>,
    repeat: PatchRepeat,
    /// The newest node with a step from it, its rates per nominal frame, and the rates before.
    last: Option<(Pose, [f64; 3], [f64; 3])>,
}

/// Whether motion and uncertainties of a step are all finite.
fn has_finite_numbers(step: &RigidStep) -> bool {
    let numbers = [step.dx_px, step.dy_px, step.dtheta_deg, step.sigma_dx_px, step.sigma_dy_px, step.sigma_dtheta_deg];
    numbers.iter().all(|x| x.is_finite())
}

/// A measured rotation per frame, from which a few frames without one are bridged.
#[derive(Debug, Clone, Copy)]
struct Spin {
    rate_deg: f64,
    /// The rate of the step before.
    previous_rate_deg: f64,
    sigma_deg: f64,
    frames_since_measured: f64,
}

/// A rotation that was not measured.
#[derive(Debug, Clone, Copy)]
struct Extrapolation {
    rotation_deg: f64,
    variance_deg2: f64,
}

impl Spin {
    /// Advances by `frames` without a measured rotation. Returns the extrapolated rotation over them.
    ///
    /// The variance is infinite if the last rotation was measured more than [`BRIDGE_FRAMES`] before.
    fn advance(&mut self, frames: f64) -> Extrapolation {
        self.frames_since_measured += frames;
        let change = 0.5 * self.frames_since_measured * (self.rate_deg - self.previous_rate_deg);
        let variance = 2.0 * self.sigma_deg.powi(2) + change.powi(2);
        let is_known = self.frames_since_measured <= BRIDGE_FRAMES;
        let variance_deg2 = if is_known { frames * frames * variance } else { f64::INFINITY };
        Extrapolation { rotation_deg: frames * self.rate_deg, variance_deg2 }
    }
}

/// The origin of the newest nodes' positions: matches or outlines.
#[derive(Debug, Clone, Copy, Default)]
struct PoseSource {
    /// The component of the next node.
    component: u32,
    bridged: [f64; 3],
    /// The position of nodes relative to outlines, if outlines place them, px.
    offset_px: Option<[f64; 2]>,
}

/// Whether two rotations with these standard uncertainties, deg, are both known.
fn are_rotations_known(sigma_deg: f64, other_deg: f64) -> bool {
    [sigma_deg, other_deg].iter().all(|sigma| RigidStep { sigma_dtheta_deg: *sigma, ..RigidStep::STILL }.has_rotation())
}

impl PoseIntegrator {
    /// Creates an empty chain of steps with this random walk.
    pub fn new(walk: RandomWalk) -> Self {
        Self {
            walk,
            components: 0,
            turns: 0,
            source: PoseSource::default(),
            spin: None,
            arrivals: BTreeMap::new(),
            newest: None,
            repeat: PatchRepeat::default(),
            last: None,
        }
    }

    /// Adds the next step in frame order, the shortest of its frame. Returns the frame's node unless no step leads to
    /// or from it.
    ///
    /// `periods` is the time between the exposures of the body in this frame and the next, in nominal frame periods.
    pub fn push(&mut self, step: &BodyStep, time_frames: f64, periods: f64) -> Option<Pose> {
        if let Some(node) = self.patch_pose(step, time_frames) {
            self.newest = Some(node);
            return Some(node);
        }
        let arrived = self.take_arrival(step.frame);
        let arrived = self.place_by_outline(step, arrived);
        let outgoing = step.motion.filter(has_finite_numbers);
        let n = f64::from(step.interval_frames.max(1));
        let sigma_out = outgoing.map(|s| {
            [s.sigma_dx_px, s.sigma_dy_px, s.sigma_dtheta_deg]
                .map(|sigma| (sigma.abs() * n * std::f64::consts::FRAC_1_SQRT_2).max(SIGMA_FLOOR))
        });
        let mut node = match (arrived, sigma_out) {
            (None, None) => return None,
            (Some(node), None) => node,
            (Some(node), Some(out)) => {
                let both = |k: usize| ((node.sigma[k].powi(2) + out[k].powi(2)) / 2.0).sqrt();
                // A rotation measured on one side only is known by that side.
                let sigma = [
                    both(0),
                    both(1),
                    if are_rotations_known(node.sigma[2], out[2]) { both(2) } else { node.sigma[2].min(out[2]) },
                ];
                Pose { sigma, ..node }
            }
            (None, Some(sigma)) => self.begin_component(time_frames, sigma),
        };
        node.frame = step.frame;
        node.time_frames = time_frames;
        self.follow_source(step, &node, arrived.is_some());
        self.newest = Some(node);
        if let (Some(out), Some(sigma)) = (outgoing, sigma_out) {
            let rates = [out.dx_px, out.dy_px, out.dtheta_deg];
            let target = step.frame + u64::from(step.interval_frames.max(1));
            let arriving = Pose { sigma, ..self.pose_after_step(&node, step, rates.map(|rate| n * rate)) };
            self.arrivals.insert((target, step.interval_frames), arriving);
            let rates = rates.map(|rate| rate / periods);
            if out.has_rotation() {
                self.spin = Some(Spin {
                    rate_deg: rates[2],
                    previous_rate_deg: self.spin.map_or(rates[2], |spin| spin.rate_deg),
                    sigma_deg: node.sigma[2],
                    frames_since_measured: 0.0,
                });
            }
            let before = self.last.map_or(rates, |(_, rates, _)| rates);
            self.last = Some((Pose { turn: arriving.turn, ..node }, rates, before));
        }
        Some(node)
    }

    /// Adds a step over a longer interval, which links its frame to a later one. It follows the shortest step of its
    /// frame.
    pub fn link(&mut self, step: &BodyStep) {
        let Some(from) = self.newest.filter(|node| node.frame == step.frame && step.angle_deg.is_none()) else {
            return;
        };
        let Some(out) = step.motion.filter(has_finite_numbers) else { return };
        let n = f64::from(step.interval_frames.max(1));
        let moved = [out.dx_px, out.dy_px, out.dtheta_deg].map(|rate| n * rate);
        let target = step.frame + u64::from(step.interval_frames);
        let Pose { component, turn, bridged, .. } = from;
        let arriving = Pose { component, turn, bridged, ..self.pose_after_step(&from, step, moved) };
        self.arrivals.insert((target, step.interval_frames), arriving);
    }

    /// Returns the pose at the end of a step from `from` by `moved` (px, px, deg). An unmeasured angle is extrapolated.
    fn pose_after_step(&mut self, from: &Pose, step: &BodyStep, moved: [f64; 3]) -> Pose {
        let mut kept = from.kept;
        let walk_share = match step.method {
            MotionMethod::WholeBody => self.walk.whole_body_step(from.frame, from.pose[2], &mut kept),
            MotionMethod::Subsets => self.walk.subset_step(moved),
            // The sum of the differences between outlines is the last outline, whose error does not accumulate.
            MotionMethod::Outlines => [0.0; 3],
        };
        let pose = std::array::from_fn(|k| from.pose[k] + moved[k]);
        let (component, bridged) = (self.source.component, self.source.bridged);
        let next = Pose { component, pose, bridged, walk_share, kept, ..*from };
        if step.motion.is_some_and(|motion| motion.has_rotation()) {
            next
        } else {
            self.with_extrapolated_angle(next, f64::from(step.interval_frames.max(1)))
        }
    }

    /// Returns the node of a patch, whose pose in its reference image is measured in every frame; `None` for other
    /// bodies.
    ///
    /// No step leads to it, so nothing accumulates and no gap matters. All poses contain the noise of the reference.
    fn patch_pose(&mut self, step: &BodyStep, time_frames: f64) -> Option<Pose> {
        let (angle, circle) = (step.angle_deg?, step.circle()?);
        let angle_deg = self.repeat.continued(step.frame, angle.value, angle.sigma);
        let newest_deg = self.newest.map_or(angle_deg, |newest| newest.pose[2]);
        let turns = ((newest_deg - angle_deg) / 360.0).round();
        let n = f64::from(step.interval_frames.max(1));
        let angle_deg = angle_deg + 360.0 * turns;
        self.repeat.expected =
            step.motion.filter(has_finite_numbers).filter(RigidStep::has_rotation).map(|out| ExpectedAngle {
                frame: step.frame + u64::from(step.interval_frames.max(1)),
                angle_deg: angle_deg + n * out.dtheta_deg,
                variance_deg2: (n * out.sigma_dtheta_deg).powi(2),
                rate_deg: out.dtheta_deg,
                rate_variance_deg2: out.sigma_dtheta_deg.powi(2),
            });
        let out = step.motion.filter(has_finite_numbers).unwrap_or(RigidStep::STILL);
        // The image that the patch was drawn in matches itself exactly; the step from it has its noise.
        let sigma = [
            circle.sigma_center_px.max(n * out.sigma_dx_px),
            circle.sigma_center_px.max(n * out.sigma_dy_px),
            angle.sigma.max(n * out.sigma_dtheta_deg),
        ];
        Some(Pose {
            frame: step.frame,
            time_frames,
            component: 0,
            turn: self.repeat.turn,
            pose: [circle.x_px, circle.y_px, angle_deg],
            sigma: sigma.map(|sigma| (sigma * std::f64::consts::FRAC_1_SQRT_2).max(SIGMA_FLOOR)),
            bridged: [0.0, 0.0, self.repeat.variance_deg2],
            walk_share: [0.0; 3],
            kept: None,
        })
    }

    /// Returns the node of a frame placed by its outline, if the motion comes from outlines; else the node `arrived`.
    ///
    /// Outlines place the body without the frames between, so a gap in them breaks nothing.
    fn place_by_outline(&mut self, step: &BodyStep, arrived: Option<Pose>) -> Option<Pose> {
        let is_matched = step.motion.is_some() && step.method != MotionMethod::Outlines;
        let offset_px = self.source.offset_px.filter(|_| !is_matched);
        let circle = step.circle().filter(|_| step.is_detected());
        let (Some([x, y]), Some(circle), Some(last)) = (offset_px, circle, self.newest) else { return arrived };
        let turned = arrived.unwrap_or_else(|| {
            self.turns += 1;
            Pose { turn: self.turns, bridged: [last.bridged[0], last.bridged[1], f64::INFINITY], ..last }
        });
        let bridged = [self.source.bridged[0], self.source.bridged[1], turned.bridged[2]];
        let sigma = [circle.sigma_center_px, circle.sigma_center_px, turned.sigma[2]];
        let pose = [circle.x_px + x, circle.y_px + y, turned.pose[2]];
        Some(Pose { component: self.source.component, pose, sigma, bridged, walk_share: [0.0; 3], ..turned })
    }

    /// Records what places the nodes from this one on: matches, or outlines, whose errors are far larger.
    ///
    /// Nodes of the two kinds are not linked.
    fn follow_source(&mut self, step: &BodyStep, node: &Pose, is_linked: bool) {
        let Some(_) = step.motion else { return };
        let circle = step.circle().filter(|_| step.method == MotionMethod::Outlines);
        let was_outline = self.source.offset_px.is_some() && node.component == self.source.component;
        let offset_px = circle.map(|circle| [node.pose[0] - circle.x_px, node.pose[1] - circle.y_px]);
        let (mut component, mut bridged) = (node.component, node.bridged);
        if is_linked && was_outline != offset_px.is_some() {
            component = self.components;
            self.components += 1;
            let sigma = circle.map_or([node.sigma[0], node.sigma[1]], |circle| [circle.sigma_center_px; 2]);
            bridged = [bridged[0] + sigma[0].powi(2), bridged[1] + sigma[1].powi(2), bridged[2]];
        }
        let offset_px = if was_outline && offset_px.is_some() { self.source.offset_px } else { offset_px };
        self.source = PoseSource { component, bridged, offset_px };
    }

    /// Returns a node whose angle is extrapolated over `frames`, because its rotation was not measured.
    fn with_extrapolated_angle(&mut self, node: Pose, frames: f64) -> Pose {
        self.turns += 1;
        let unknown = Extrapolation { rotation_deg: 0.0, variance_deg2: f64::INFINITY };
        let Extrapolation { rotation_deg, variance_deg2 } =
            self.spin.as_mut().map_or(unknown, |spin| spin.advance(frames));
        let pose = [node.pose[0], node.pose[1], node.pose[2] + rotation_deg];
        let bridged = [node.bridged[0], node.bridged[1], node.bridged[2] + variance_deg2];
        Pose { turn: self.turns, pose, bridged, ..node }
    }

    /// Removes and returns the node that steps lead to in this frame; `None` if no step does.
    ///
    /// The longer steps correct the position of the shortest.
    fn take_arrival(&mut self, frame: u64) -> Option<Pose> {
        let later = self.arrivals.split_off(&(frame, 0));
        self.arrivals = later;
        let mut arrived: Option<Pose> = None;
        while let Some(entry) = self.arrivals.first_entry().filter(|entry| entry.key().0 == frame) {
            let longer = entry.remove();
            arrived = Some(match arrived {
                None => longer,
                // Nodes of different components are not linked, so the shortest step's holds.
                Some(node) if node.component != longer.component => node,
                Some(node) => {
                    let average = |k: usize| node.pose[k] + LONG_STEP_WEIGHT * (longer.pose[k] - node.pose[k]);
                    Pose { pose: std::array::from_fn(average), ..node }
                }
            });
        }
        arrived
    }

    /// Starts a new component at a time, with the pose extrapolated from the newest node and these sigmas.
    fn begin_component(&mut self, time_frames: f64, sigma: [f64; 3]) -> Pose {
        // No step of its component leads to it.
        let walk_share = [0.0; 3];
        let kept = None;
        let (component, turn) = (self.components, self.turns);
        (self.components, self.turns) = (component + 1, turn + 1);
        let Some((last, rates, before)) = self.last else {
            return Pose {
                frame: 0,
                time_frames,
                component,
                turn,
                pose: [0.0; 3],
                sigma,
                bridged: [0.0; 3],
                walk_share,
                kept,
            };
        };
        let dt = time_frames - last.time_frames;
        let pose = std::array::from_fn(|k| last.pose[k] + dt * rates[k]);
        let bridged = std::array::from_fn(|k| {
            if dt.abs() > BRIDGE_FRAMES {
                return f64::INFINITY;
            }
            // The noise of the rate, and a further change as large as the one over the last frame.
            let rate = 2.0 * last.sigma[k].powi(2) + (0.5 * dt * (rates[k] - before[k])).powi(2);
            last.bridged[k] + dt * dt * rate
        });
        Pose { frame: 0, time_frames, component, turn, pose, sigma, bridged, walk_share, kept }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Renewal, subset_walk};
    use super::*;

    /// Approximately normal numbers: sums of twelve uniform ones.
    struct Noise(u64);

    impl Noise {
        fn next(&mut self) -> f64 {
            let mut even = || {
                self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 11) as f64 / (1_u64 << 53) as f64
            };
            (0..12).map(|_| even()).sum::<f64>() - 6.0
        }
    }

    fn step(frame: u64, interval_frames: u32, dx_px: f64) -> BodyStep {
        let dx_px = dx_px / f64::from(interval_frames);
        let sigma = 1.0 / f64::from(interval_frames);
        let step = RigidStep {
            dx_px,
            dy_px: 0.0,
            dtheta_deg: 0.0,
            sigma_dx_px: sigma,
            sigma_dy_px: sigma,
            sigma_dtheta_deg: sigma,
            points: 9,
        };
        BodyStep { frame, stamp_ns: frame, interval_frames, motion: Some(step), ..BodyStep::default() }
    }

    /// The root mean square drift of a chain of noisy steps after 4000 frames, over several runs.
    fn drift(intervals: &[u32]) -> f64 {
        let (mut noise, mut sum, runs) = (Noise(7), 0.0, 200);
        for _ in 0..runs {
            let mut chain = PoseIntegrator::new(RandomWalk::default());
            let mut last = 0.0;
            for frame in 0..4000 {
                last = chain.push(&step(frame, intervals[0], noise.next()), frame as f64, 1.0).unwrap().pose[0];
                intervals[1..].iter().for_each(|interval| chain.link(&step(frame, *interval, noise.next())));
            }
            sum += last * last;
        }
        (sum / f64::from(runs)).sqrt()
    }

    #[test]
    fn a_pose_drifts_as_the_step_that_led_to_it() {
        let mut chain = PoseIntegrator::new(RandomWalk::new(&[1], Some(Renewal { block_frames: 8, stale_deg: 3.0 })));
        let shares = (0..6).map(|frame| {
            let method = if frame == 1 || frame == 2 { MotionMethod::WholeBody } else { MotionMethod::Subsets };
            let step = BodyStep { method, ..step(frame, 1, 0.5) };
            chain.push(&step, frame as f64, 1.0).unwrap().walk_share[0]
        });
        let shares: Vec<f64> = shares.collect();
        let subsets = subset_walk([0.5, 0.0, 0.0])[0];
        let is = |k: usize, share: f64| (shares[k] - share).abs() < 1e-12;
        assert!(is(0, 0.0) && is(1, subsets) && is(4, subsets), "{shares:?}");
        assert!(shares[2] > 0.0 && is(3, 0.0), "only the first step with a reference leaves something: {shares:?}");
    }

    #[test]
    fn each_of_several_interleaved_chains_has_the_renewal_in_it() {
        let mut chain = PoseIntegrator::new(RandomWalk::new(&[3], Some(Renewal { block_frames: 6, stale_deg: 3.0 })));
        let renewed = |frame: u64| {
            let step = BodyStep { method: MotionMethod::WholeBody, ..step(frame, 3, 0.5) };
            chain.push(&step, frame as f64, 1.0).unwrap().walk_share[0] > 0.0
        };
        // Steps from the first three frames of a block continue its reference, those from the others keep it.
        let renewed: Vec<u64> =
            (0..15).zip((0..15).map(renewed)).filter(|(_, renewed)| *renewed).map(|(f, _)| f).collect();
        assert_eq!(renewed, [3, 4, 5, 9, 10, 11]);
    }

    #[test]
    fn longer_intervals_keep_the_sum_from_drifting_by_as_much_as_its_share_says() {
        let alone = drift(&[1]);
        assert!((alone / 4000_f64.sqrt() - 1.0).abs() < 0.1, "{alone}");
        for intervals in [&[1, 4][..], &[1, 10], &[1, 3, 9]] {
            let share = |intervals: &[u32]| RandomWalk::new(intervals, None).subset_step([0.5, 0.0, 0.0])[0];
            let (found, stated) = (drift(intervals) / alone, share(intervals) / share(&[1]));
            assert!((found / stated - 1.0).abs() < 0.2, "{intervals:?}: {found}, stated {stated}");
        }
    }

    #[test]
    fn a_missing_step_is_bridged_by_a_longer_one() {
        let mut chain = PoseIntegrator::new(RandomWalk::default());
        for frame in 0..20 {
            let mut one = step(frame, 1, 0.5);
            one.motion = one.motion.filter(|_| frame != 9);
            let node = chain.push(&one, frame as f64, 1.0).unwrap();
            assert_eq!(node.component, 0, "frame {frame}");
            assert!((node.pose[0] - 0.5 * frame as f64).abs() < 1e-12);
            chain.link(&step(frame, 3, 1.5));
        }
    }
}
