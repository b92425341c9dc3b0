//! The quantities of a collision from the nodes around its contact.

use super::contact::Contact;
use super::contact_law::{ContactEstimates, Family};
use super::departure::plausible_curves;
use super::free_fall::{free_fall_acceleration, shift_sigma};
use super::interval::{Flights, ImpactContext, Interval, MAX_SPIN_SIGMA_RAD, scaled};
use super::model_selection::{ForceLawPosterior, InitialGuess, PositionErrors, select_law};
use super::quantities::{assemble_impact, rate_at, slip_end};
use super::trajectory::{ANGLE, NORMAL, SurfaceNode, TANGENTIAL, has_measured_rotation, nodes_between, samples};
use crate::numeric::{Polynomial, Sample};
use crate::results::{Estimate, Impact, PointStatus, RigidStep};

/// The maximum length of a flight on either side, frames.
pub(super) const FLIGHT_FRAMES: f64 = 128.0;
/// The minimum number of nodes of a flight.
const FLIGHT_MIN_NODES: usize = 4;
/// The maximum lead of the detected end over the real one, frames.
const EARLY_FRAMES: f64 = 4.0;
/// The error of the deepest moment under a free stiffness, as a share of the contact.
///
/// Simulated ripples of 25 % cause 0.002. Forces that change abruptly as the velocity reverses caused up to 0.02 in films
/// of an independent ray tracer.
const FREE_TURN: f64 = 0.01;
/// The number of nodes that the deepest moment is fitted to where no law is accepted.
const DEEPEST_NODES: usize = 9;
/// The uncertainty of the turning point below which a contact has turned, frames.
const CERTAIN_TURN_FRAMES: f64 = 0.5;
/// The difference of two results of one moment that chance explains, sigmas.
const CHANCE_SIGMAS: f64 = 1.0;
/// The error of a contact law's results where outlines place the body, relative to their noise.
///
/// The shadow at the contact and the flattened side move all outlines of a contact alike, so their errors do not average.
/// In a film of an independent ray tracer they were 7 to 20 times the noise.
const OUTLINE_ERROR: f64 = 6.0;
/// The restitution or energy of a collision with a fixed surface contradicts it beyond this, sigmas.
const CONTRADICTION_SIGMAS: f64 = 5.0;
/// The difference between measured and known gravity that is always allowed, as a fraction: the scale may be off.
const GRAVITY_TOLERANCE: f64 = 0.5;
/// The uncertainty of start and end where only the later flight is known, frames.
const DETECTED_SIGMA_FRAMES: f64 = 1.0;

/// Measures a contact that has ended, from the nodes up to `known_to_frames`.
///
/// The velocities on both sides are linear fits with gravity through the flights, extrapolated to start and end.
/// Restitution and impulses follow from them. Start, deepest point, end, compression and acceleration come from the
/// contact laws. Returns `None` where a flight is too short for a velocity.
pub fn solve(
    nodes: &[SurfaceNode],
    contact: &Contact,
    known_to_frames: f64,
    context: &ImpactContext,
) -> Option<Impact> {
    let end = contact.end_frames?;
    let first = contact.flight_from_frames.max(contact.start_frames - FLIGHT_FRAMES);
    let last = known_to_frames.min(end + FLIGHT_FRAMES);
    let nodes = nodes_between(nodes, first, last);
    let detected = detected_interval(nodes, contact, end);
    let flights = fit_flights(nodes, &detected, context)?;
    let posterior = initial_guess(nodes, &detected, &flights, context)
        .and_then(|guess| select_law(&guess, &samples(nodes, NORMAL), position_errors(&flights, &detected, context)));
    // A law that leaves the moments open says nothing.
    let posterior = posterior.filter(|posterior| {
        let contact = &posterior.contact;
        contact.start.sigma.max(contact.end.sigma) < contact.duration.value.max(1.0)
    });
    let interval = posterior.as_ref().map_or(detected, |posterior| law_interval(posterior, detected.deepest));
    let flights = match &posterior {
        // A law may put the end so late that no flight after it exists yet.
        Some(_) => fit_flights(nodes, &interval, context)?,
        None => flights,
    };
    // Where the body was not seen, nothing tests the law.
    let outline_factor = if is_placed_by_outlines(nodes, &detected) { OUTLINE_ERROR } else { 1.0 };
    let factor = outline_factor / measured_fraction(nodes, &interval);
    let interval = if posterior.is_some() { interval.widened(factor) } else { interval };
    let posterior = posterior.map(|posterior| posterior.widened(factor));
    let mut impact = assemble_impact(&interval, &flights, posterior.as_ref(), context);
    let sides = [
        nodes_between(nodes, f64::NEG_INFINITY, interval.before_to),
        nodes_between(nodes, interval.after_from, f64::INFINITY),
    ];
    impact.gravity_m_s2 = free_fall_acceleration(&sides, context.gravity_px, context.center_sigma_px)
        .filter(|_| context.is_surface_fixed)
        .map(|a| context.acceleration(a));
    impact.status = physical_status(&impact, context);
    impact.slip_end_s = slip_end(nodes, &interval, &flights, context).map(|t| scaled(t, context.period_s, 0.0));
    Some(impact)
}

