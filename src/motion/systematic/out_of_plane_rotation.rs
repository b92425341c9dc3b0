//! The drift of a body's outline relative to the pose of its pattern, caused by rotation out of the image plane.

mod uniform_interval;

use super::cumulative::{partition_point, push_bounded, within};
use super::rotation_prior::{ROTATING_SHARE, Source, possible_drift};
use crate::motion::{Center, CumulativeSums, PixelRates, Pose, Regime, RollingShutter};
use crate::numeric::{Polynomial, Sample};
use crate::results::{BodyStep, Circle, Estimate, RigidStep};
use uniform_interval::{Lines, UniformInterval};

/// The minimum number of outlines of an estimate.
const MIN_SAMPLES: usize = 3;
/// The minimum significance of a drift, sigmas. Outlines depend on light and background, which a pattern does not.
const CHANCE_SIGMAS: f64 = 3.5;
/// The deviation from which a step has another drift than the rest, sigmas; it is high because there are many steps.
const STRUCK_SIGMAS: f64 = 5.0;
/// The systematic error of a drift from steps, as a share of the drift and of the speed (lens distortion).
const DRIFT_ERROR_SHARE: f64 = 0.01;
const STRUCK_ERROR: f64 = 0.001;
/// The significant share of a drift from which outlines, and not poses, determine the centre.
const SURE_SHARE: f64 = 0.5;
/// The rms deviation from which a drift is not uniform, sigmas: of steps from their mean, of outlines from a line.
const NONUNIFORM_SIGMAS: f64 = 2.5;
/// The half width of the window that is used for any deviation, frames.
const NARROW_FRAMES: f64 = 4.0;
/// The reach of the window for the drift in flight back from a frame, frames.
const BACK_FRAMES: u64 = 128;
/// Its reach ahead; an undetected contact lies further ahead.
const AHEAD_FRAMES: u64 = 14;
/// The maximum correlation of outline errors from frame to frame.
const MAX_CORRELATION: f64 = 0.9;
/// The apparent rotation of a half-occluded ball, per drift of its front in units of half its radius.
const HALF_OCCLUDED_ROTATION: f64 = 0.4;
/// The apparent rotation of a fully visible ball with an uneven pattern, in the same units.
const UNEVEN_PATTERN_ROTATION: f64 = 0.03;
/// The common error of all steps of an occluded ball, as a share of their sigmas: see `docs/studies.md`.
const COMMON_ERROR: f64 = 0.3;

const NO_DRIFT: Estimate = Estimate { value: 0.0, sigma: 0.0 };

/// The drift of outline centres relative to integrated poses.
///
/// The pattern of a ball that rotates about an axis in the image plane moves with its front, faster or slower than its
/// centre. Its outline does not.
#[derive(Debug, Clone, Default)]
pub struct OutlineDrift {
    outlines: Vec<[Sample; 2]>,
    /// The drift from steps: of each, and summed.
    steps: Vec<StepDrift>,
    sums: CumulativeSums<3>,
    /// The displacement of a ball's surface per frame, by translation and spin.
    speeds: Vec<SurfaceSpeed>,
    radius_px: f64,
    /// The common error of all steps, as a share of their sigmas.
    common_error_share: f64,
}

#[derive(Debug, Clone, Copy)]
struct SurfaceSpeed {
    time_frames: f64,
    px: f64,
    /// The occluded fraction of the ball.
    occluded_fraction: f64,
}

/// The motion of a ball relative to its step per frame: px, px and deg.
#[derive(Debug, Clone, Copy)]
struct StepDrift {
    time_frames: f64,
    drift: [Estimate; 3],
    speed_px: f64,
}

/// The drift per frame between two times.
#[derive(Debug, Clone, Copy)]
struct Rates {
    /// The drift along x and y, px.
    px: [Estimate; 2],
    /// The significant share of the drift.
    share: f64,
    /// The drift of the angle, deg, where steps determine it.
    turn: Option<Estimate>,
}

