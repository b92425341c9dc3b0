//! How the outline of a body leaves the pose that its pattern leads to.

use super::rotation_prior::{TURNS, unseen};
use crate::motion::{Center, Node, PixelRates, Regime, Sums};
use crate::numeric::{Polynomial, Sample};
use crate::results::{BodyStep, Circle, Estimate, RigidStep};

/// Fewest outlines whose word is taken.
const LEAST_SEEN: usize = 3;
/// Drift of fewer sigmas may be chance: outlines see light and ground, which a pattern does not.
const CHANCE_SIGMAS: f64 = 3.5;
/// A step whose own drift is off by so many is another: there are many steps.
const STRUCK_SIGMAS: f64 = 5.0;
/// How far off the drift of steps may be: a share of it, and of the speed, which a lens bends.
const UNEVEN: f64 = 0.01;
const BENT: f64 = 0.001;
/// From such a share on the outlines tell the centre, not the poses.
const SURE_SHARE: f64 = 0.5;
/// What is off by so many of its sigmas, rms, is not even: steps beside one drift, outlines beside a line.
const UNEVEN_SIGMAS: f64 = 2.5;
/// Those within so many frames are asked whatever they are off.
const NARROW: f64 = 4.0;
/// So many frames before and after a moment tell the drift there, in flight.
const BACK: u64 = 128;
const AHEAD: u64 = 14;
/// Outlines kept: the longest contact that is followed, and the flights beside it.
const KEPT: usize = 4608;
/// Outlines may be alike in their errors from frame to frame up to here.
const MOST_ALIKE: f64 = 0.9;
/// A ball of which a half is in sight, whose front moves by a share of the radius, seems to turn by so much of half of that.
const LOPSIDED: f64 = 0.4;
/// And so does one in full sight, whose paint is not even.
const PATCHY: f64 = 0.03;
/// What is off in all steps of a ball that is hidden, as a share of their sigmas: see `docs/studies.md`.
const LEAN: f64 = 0.3;

const NONE: Estimate = Estimate { value: 0.0, sigma: 0.0 };

/// Centres of outlines beside carried poses.
///
/// The pattern of a ball that turns about an axis in the picture's plane moves with its front, faster than its centre or
/// slower; its outline does not.
#[derive(Debug, Clone, Default)]
pub struct Drift {
    seen: Vec<[Sample; 2]>,
    /// What steps say of it: each, and summed.
    steps: Vec<Moved>,
    sums: Sums<3>,
    /// How far the surface of a ball moves a frame, by steps: on its way and by its spin.
    way: Vec<Way>,
    radius_px: f64,
    /// What is off in all steps, as a share of their sigmas.
    lean: f64,
}

#[derive(Debug, Clone, Copy)]
struct Way {
    time_frames: f64,
    px: f64,
    /// Share of the ball that was out of sight.
    hidden: f64,
}

/// By how much a frame a ball moves and turns beside its step, px, px and deg.
#[derive(Debug, Clone, Copy)]
struct Moved {
    time_frames: f64,
    drift: [Estimate; 3],
    speed_px: f64,
}

/// Lines through what steps sum up to between two times, px, px and deg, and the sums.
type Lines = [(Polynomial, Vec<Sample>); 3];

/// The drift a frame between two times.
#[derive(Debug, Clone, Copy)]
struct Rates {
    /// Along x and y, px, ...
    px: [Estimate; 2],
    /// ... and the share of it that is no chance.
    share: f64,
    /// Of the angle, deg, where steps tell it.
    turn: Option<Estimate>,
}

/// What is known of the drift at a node.
#[derive(Debug, Clone, Copy)]
pub struct Here {
    /// From when to when one drift tells it.
    from_frames: f64,
    to_frames: f64,
    /// How far it is off even then, px, px and deg a frame.
    scatter: [f64; 3],
    rates: Option<Rates>,
    /// As far as it is sure, px, px and deg a frame.
    drift: [Estimate; 3],
}

impl Drift {
    /// Of a ball that a camera films whose rows are exposed one after the other, or all at once.
    pub fn new(is_rolling: bool) -> Self {
        Self { lean: if is_rolling { 1.0 } else { 0.0 }, ..Self::default() }
    }