/// Returns the errors of the positions around a contact.
///
/// The point that is followed circles about the centre of a body that turns, so that an error of the centre drifts.
fn position_errors(flights: &Flights, interval: &Interval, context: &ImpactContext) -> PositionErrors {
    let spin = |flight: &[Polynomial; 3], at: Estimate| {
        let rate = flight[ANGLE].rate(at.value);
        if rate.sigma < MAX_SPIN_SIGMA_RAD { rate.value.abs() } else { 0.0 }
    };
    let mean_spin = 0.5 * (spin(&flights.before, interval.start) + spin(&flights.after, interval.end));
    let lasts = (interval.end.value - interval.start.value).max(1.0);
    PositionErrors {
        excess: flights.before[NORMAL].excess().max(flights.after[NORMAL].excess()),
        drift_px: mean_spin * context.center_sigma_px * lasts / 12.0_f64.sqrt(),
    }
}

/// Whether outlines place the body during contact: no measured rotation links its nodes.
fn is_placed_by_outlines(nodes: &[SurfaceNode], interval: &Interval) -> bool {
    let contact = nodes_between(nodes, interval.start.value - 1.0, interval.end.value + 1.0);
    !has_measured_rotation(contact)
}

/// Returns the fraction of the frames of a contact in which the body was measured, 0 to 1.
fn measured_fraction(nodes: &[SurfaceNode], interval: &Interval) -> f64 {
    let (start, end) = (interval.start.value, interval.end.value);
    let measured = nodes_between(nodes, start, end).len() as f64 + 1.0;
    (measured / (end - start).max(1.0)).min(1.0)
}

/// Returns `Outlier` for a collision that contradicts physics: a fixed surface gives no energy, and bodies fall by
/// gravity.
///
/// The surface then moves, as a racket does, or the scale or the frame rate is wrong.
fn physical_status(impact: &Impact, context: &ImpactContext) -> PointStatus {
    let exceeds = |excess: Estimate| excess.value > CONTRADICTION_SIGMAS * excess.sigma;
    let is_driven = impact.restitution.is_some_and(|e| exceeds(Estimate { value: e.value - 1.0, ..e }));
    let known =
        context.acceleration(Estimate { value: context.gravity_px[0].hypot(context.gravity_px[1]), sigma: 0.0 });
    let contradicts_gravity = impact.gravity_m_s2.is_some_and(|g| {
        let difference = (g.value - known.value).abs() - GRAVITY_TOLERANCE * known.value;
        exceeds(Estimate { value: difference, sigma: g.sigma.max(known.sigma) })
    });
    if is_driven || contradicts_gravity { PointStatus::Outlier } else { PointStatus::Valid }
}