/// The known drift at a node.
#[derive(Debug, Clone, Copy)]
pub struct LocalDrift {
    /// The interval of uniform drift around the node.
    from_frames: f64,
    to_frames: f64,
    /// The scatter of the drift in that interval, px, px and deg per frame.
    scatter: [f64; 3],
    rates: Option<Rates>,
    /// The significant drift, px, px and deg per frame.
    drift: [Estimate; 3],
}

impl OutlineDrift {
    /// Creates an estimate for a camera with a rolling or a global shutter.
    pub fn new(rolling: &RollingShutter) -> Self {
        Self { common_error_share: if rolling.is_rolling() { 1.0 } else { 0.0 }, ..Self::default() }
    }

    /// Records the offset of the outline detected in a node's frame from the node's pose.
    pub fn push(&mut self, node: &Pose, circle: &Circle) {
        let sigma = circle.sigma_center_px;
        let apart = [circle.x_px - node.pose[0], circle.y_px - node.pose[1]];
        if !(sigma > 0.0 && sigma.is_finite() && apart.iter().all(|apart| apart.is_finite())) {
            return;
        }
        self.radius_px = circle.radius_px;
        let (time_frames, component) = (node.time_frames, node.component);
        push_bounded(&mut self.outlines, apart.map(|value| Sample { time_frames, component, value, sigma, walk: 0.0 }));
    }

    /// Records the drift and the surface speed that the step from a frame shows.
    pub fn push_step(&mut self, time_frames: f64, step: &BodyStep) {
        let Some(moved) = step.motion else { return };
        let speed_px = moved.dx_px.hypot(moved.dy_px);
        if let Some(circle) = &step.circle() {
            self.radius_px = circle.radius_px;
            let px = speed_px.hypot(circle.radius_px * moved.dtheta_deg.to_radians());
            let occluded_fraction = (1.0 - circle.visible_fraction).clamp(0.0, 1.0);
            if px.is_finite() && occluded_fraction.is_finite() {
                push_bounded(&mut self.speeds, SurfaceSpeed { time_frames, px, occluded_fraction });
            }
        }
        self.sums.push(step, time_frames, step.drift);
        if let Some(drift) = step.drift {
            push_bounded(&mut self.steps, StepDrift { time_frames, drift, speed_px });
        }
    }

    /// Returns the drift by steps between two times, px, px and deg per frame; `None` without a step.
    fn drift_by_steps(&self, from_frames: f64, to_frames: f64, lines: &Lines) -> Option<[Estimate; 3]> {
        let lens_error = self.lens_error(from_frames, to_frames)?;
        let steps = within(&self.steps, from_frames, to_frames, |step| step.time_frames);
        let common_error_share =
            self.common_error_share.hypot(COMMON_ERROR * self.occluded_fraction(from_frames, to_frames))
                / steps.len().max(1) as f64;
        Some(std::array::from_fn(|axis| {
            let fit = &lines[axis].0;
            let rate = fit.rate(from_frames);
            let sigma = (rate.sigma * fit.excess()).hypot(DRIFT_ERROR_SHARE * rate.value).hypot(lens_error[axis]);
            let common_error = common_error_share * steps.iter().map(|step| step.drift[axis].sigma).sum::<f64>();
            Estimate { sigma: sigma.hypot(common_error), ..rate }
        }))
    }

    /// Fits lines to the sums of steps between two times; `None` where the steps do not determine them.
    fn fit_lines(&self, from_frames: f64, to_frames: f64) -> Option<Lines> {
        let sums = self.sums.between(from_frames, to_frames);
        let middle = 0.5 * (sums.first()?[0].time_frames + sums.last()?[0].time_frames);
        let line = |axis: usize| {
            let sums: Vec<Sample> = sums.iter().map(|sums| sums[axis]).collect();
            Some((Polynomial::fit(&sums, middle, 1, 0.0)?, sums))
        };
        Some([line(0)?, line(1)?, line(2)?])
    }