    /// Takes the outline found in a node's frame.
    pub fn push(&mut self, node: &Node, circle: &Circle) {
        let sigma = circle.sigma_center_px;
        let apart = [circle.x_px - node.pose[0], circle.y_px - node.pose[1]];
        if !(sigma > 0.0 && sigma.is_finite() && apart.iter().all(|apart| apart.is_finite())) {
            return;
        }
        self.radius_px = circle.radius_px;
        let (time_frames, component) = (node.time_frames, node.component);
        keep(&mut self.seen, apart.map(|value| Sample { time_frames, component, value, sigma, walk: 0.0 }));
    }

    /// Takes what the step from a frame on shows of it.
    pub fn push_step(&mut self, time_frames: f64, step: &BodyStep) {
        let Some(moved) = step.step else { return };
        let speed_px = moved.dx_px.hypot(moved.dy_px);
        if let Some(circle) = &step.circle {
            self.radius_px = circle.radius_px;
            let px = speed_px.hypot(circle.radius_px * moved.dtheta_deg.to_radians());
            let hidden = (1.0 - circle.visible_fraction).clamp(0.0, 1.0);
            if px.is_finite() && hidden.is_finite() {
                keep(&mut self.way, Way { time_frames, px, hidden });
            }
        }
        self.sums.push(step, time_frames, step.drift);
        if let Some(drift) = step.drift {
            keep(&mut self.steps, Moved { time_frames, drift, speed_px });
        }
    }

    /// What steps say of the drift between two times, px, px and deg a frame.
    fn by_steps(&self, from_frames: f64, to_frames: f64, lines: &Lines) -> Option<[Estimate; 3]> {
        let bent = self.bent(from_frames, to_frames)?;
        let steps = within(&self.steps, from_frames, to_frames, |step| step.time_frames);
        let lean = self.lean.hypot(LEAN * self.hidden(from_frames, to_frames)) / steps.len().max(1) as f64;
        Some(std::array::from_fn(|axis| {
            let fit = &lines[axis].0;
            let rate = fit.rate(from_frames);
            let sigma = (rate.sigma * fit.excess()).hypot(UNEVEN * rate.value).hypot(bent[axis]);
            let off = lean * steps.iter().map(|step| step.drift[axis].sigma).sum::<f64>();
            Estimate { sigma: sigma.hypot(off), ..rate }
        }))
    }

    fn lines(&self, from_frames: f64, to_frames: f64) -> Option<Lines> {
        let sums = self.sums.between(from_frames, to_frames);
        let middle = 0.5 * (sums.first()?[0].time_frames + sums.last()?[0].time_frames);
        let line = |axis: usize| {
            let sums: Vec<Sample> = sums.iter().map(|sums| sums[axis]).collect();
            Some((Polynomial::fit(&sums, middle, 1, 0.0)?, sums))
        };
        Some([line(0)?, line(1)?, line(2)?])
    }

    /// What a lens may make of a motion, px, px and deg a frame.
    fn bent(&self, from_frames: f64, to_frames: f64) -> Option<[f64; 3]> {
        let steps = within(&self.steps, from_frames, to_frames, |step| step.time_frames);
        let count = (!steps.is_empty()).then_some(steps.len())? as f64;
        let bent_px = BENT * steps.iter().map(|step| step.speed_px).sum::<f64>() / count;
        Some([bent_px, bent_px, 0.0])
    }