/// Returns the interval of contact as the detector found it, ended at `end` (frames), before any law is fitted.
fn detected_interval(nodes: &[SurfaceNode], contact: &Contact, end: f64) -> Interval {
    // Where frames are missing around a limit, it lies anywhere in the gap.
    let gap = |at: f64| {
        let i = nodes.partition_point(|n| n.time_frames < at);
        match (i.checked_sub(1).and_then(|i| nodes.get(i)), nodes.get(i)) {
            (Some(a), Some(b)) => (b.time_frames - a.time_frames - 1.0).max(0.0) / 12.0_f64.sqrt(),
            _ => 0.0,
        }
    };
    let newest = nodes.last().map_or(end, |n| n.time_frames);
    let estimate = |at: f64| Estimate { value: at, sigma: DETECTED_SIGMA_FRAMES.hypot(gap(at)) };
    Interval {
        start: estimate(contact.start_frames),
        deepest: turning_point(nodes_between(nodes, contact.start_frames, end)),
        end: Estimate { sigma: 2.0 * estimate(end).sigma, ..estimate(end) },
        before_to: contact.flight_to_frames,
        before_last: contact.departed_frames - 1.5,
        // The end was detected by a small force, not by none: the first half of a short flight may still be curved.
        after_from: end + (0.5 * (newest - end)).clamp(0.0, EARLY_FRAMES),
    }
}

/// Returns the deepest moment of a contact that may still last, frames; `None` until enough nodes lie after it.
pub fn deepest_so_far(nodes: &[SurfaceNode], contact: &Contact) -> Option<Estimate> {
    let contact = nodes_between(nodes, contact.start_frames, f64::INFINITY);
    let (at, _) = contact.iter().enumerate().min_by(|a, b| a.1.value[NORMAL].total_cmp(&b.1.value[NORMAL]))?;
    let is_past = at > 0 && at + DEEPEST_NODES / 2 < contact.len();
    is_past.then(|| turning_point(contact)).flatten().filter(|turn| turn.sigma < CERTAIN_TURN_FRAMES)
}

/// Finds the zero of the normal velocity, frames, by a cubic through the nodes around the deepest one.
///
/// `None` where the nodes do not curve significantly, or the zero lies far from the deepest node.
fn turning_point(contact: &[SurfaceNode]) -> Option<Estimate> {
    let (at, node) = contact.iter().enumerate().min_by(|a, b| a.1.value[NORMAL].total_cmp(&b.1.value[NORMAL]))?;
    let near = &contact[at.saturating_sub(DEEPEST_NODES / 2)..(at + DEEPEST_NODES / 2 + 1).min(contact.len())];
    let fit = Polynomial::fit(&samples(near, NORMAL), node.time_frames, 3, 0.0)?;
    let (rate, curvature) = (fit.rate(node.time_frames), fit.curvature());
    if curvature.value <= 3.0 * curvature.sigma {
        return None;
    }
    let shift = rate.value / curvature.value;
    // A zero far from the deepest node means that frames are missing there.
    (shift.abs() <= DEEPEST_NODES as f64).then(|| Estimate {
        value: node.time_frames - shift,
        sigma: fit.excess() * (rate.sigma / curvature.value).hypot(shift * curvature.sigma / curvature.value).max(0.02),
    })
}

/// Returns the part of a difference that its standard uncertainty does not explain.
///
/// A law fixes the deepest moment by the whole contact, the positions around it by themselves. Real forces follow no
/// law exactly, and the difference shows by how much.
fn beyond_chance(difference: f64, sigma: f64) -> f64 {
    (difference.powi(2) - (CHANCE_SIGMAS * sigma).powi(2)).max(0.0).sqrt()
}

/// Returns the interval of contact by the contact laws. `turned` is the turning point found without a law.
fn law_interval(posterior: &ForceLawPosterior, turned: Option<Estimate>) -> Interval {
    let ContactEstimates { start, mut deepest, end, duration, .. } = posterior.contact;
    if matches!(posterior.best, Family::Stiffness { .. }) {
        // No law passes: the positions around the turn may constrain it better than a stiffness that follows all of
        // them.
        deepest = turned.filter(|turned| turned.sigma < deepest.sigma).unwrap_or(deepest);
        deepest.sigma = deepest.sigma.hypot(FREE_TURN * duration.value);
    }
    if let Some(turned) = turned {
        deepest.sigma = deepest.sigma.hypot(beyond_chance(deepest.value - turned.value, turned.sigma));
    }
    Interval {
        start,
        deepest: Some(deepest),
        end,
        before_to: start.value - (2.0 * start.sigma).max(0.5),
        before_last: start.value,
        after_from: end.value + (2.0 * end.sigma).max(0.5),
    }
}