    /// Returns the possible effect of lens distortion on the motion between two times, px, px and deg per frame; `None`
    /// without a step.
    fn lens_error(&self, from_frames: f64, to_frames: f64) -> Option<[f64; 3]> {
        let steps = within(&self.steps, from_frames, to_frames, |step| step.time_frames);
        let count = (!steps.is_empty()).then_some(steps.len())? as f64;
        let bent_px = STRUCK_ERROR * steps.iter().map(|step| step.speed_px).sum::<f64>() / count;
        Some([bent_px, bent_px, 0.0])
    }

    /// Returns the rms scatter of a non-uniform drift of steps between two times, px, px and deg.
    fn step_scatter(&self, from_frames: f64, to_frames: f64, lines: &Lines) -> [f64; 3] {
        let Some(lens_error) = self.lens_error(from_frames, to_frames) else { return [0.0; 3] };
        let steps = within(&self.steps, from_frames, to_frames, |step| step.time_frames);
        let scatter = |axis: usize| {
            let (fit, sums) = &lines[axis];
            // A relative change of the drift over the whole time bends its sum by an eighth of the total change.
            let error = lens_error[axis].hypot(DRIFT_ERROR_SHARE * fit.rate(from_frames).value);
            let bends = 0.125 * (to_frames - from_frames) * error;
            let pull2 = |sum: &Sample| {
                fit.residual(sum).map_or(0.0, |(residual, sigma)| residual * residual / (sigma * sigma + bends * bends))
            };
            let is_even = sums.iter().map(pull2).sum::<f64>() <= NONUNIFORM_SIGMAS.powi(2) * fit.freedom() as f64;
            if is_even || fit.freedom() == 0 {
                return 0.0;
            }
            let count = steps.len().max(1) as f64;
            let mean = steps.iter().map(|step| step.drift[axis].value).sum::<f64>() / count;
            let square = steps.iter().map(|step| (step.drift[axis].value - mean).powi(2)).sum::<f64>() / count;
            square.sqrt()
        };
        [0, 1, 2].map(scatter)
    }

    /// Returns the drift by outlines between two times along x and y, px per frame; `None` for too few outlines.
    fn drift_by_outlines(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 2]> {
        let outlines = self.outlines_between(from_frames, to_frames);
        let span = outlines.last()?[0].time_frames - outlines[0][0].time_frames;
        // The error of an outline changes with the background it passes.
        let shift = |axis: usize| 4.0 * outlines[0][axis].sigma / span;
        let slope = |axis: usize| {
            let (fit, fewer) = fit_line(&outlines.iter().map(|outline| outline[axis]).collect::<Vec<_>>())?;
            let rate = fit.rate(outlines[0][axis].time_frames);
            Some(Estimate { value: rate.value, sigma: (rate.sigma * fit.excess() * fewer).hypot(shift(axis)) })
        };
        if outlines.len() < MIN_SAMPLES {
            return None;
        }
        Some([slope(0)?, slope(1)?])
    }

    /// Returns the offsets of the outlines from the poses between two times.
    fn outlines_between(&self, from_frames: f64, to_frames: f64) -> &[[Sample; 2]] {
        within(&self.outlines, from_frames, to_frames, |outline| outline[0].time_frames)
    }

    /// Returns the drift between two times by outlines and steps together; `None` where neither determines it.
    fn combined_rates(&self, from_frames: f64, to_frames: f64, lines: Option<&Lines>) -> Option<Rates> {
        let steps = lines.and_then(|lines| self.drift_by_steps(from_frames, to_frames, lines));
        let px = match (self.drift_by_outlines(from_frames, to_frames), steps) {
            (Some(outlines), Some(steps)) => std::array::from_fn(|axis| weighted_mean(outlines[axis], steps[axis])),
            (outlines, steps) => outlines.or(steps.map(|[x, y, _]| [x, y]))?,
        };
        // Along both axes at once, as one length.
        let square: f64 = px.iter().map(|rate| (rate.value / rate.sigma).powi(2)).sum();
        let share = (1.0 - (CHANCE_SIGMAS * CHANCE_SIGMAS / square).powi(2)).max(0.0);
        Some(Rates { px, share, turn: steps.map(|[_, _, turn]| turn) })
    }