    /// How far the drift of steps between two times scatters where it is not even, rms, px, px and deg.
    fn scatter(&self, from_frames: f64, to_frames: f64, lines: &Lines) -> [f64; 3] {
        let steps = within(&self.steps, from_frames, to_frames, |step| step.time_frames);
        let off = |axis: usize| {
            let bent = self.bent(from_frames, to_frames)?[axis];
            let (fit, sums) = &lines[axis];
            // A drift that changes by a share over the whole time bends their sum by an eighth of what that comes to.
            let bends = 0.125 * (to_frames - from_frames) * bent.hypot(UNEVEN * fit.rate(from_frames).value);
            let pull =
                |sum: &Sample| fit.residual(sum).map_or(0.0, |(left, sigma)| (left / sigma.hypot(bends)).powi(2));
            let is_even = sums.iter().map(pull).sum::<f64>() <= UNEVEN_SIGMAS.powi(2) * fit.freedom() as f64;
            let count = steps.len().max(1) as f64;
            let mean = steps.iter().map(|step| step.drift[axis].value).sum::<f64>() / count;
            let square = steps.iter().map(|step| (step.drift[axis].value - mean).powi(2)).sum::<f64>() / count;
            Some(if is_even || fit.freedom() == 0 { 0.0 } else { square.sqrt() })
        };
        [0, 1, 2].map(|axis| off(axis).unwrap_or(0.0))
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

    fn rates(&self, from_frames: f64, to_frames: f64, lines: Option<&Lines>) -> Option<Rates> {
        let steps = lines.and_then(|lines| self.by_steps(from_frames, to_frames, lines));
        let px = match (self.by_outlines(from_frames, to_frames), steps) {
            (Some(outlines), Some(steps)) => std::array::from_fn(|axis| both(outlines[axis], steps[axis])),
            (outlines, steps) => outlines.or(steps.map(|[x, y, _]| [x, y]))?,
        };
        // Along both axes at once, as one length.
        let square: f64 = px.iter().map(|rate| (rate.value / rate.sigma).powi(2)).sum();
        let share = (1.0 - (CHANCE_SIGMAS * CHANCE_SIGMAS / square).powi(2)).max(0.0);
        Some(Rates { px, share, turn: steps.map(|[_, _, turn]| turn) })
    }

    /// By how much a frame a ball surely leaves its pose between two times, along x and y, px, and its angle, deg: 0 where it
    /// may be chance. `None` where too little is seen.
    pub fn surely(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 3]> {
        let rates = self.rates(from_frames, to_frames, self.lines(from_frames, to_frames).as_ref())?;
        Some(self.told(from_frames, to_frames, &rates))
    }

    fn told(&self, from_frames: f64, to_frames: f64, rates: &Rates) -> [Estimate; 3] {
        let Rates { px, share, turn } = *rates;
        let likely_px = self.likely_px(from_frames, to_frames);
        let unseen = likely_px.map_or([0.0; 2], |likely_px| unseen(px, likely_px, turn.is_some()));
        let told = |Estimate { value, sigma }: Estimate, unseen: f64| {
            let told = share.sqrt() * sigma.hypot((1.0 - share) * value);
            Estimate { value: share * value, sigma: told.hypot((1.0 - share).sqrt() * unseen) }
        };
        let turns_deg = |px: f64| self.turns_deg(px, from_frames, to_frames);
        let outlined = || Estimate { value: 0.0, sigma: turns_deg(px[0].value.hypot(px[1].value)) };
        let turn = told(turn.unwrap_or_else(outlined), turns_deg(unseen[0].hypot(unseen[1])));
        [told(px[0], unseen[0]), told(px[1], unseen[1]), turn]
    }

    /// The same, or as unsure as balls turn where neither outlines nor steps tell.
    pub fn supposed(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 3]> {
        self.surely(from_frames, to_frames).or_else(|| self.likely(from_frames, to_frames))
    }

    fn likely(&self, from_frames: f64, to_frames: f64) -> Option<[Estimate; 3]> {
        let sigma = TURNS.sqrt() * self.likely_px(from_frames, to_frames)?;
        let turn = self.turns_deg(sigma, from_frames, to_frames);
        Some([sigma, sigma, turn].map(|sigma| Estimate { value: 0.0, sigma }))
    }

    /// By how much a ball seems to turn whose front moves by so many px, deg.
    fn turns_deg(&self, drift_px: f64, from_frames: f64, to_frames: f64) -> f64 {
        let lopsided = (LOPSIDED * self.hidden(from_frames, to_frames)).hypot(PATCHY);
        if self.radius_px > 0.0 { (lopsided * drift_px / self.radius_px).to_degrees() } else { 0.0 }
    }

    /// Share of the ball that is out of sight between two times.
    fn hidden(&self, from_frames: f64, to_frames: f64) -> f64 {
        let way = within(&self.way, from_frames, to_frames, |way| way.time_frames);
        way.iter().map(|way| way.hidden).sum::<f64>() / way.len().max(1) as f64
    }

    /// By how much a frame a ball may leave its pose that turns as fast as it moves, px.
    fn likely_px(&self, from_frames: f64, to_frames: f64) -> Option<f64> {
        let way = within(&self.way, from_frames, to_frames, |way| way.time_frames);
        (!way.is_empty()).then(|| way.iter().map(|way| way.px).sum::<f64>() / way.len() as f64)
    }

    /// How far a centre may be from where it is carried to, px: it is not seen how it drifts since its nearest outline.
    pub fn astray(&self, node: &Node, here: &Here) -> f64 {
        let after = self.seen.partition_point(|seen| seen[0].time_frames < node.time_frames);
        let near = [after.checked_sub(1), Some(after)].map(|at| self.seen.get(at?).map(|seen| seen[0].time_frames));
        let away = near.iter().flatten().map(|time| (time - node.time_frames).abs()).fold(f64::INFINITY, f64::min);
        let [x, y, _] = here.drift;
        if away.is_finite() { away * x.sigma.max(y.sigma) } else { 0.0 }
    }

    /// How far the angle of a node may be from the ball's own, deg: by what its steps surely turn beside it, since it was first
    /// seen.
    pub fn twisted(&self, node: &Node, here: &Here) -> f64 {
        let seen = self.sums.seen();
        let at = seen.partition_point(|sums| sums[0].time_frames < node.time_frames);
        let (Some([_, _, turn]), Some(rates)) = (seen.get(at), here.rates) else { return 0.0 };
        rates.share * beyond(turn.value, turn.sigma.hypot(turn.walk * (at as f64).sqrt()))
    }

    /// From when to when one drift tells what happens at a node, and how far it is off even there, px.
    ///
    /// A body that was struck unseen turns about another axis from then on: steps that scatter tell nothing of a moment
    /// far from them, and those about it are asked alone.
    fn even(&self, node: &Node, regime: Regime) -> ((f64, f64), [f64; 3], Option<Lines>) {
        let (from, to) = window(node, regime);
        if from > to {
            return ((from, to), [0.0; 3], None);
        }
        let (about, mut reach) = (node.time_frames.clamp(from, to), to - from);
        loop {
            let near = (from.max(about - reach), to.min(about + reach));
            let lines = self.lines(near.0, near.1);
            let scatter = lines.as_ref().map_or([0.0; 3], |lines| self.scatter(near.0, near.1, lines));
            if scatter.iter().all(|off| *off <= 0.0) || reach < 2.0 * NARROW {
                return (near, scatter, lines);
            }
            reach *= 0.5;
        }
    }

    /// What is known of it at a node.
    pub fn here(&self, node: &Node, regime: Regime) -> Here {
        let ((from_frames, to_frames), scatter, lines) = self.even(node, regime);
        let rates = self.rates(from_frames, to_frames, lines.as_ref());
        let told = rates.map(|rates| self.told(from_frames, to_frames, &rates));
        let told = told.or_else(|| self.likely(from_frames, to_frames)).unwrap_or([NONE; 3]);
        // A contact changes a spin, and how soon is not seen.
        let is_touching = matches!(regime, Regime::Contact { .. });
        let changed = if is_touching { 0.5 } else { 0.0 };
        let now = is_touching.then(|| self.now(node.time_frames)).flatten();
        let drift = std::array::from_fn(|axis| {
            let Estimate { value, sigma } = told[axis];
            let apart = now.map_or(0.0, |now| beyond(now[axis].value - value, now[axis].sigma));
            Estimate { value, sigma: sigma.hypot(changed * value).hypot(scatter[axis]).hypot(apart) }
        });
        Here { from_frames, to_frames, scatter, rates, drift }
    }

    /// What the steps about a moment say.
    fn now(&self, time_frames: f64) -> Option<[Estimate; 3]> {
        let (from, to) = (time_frames - 2.0 * NARROW, time_frames + 2.0 * NARROW);
        self.by_steps(from, to, &self.lines(from, to)?)
    }

    /// The rates of the centre, where those of the pose are others.
    pub fn taken(rates: PixelRates, here: &Here) -> PixelRates {
        let [x, y, theta] = here.drift;
        PixelRates { x: sum(rates.x, x), y: sum(rates.y, y), theta: sum(rates.theta, theta), ..rates }
    }

    /// The step of the ball from a node on, where that of the pose is another.
    ///
    /// Where a blow falls into it, its own drift is none of those before and after.
    pub fn stepped(step: RigidStep, own: Option<[Estimate; 3]>, here: &Here) -> RigidStep {
        let told = here.drift;
        let off = |own: &[Estimate; 3]| {
            let pull = |axis: usize| (own[axis].value - told[axis].value) / own[axis].sigma.hypot(told[axis].sigma);
            pull(0).hypot(pull(1)).hypot(pull(2)) > STRUCK_SIGMAS
        };
        let [x, y, turn] = own.filter(off).unwrap_or(told);
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

    /// The centre at a node, where it surely leaves the poses.
    ///
    /// Outlines that no line goes through tell nothing of a moment far from them, either.
    pub fn center(&self, node: &Node, here: &Here) -> Option<Center> {
        let Here { from_frames: from, to_frames: to, scatter, .. } = *here;
        let rates = here.rates?;
        if rates.share < SURE_SHARE || from > to {
            return None;
        }
        let (about, mut reach) = (node.time_frames.clamp(from, to), to - from);
        let (mut near, mut px) = ((from, to), rates.px);
        loop {
            let (center, off) = self.along(node, near, px)?;
            let even = off <= UNEVEN_SIGMAS * center.sigma_px;
            if even || reach < 2.0 * NARROW {
                let sigma_px = if even { center.sigma_px } else { center.sigma_px.hypot(off) };
                // When the drift changed between two outlines is not seen.
                let unsure = NARROW * scatter[0].hypot(scatter[1]);
                return Some(Center { sigma_px: sigma_px.hypot(unsure), ..center });
            }
            reach *= 0.5;
            near = (from.max(about - reach), to.min(about + reach));
            px = self.rates(near.0, near.1, self.lines(near.0, near.1).as_ref()).map_or([NONE; 2], |rates| rates.px);
        }
    }

    /// A centre at a node, as unsure as it is off the outline nearest to it.
    pub fn beside(&self, node: &Node, center: Center) -> Center {
        let after = self.seen.partition_point(|seen| seen[0].time_frames < node.time_frames);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| self.seen.get(at));
        let away = |seen: &&[Sample; 2]| (seen[0].time_frames - node.time_frames).abs();
        let near = near.filter(|seen| seen[0].component == node.component && away(seen) <= NARROW);
        let Some([x, y]) = near.min_by(|a, b| away(a).total_cmp(&away(b))) else { return center };
        let off = [center.x_px - node.pose[0] - x.value, center.y_px - node.pose[1] - y.value];
        let off_px = beyond(off[0].hypot(off[1]), center.sigma_px.hypot(x.sigma));
        Center { sigma_px: center.sigma_px.hypot(off_px), ..center }
    }

    /// The centre at a node by outlines between two times and the drift then, and what these are off the line through them, rms, px.
    fn along(&self, node: &Node, (from, to): (f64, f64), rates: [Estimate; 2]) -> Option<(Center, f64)> {
        let before = self.seen.partition_point(|seen| seen[0].time_frames <= to);
        let near = match self.between(from, to) {
            [] => self.seen.get(before.checked_sub(1)?..before)?,
            near => near,
        };
        let count = near.len() as f64;
        let middle = near.iter().map(|seen| seen[0].time_frames).sum::<f64>() / count;
        let at = |axis: usize| {
            let mean = near.iter().map(|seen| seen[axis].value).sum::<f64>() / count;
            let left =
                |seen: &[Sample; 2]| seen[axis].value - mean - rates[axis].value * (seen[axis].time_frames - middle);
            let off = (near.iter().map(|seen| left(seen).powi(2)).sum::<f64>() / count).sqrt();
            let away = node.time_frames - middle;
            // Outlines of a film err alike.
            (mean + rates[axis].value * away, near[0][axis].sigma.hypot(rates[axis].sigma * away), off)
        };
        let ((x, sigma_x, off_x), (y, sigma_y, off_y)) = (at(0), at(1));
        let center = Center { x_px: node.pose[0] + x, y_px: node.pose[1] + y, sigma_px: sigma_x.max(sigma_y) };
        Some((center, off_x.max(off_y)))
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

/// What is more than chance, else nothing.
fn beyond(off: f64, sigma: f64) -> f64 {
    if off.abs() > CHANCE_SIGMAS * sigma { off.abs() } else { 0.0 }
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
mod tests;