/// Fits a flight with the acceleration of gravity (px/frame^2), or with its own where the flight contradicts gravity.
///
/// `None` for too few nodes.
fn fit_flight(flight: &[Sample], gravity: f64) -> Option<Polynomial> {
    if flight.len() < FLIGHT_MIN_NODES {
        return None;
    }
    plausible_curves(flight, Some(gravity)).into_iter().next()
}

/// Fits the flights on both sides of the contact: normal, tangent and angle. `None` where one is too short.
fn fit_flights(nodes: &[SurfaceNode], interval: &Interval, context: &ImpactContext) -> Option<Flights> {
    let three = |nodes: &[SurfaceNode]| {
        let fit = |k: usize, g: f64| fit_flight(&samples(nodes, k), g);
        let [normal, tangential] = [NORMAL, TANGENTIAL].map(|k| fit(k, context.gravity_px[k]));
        // Without anything on the body that turns visibly, positions still give its velocity.
        let angle = if has_measured_rotation(nodes) {
            fit(ANGLE, 0.0)
        } else {
            // The angle of a body whose rotation was not measured.
            let any = RigidStep::ANY_ROTATION_DEG.to_radians();
            nodes.first().map(|node| Polynomial::unknown(node.time_frames, any))
        };
        Some([normal?, tangential?, angle?])
    };
    // A short flight is used up to nearly its first or last node of contact rather than not at all.
    let ends = [interval.before_to, interval.before_last - 4.0, interval.before_last];
    let before = ends.iter().find_map(|to| three(nodes_between(nodes, f64::NEG_INFINITY, *to)))?;
    let begins = [interval.after_from, interval.end.value + interval.end.sigma, interval.end.value + 0.5];
    let after = begins.iter().find_map(|from| three(nodes_between(nodes, *from, f64::INFINITY)))?;
    let sides = [
        nodes_between(nodes, f64::NEG_INFINITY, interval.before_to),
        nodes_between(nodes, interval.after_from, f64::INFINITY),
    ];
    let shift_sigmas = sides.map(|side| shift_sigma(side, context.center_sigma_px));
    Some(Flights { before, after, shift_sigmas })
}

/// Returns the initial guess for the laws: the deepest node and its distance from the flight before.
///
/// `None` for a body that does not approach, rebound and compress.
fn initial_guess(
    nodes: &[SurfaceNode],
    interval: &Interval,
    flights: &Flights,
    context: &ImpactContext,
) -> Option<InitialGuess> {
    let speed = -rate_at(&flights.before[NORMAL], interval.start).value;
    let after = rate_at(&flights.after[NORMAL], interval.end).value;
    // A contact of one or two frames may lie between its uncertain moments.
    let (start, end) = (interval.start.value - interval.start.sigma, interval.end.value + interval.end.sigma);
    let contact = nodes_between(nodes, start, end);
    let offset = contact.first()?.value[NORMAL];
    // Components are linked by extrapolated poses here, which is good enough for a guess.
    let deepest = contact.iter().min_by(|a, b| a.value[NORMAL].total_cmp(&b.value[NORMAL]))?;
    let first = contact.first()?.time_frames;
    let passed_px = -flights.before[NORMAL].advance(first, deepest.time_frames).value;
    let shortfall = passed_px - (offset - deepest.value[NORMAL]);
    let usable = speed > 0.0 && after > 0.0 && shortfall > 0.0;
    usable.then_some(InitialGuess {
        deepest: deepest.time_frames,
        shortfall,
        speed,
        restitution: after / speed,
        gravity: -context.gravity_px[NORMAL],
    })
}