    /// Returns the significant drift between two times, along x and y, px per frame, and of the angle, deg per frame; 0
    /// where it may be chance. `None` where there are too few data.
    pub fn significant(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 3]> {
        let rates = self.combined_rates(from_frames, to_frames, self.fit_lines(from_frames, to_frames).as_ref())?;
        Some(self.significant_part(from_frames, to_frames, &rates))
    }

    /// Shrinks rates to their significant part and includes the possible drift of slow rotations in the sigmas.
    fn significant_part(&self, from_frames: f64, to_frames: f64, rates: &Rates) -> [Estimate; 3] {
        let Rates { px, share, turn } = *rates;
        let likely_px = self.likely_drift_px(from_frames, to_frames);
        let possible = likely_px.map_or([0.0; 2], |likely_px| {
            possible_drift(px, likely_px, if turn.is_some() { Source::Subsets } else { Source::Outlines })
        });
        let shrink = |Estimate { value, sigma }: Estimate, possible: f64| {
            let widened = share.sqrt() * sigma.hypot((1.0 - share) * value);
            Estimate { value: share * value, sigma: widened.hypot((1.0 - share).sqrt() * possible) }
        };
        let turns_deg = |px: f64| self.apparent_rotation_deg(px, from_frames, to_frames);
        let outlined = || Estimate { value: 0.0, sigma: turns_deg(px[0].value.hypot(px[1].value)) };
        let turn = shrink(turn.unwrap_or_else(outlined), turns_deg(possible[0].hypot(possible[1])));
        [shrink(px[0], possible[0]), shrink(px[1], possible[1]), turn]
    }

    /// Returns the significant drift, or the prior spread where neither outlines nor steps determine it.
    pub fn expected(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 3]> {
        self.significant(from_frames, to_frames).or_else(|| self.prior_drift(from_frames, to_frames))
    }

    /// Returns the prior of the drift between two times: zero, with the spread over all balls.
    fn prior_drift(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 3]> {
        let sigma = ROTATING_SHARE.sqrt() * self.likely_drift_px(from_frames, to_frames)?;
        let turn = self.apparent_rotation_deg(sigma, from_frames, to_frames);
        Some([sigma, sigma, turn].map(|sigma| Estimate { value: 0.0, sigma }))
    }

    /// Returns the apparent in-plane rotation of a ball whose front drifts by `drift_px`, deg: uneven or occluded
    /// patterns mistake one for the other.
    fn apparent_rotation_deg(&self, drift_px: f64, from_frames: f64, to_frames: f64) -> f64 {
        let lopsided =
            (HALF_OCCLUDED_ROTATION * self.occluded_fraction(from_frames, to_frames)).hypot(UNEVEN_PATTERN_ROTATION);
        if self.radius_px > 0.0 { (lopsided * drift_px / self.radius_px).to_degrees() } else { 0.0 }
    }

    /// Returns the mean occluded fraction of the ball between two times, 0 to 1.
    fn occluded_fraction(&self, from_frames: f64, to_frames: f64) -> f64 {
        let speeds = within(&self.speeds, from_frames, to_frames, |speed| speed.time_frames);
        speeds.iter().map(|speed| speed.occluded_fraction).sum::<f64>() / speeds.len().max(1) as f64
    }

    /// Returns the drift of a ball that rotates out of the plane as fast as it moves, px per frame: the mean speed of
    /// its surface between two times.
    fn likely_drift_px(&self, from_frames: f64, to_frames: f64) -> Option<f64> {
        let speeds = within(&self.speeds, from_frames, to_frames, |speed| speed.time_frames);
        (!speeds.is_empty()).then(|| speeds.iter().map(|speed| speed.px).sum::<f64>() / speeds.len() as f64)
    }

    /// Returns the possible distance of a centre from its propagated position, px, for an unobserved drift since its
    /// nearest outline.
    pub fn center_uncertainty_px(&self, node: &Pose, here: &LocalDrift) -> f64 {
        let after = partition_point(&self.outlines, |outline| outline[0].time_frames < node.time_frames);
        let near =
            [after.checked_sub(1), Some(after)].map(|at| self.outlines.get(at?).map(|outline| outline[0].time_frames));
        let gap = near.iter().flatten().map(|time| (time - node.time_frames).abs()).fold(f64::INFINITY, f64::min);
        let [x, y, _] = here.drift;
        if gap.is_finite() { gap * x.sigma.max(y.sigma) } else { 0.0 }
    }

    /// Returns the standard uncertainty of a node's angle from out-of-plane rotation, deg: the significant apparent
    /// rotation since the first node, times the significant share of the drift `here`. Without either it is 0.
    pub fn angle_uncertainty_deg(&self, node: &Pose, here: &LocalDrift) -> f64 {
        let sums = self.sums.sums();
        let count = partition_point(sums, |sum| sum[0].time_frames < node.time_frames);
        let (Some([_, _, turn]), Some(rates)) = (sums.get(count), here.rates) else { return 0.0 };
        rates.share * significant_deviation(turn.value, turn.sigma.hypot(turn.walk * (count as f64).sqrt()))
    }

    /// Returns the interval of uniform drift around a node. Without frames of the regime it is inverted.
    ///
    /// A body struck unobserved rotates about another axis afterwards. Where steps scatter, only near ones are used.
    fn uniform_interval(&self, node: &Pose, regime: Regime) -> UniformInterval {
        let (from, to) = drift_window(node, regime);
        if from > to {
            return UniformInterval { from_frames: from, to_frames: to, scatter: [0.0; 3], lines: None };
        }
        let (about, mut reach) = (node.time_frames.clamp(from, to), to - from);
        loop {
            let (from_frames, to_frames) = (from.max(about - reach), to.min(about + reach));
            let lines = self.fit_lines(from_frames, to_frames);
            let scatter = lines.as_ref().map_or([0.0; 3], |lines| self.step_scatter(from_frames, to_frames, lines));
            if scatter.iter().all(|off| *off <= 0.0) || reach < 2.0 * NARROW_FRAMES {
                return UniformInterval { from_frames, to_frames, scatter, lines };
            }
            reach *= 0.5;
        }
    }

    /// Returns the drift at a node as far as it is known: from the interval of uniform drift around it.
    ///
    /// In contact, the drift of the flight before is used, and its sigma includes the change of the spin.
    pub fn local_drift(&self, node: &Pose, regime: Regime) -> LocalDrift {
        let UniformInterval { from_frames, to_frames, scatter, lines } = self.uniform_interval(node, regime);
        let rates = self.combined_rates(from_frames, to_frames, lines.as_ref());
        let drift = rates.map(|rates| self.significant_part(from_frames, to_frames, &rates));
        let drift = drift.or_else(|| self.prior_drift(from_frames, to_frames)).unwrap_or([NO_DRIFT; 3]);
        // A contact changes a spin, at an unobserved moment.
        let is_touching = matches!(regime, Regime::Contact { .. });
        let changed = if is_touching { 0.5 } else { 0.0 };
        let now = is_touching.then(|| self.momentary_drift(node.time_frames)).flatten();
        let drift = std::array::from_fn(|axis| {
            let Estimate { value, sigma } = drift[axis];
            let apart = now.map_or(0.0, |now| significant_deviation(now[axis].value - value, now[axis].sigma));
            Estimate { value, sigma: sigma.hypot(changed * value).hypot(scatter[axis]).hypot(apart) }
        });
        LocalDrift { from_frames, to_frames, scatter, rates, drift }
    }

    /// Returns the drift by the few steps around a time, px, px and deg per frame.
    fn momentary_drift(&self, time_frames: f64) -> Option<[Estimate; 3]> {
        let (from, to) = (time_frames - 2.0 * NARROW_FRAMES, time_frames + 2.0 * NARROW_FRAMES);
        self.drift_by_steps(from, to, &self.fit_lines(from, to)?)
    }

    /// Returns the rates of the centre, where they differ from those of the pose.
    pub fn apply_to_rates(rates: PixelRates, here: &LocalDrift) -> PixelRates {
        let [x, y, theta] = here.drift;
        PixelRates {
            x: add_estimates(rates.x, x),
            y: add_estimates(rates.y, y),
            theta: add_estimates(rates.theta, theta),
            ..rates
        }
    }

    /// Returns the ball's step from a node on, where it differs from the pose's.
    ///
    /// A step that an impact falls into has a drift of its own, unlike those before and after.
    pub fn apply_to_step(step: RigidStep, own: Option<[Estimate; 3]>, here: &LocalDrift) -> RigidStep {
        let drift = here.drift;
        let differs = |own: &[Estimate; 3]| {
            let pull = |axis: usize| (own[axis].value - drift[axis].value) / own[axis].sigma.hypot(drift[axis].sigma);
            pull(0).hypot(pull(1)).hypot(pull(2)) > STRUCK_SIGMAS
        };
        let [x, y, turn] = own.filter(differs).unwrap_or(drift);
        RigidStep {
            dx_px: step.dx_px + x.value,
            dy_px: step.dy_px + y.value,
            dtheta_deg: step.dtheta_deg + turn.value,
            sigma_dx_px: step.sigma_dx_px.hypot(x.sigma),
            sigma_dy_px: step.sigma_dy_px.hypot(y.sigma),
            sigma_dtheta_deg: step.sigma_dtheta_deg.hypot(turn.sigma),
            ..step
        }
    }

    /// Returns the centre at a node, where it significantly leaves the poses.
    ///
    /// Where outlines do not follow a line, only those near the moment are used.
    pub fn center(&self, node: &Pose, here: &LocalDrift) -> Option<Center> {
        let LocalDrift { from_frames: from, to_frames: to, scatter, .. } = *here;
        let rates = here.rates?;
        if rates.share < SURE_SHARE || from > to {
            return None;
        }
        let (about, mut reach) = (node.time_frames.clamp(from, to), to - from);
        let (mut near, mut px) = ((from, to), rates.px);
        loop {
            let (center, rms_px) = self.center_by_outlines(node, near, px)?;
            let is_uniform = rms_px <= NONUNIFORM_SIGMAS * center.sigma_px;
            if is_uniform || reach < 2.0 * NARROW_FRAMES {
                let sigma_px = if is_uniform { center.sigma_px } else { center.sigma_px.hypot(rms_px) };
                // The moment between two outlines at which the drift changed is unknown.
                let sigma_change_px = NARROW_FRAMES * scatter[0].hypot(scatter[1]);
                return Some(Center { sigma_px: sigma_px.hypot(sigma_change_px), ..center });
            }
            reach *= 0.5;
            near = (from.max(about - reach), to.min(about + reach));
            px = self
                .combined_rates(near.0, near.1, self.fit_lines(near.0, near.1).as_ref())
                .map_or([NO_DRIFT; 2], |rates| rates.px);
        }
    }

    /// Widens the sigma of a centre by its distance from the nearest outline.
    pub fn widened(&self, node: &Pose, center: Center) -> Center {
        let after = partition_point(&self.outlines, |outline| outline[0].time_frames < node.time_frames);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| self.outlines.get(at));
        let gap = |outline: &&[Sample; 2]| (outline[0].time_frames - node.time_frames).abs();
        let near = near.filter(|outline| outline[0].component == node.component && gap(outline) <= NARROW_FRAMES);
        let Some([x, y]) = near.min_by(|a, b| gap(a).total_cmp(&gap(b))) else { return center };
        let offset = [center.x_px - node.pose[0] - x.value, center.y_px - node.pose[1] - y.value];
        let deviation_px = significant_deviation(offset[0].hypot(offset[1]), center.sigma_px.hypot(x.sigma));
        Center { sigma_px: center.sigma_px.hypot(deviation_px), ..center }
    }

    /// Returns the centre at a node by the outlines between two times and the drift `rates` then, px per frame, and the
    /// rms deviation of the outlines from their line, px.
    ///
    /// Without an outline in the interval, the last one before its end is used; `None` if there is none.
    fn center_by_outlines(&self, node: &Pose, span_frames: (f64, f64), rates: [Estimate; 2]) -> Option<(Center, f64)> {
        let (from, to) = span_frames;
        let before = partition_point(&self.outlines, |outline| outline[0].time_frames <= to);
        let near = match self.outlines_between(from, to) {
            [] => self.outlines.get(before.checked_sub(1)?..before)?,
            near => near,
        };
        let count = near.len() as f64;
        let middle = near.iter().map(|outline| outline[0].time_frames).sum::<f64>() / count;
        let extrapolate = |axis: usize| {
            let mean = near.iter().map(|outline| outline[axis].value).sum::<f64>() / count;
            let deviation = |outline: &[Sample; 2]| {
                outline[axis].value - mean - rates[axis].value * (outline[axis].time_frames - middle)
            };
            let rms = (near.iter().map(|outline| deviation(outline).powi(2)).sum::<f64>() / count).sqrt();
            let since = node.time_frames - middle;
            let sigma = (near.iter().map(|outline| outline[axis].sigma.powi(2)).sum::<f64>() / count).sqrt();
            // The errors of a film's outlines are correlated, so they do not average.
            (mean + rates[axis].value * since, sigma.max(rms).hypot(rates[axis].sigma * since), rms)
        };
        let ((x, sigma_x, rms_x), (y, sigma_y, rms_y)) = (extrapolate(0), extrapolate(1));
        let center = Center { x_px: node.pose[0] + x, y_px: node.pose[1] + y, sigma_px: sigma_x.max(sigma_y) };
        Some((center, rms_x.max(rms_y)))
    }
}

/// Returns the sum of two independent estimates.
fn add_estimates(a: Estimate, b: Estimate) -> Estimate {
    Estimate { value: a.value + b.value, sigma: a.sigma.hypot(b.sigma) }
}

/// Returns the size of a deviation if it exceeds noise of this sigma, else zero.
fn significant_deviation(off: f64, sigma: f64) -> f64 {
    if off.abs() > CHANCE_SIGMAS * sigma { off.abs() } else { 0.0 }
}

/// Returns the mean of two independent estimates of one quantity, weighted by their inverse variances.
fn weighted_mean(a: Estimate, b: Estimate) -> Estimate {
    let (of_a, of_b) = (a.sigma.powi(-2), b.sigma.powi(-2));
    Estimate { value: (of_a * a.value + of_b * b.value) / (of_a + of_b), sigma: (of_a + of_b).powf(-0.5) }
}

/// Returns the interval whose outlines determine the drift at a node, frames.
///
/// During contact, it is that of the flight before.
fn drift_window(node: &Pose, regime: Regime) -> (f64, f64) {
    let frame = node.frame;
    let (from, to) = match regime {
        Regime::Flight { from, to } => (from.max(frame.saturating_sub(BACK_FRAMES)), to.min(frame + AHEAD_FRAMES)),
        Regime::Contact { from, .. } => (from.saturating_sub(BACK_FRAMES), from.saturating_sub(1)),
        Regime::Unknown => (frame.saturating_sub(BACK_FRAMES), frame + AHEAD_FRAMES),
    };
    let time = |at: u64| node.time_frames + at as f64 - frame as f64;
    (time(from) - 0.5, time(to) + 0.5)
}

/// Fits a line through samples with correlated errors, and returns it with the factor by which the correlation widens
/// its sigmas.
fn fit_line(samples: &[Sample]) -> Option<(Polynomial, f64)> {
    let middle = 0.5 * (samples.first()?.time_frames + samples.last()?.time_frames);
    let fit = Polynomial::fit(samples, middle, 1, 0.0)?;
    let residual = |sample: &Sample| fit.residual(sample).map_or(0.0, |(residual, sigma)| residual / sigma);
    let residuals: Vec<f64> = samples.iter().map(residual).collect();
    let square: f64 = residuals.iter().map(|residual| residual * residual).sum();
    let next: f64 = residuals.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let correlation = if square > 0.0 { (next / square).clamp(0.0, MAX_CORRELATION) } else { 0.0 };
    // Of n samples with this correlation, only this share is independent.
    Some((fit, ((1.0 + correlation) / (1.0 - correlation)).sqrt()))
}

#[cfg(test)]
mod tests;
