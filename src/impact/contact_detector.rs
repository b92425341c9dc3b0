//! Online detection of contact.

use std::collections::VecDeque;

use super::contact_onset::{fit_onset, time_reversed};
use super::departure::{Departure, drift, plausible_curves, residual, test_departure};
use super::force_free::{EndOfForce, FreeFlight, find_force_free, fit_acceleration, test_force_free};
use super::trajectory::{NORMAL, SurfaceNode, nodes_between, samples, turning_sigma};
use crate::motion::Regime;
use crate::numeric::Sample;
use crate::results::{Estimate, Phase};

/// The minimum distance from the flight's curve that counts as a departure, sigmas.
const OFF_SIGMAS: f64 = 6.0;
/// The number of consecutive departed positions, all to one side, that make a departure.
const OFF_FRAMES: u32 = 3;
/// The number of frames after which a departure that still fits a jump is dismissed as one.
const JUMP_FRAMES: u32 = 8;
/// The number of frames after which a departure that a drift of the centre explains is dismissed as one.
const DRIFT_FRAMES: u32 = 12;
/// The minimum approach speed of a collision, sigmas.
const APPROACH_SIGMAS: f64 = 6.0;
/// The maximum number of flight nodes that a new node is compared with.
const FLIGHT_NODES: usize = 48;
/// The minimum number of flight nodes that a new node is compared with.
const FLIGHT_MIN_NODES: usize = 6;
/// The newest nodes that the fit of the flight leaves out, so that a slow onset does not bend it.
const GUARD_NODES: usize = 4;
/// Frames between the first departed node and the end of what is certainly flight.
const CERTAIN_FRAMES: f64 = 9.0;
/// The length of the flight before the first departed node that the onset is fitted to, frames.
const ONSET_FRAMES: f64 = 15.0;
/// The number of nodes in the running fit of the acceleration.
const ACCELERATION_NODES: usize = 7;
/// The maximum lead of the force-free stretch over the end of the force, frames.
const QUIET_EARLY_FRAMES: f64 = 4.0;
/// Frames since the start of the force-free stretch at which the end is estimated again.
const END_AGAIN_FRAMES: [u32; 4] = [10, 14, 18, 26];
/// The minimum number of nodes kept in flight; fewer than twice as many are stored.
const KEPT_NODES: usize = 256;
/// The maximum number of nodes of a contact and the flight before it.
const MAX_NODES: usize = 4096;
/// The number of changes of regime that are kept.
const KEPT_BREAKS: usize = 16;

/// A detected contact before any law is fitted. Times in frames since the stream's first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The start of the known flight before the contact.
    pub flight_from_frames: f64,
    /// The end of what is certainly flight.
    pub flight_to_frames: f64,
    /// The onset of the force, by the hinge fit.
    pub start_frames: f64,
    /// The first node off the flight's curve.
    pub departed_frames: f64,
    /// The normal velocity before contact, px/frame.
    pub approach: Estimate,
    /// The peak normal acceleration so far, px/frame^2.
    pub acceleration_max: f64,
    /// The start of the flight after the contact; `None` while the contact lasts.
    pub end_frames: Option<f64>,
}

/// The effect of a new node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// No change.
    None,
    /// A contact was detected.
    Began,
    /// The end of the contact was detected.
    Ended,
    /// The contact was withdrawn: there was none, or it never ends.
    Dismissed,
}

/// A change of the motion's regime.
#[derive(Debug, Clone, Copy)]
struct Break {
    from: u64,
    /// The first frame after a contact; `from` where the flight only restarts.
    to: Option<u64>,
    /// Frames from here on were published as "after contact" before a later `to` was known.
    published_after: Option<u64>,
    speed: f64,
    acceleration: f64,
}

impl Break {
    fn is_contact(&self) -> bool {
        self.to != Some(self.from)
    }
}

/// Consecutive nodes on one side of the flight's curve.
#[derive(Debug, Clone, Copy)]
struct Departing {
    /// The time of the first of them.
    from_frames: f64,
    /// -1 or 1.
    side: f64,
    nodes: u32,
}

/// A contact detector for the normal coordinate of one body.
///
/// In flight, each new position is compared with the parabola through the flight so far (gravity known). Three
/// consecutive positions more than six sigmas to the outer side, of a body that approaches the surface, are a contact.
/// The contact ends when the acceleration has returned to gravity's. No threshold is in px.
#[derive(Debug, Clone)]
pub struct Detector {
    nodes: Vec<SurfaceNode>,
    /// The lag of published rows.
    lag_frames: u64,
    flight_from: f64,
    /// The undecided departure from the flight.
    departing: Option<Departing>,
    contact: Option<Contact>,
    /// The start of the force-free stretch after a contact, and the frames since then.
    quiet: Option<(f64, u32)>,
    breaks: VecDeque<Break>,
}

impl Detector {
    /// Creates a detector without any node. Rows of frames older than `lag_frames` are published.
    pub fn new(lag_frames: u64) -> Self {
        Self {
            nodes: Vec::new(),
            lag_frames,
            flight_from: f64::NEG_INFINITY,
            departing: None,
            contact: None,
            quiet: None,
            breaks: VecDeque::new(),
        }
    }

    /// Returns the stored nodes in order of time.
    pub fn nodes(&self) -> &[SurfaceNode] {
        &self.nodes
    }

    /// Returns the current contact, or the last one until [`Detector::release`].
    pub fn contact(&self) -> Option<&Contact> {
        self.contact.as_ref()
    }

    /// Discards the last contact and the nodes kept for it.
    pub fn release(&mut self) {
        if self.contact.is_some_and(|c| c.end_frames.is_some()) {
            self.contact = None;
        }
    }

    /// Whether a contact, or an undecided departure, may be acting on the body.
    pub fn may_be_in_contact(&self) -> bool {
        self.departing.is_some() || self.contact.is_some_and(|c| c.end_frames.is_none())
    }

    /// Adds the next node and returns its effect. `gravity` is along the normal, px/frame^2; `None` without a scale.
    pub fn add_node(&mut self, node: SurfaceNode, gravity: Option<f64>) -> Event {
        self.nodes.push(node);
        match self.contact {
            Some(contact) if contact.end_frames.is_none() => self.check_for_end(contact, gravity.unwrap_or(0.0)),
            _ => {
                self.discard_old_nodes();
                self.refine_end(gravity);
                self.check_for_contact(gravity)
            }
        }
    }

    /// Discards the oldest nodes, but none of a contact or of the flight before it.
    fn discard_old_nodes(&mut self) {
        let keep_from = self.contact.map(|c| c.flight_from_frames);
        let old = self.nodes.len().saturating_sub(KEPT_NODES);
        let old = keep_from.map_or(old, |t| old.min(self.nodes.partition_point(|n| n.time_frames < t)));
        // In blocks, because every removal moves all later nodes.
        if old >= KEPT_NODES {
            self.nodes.drain(..old);
        }
    }

    /// Tests whether the newest node has departed from the flight, and whether the departure is a contact.
    ///
    /// A departure inwards, of a body that does not approach, or like a jump restarts the flight.
    fn check_for_contact(&mut self, gravity: Option<f64>) -> Event {
        let first = self.nodes.partition_point(|n| n.time_frames < self.flight_from);
        let end = match self.departing {
            Some(departing) => self.nodes.partition_point(|n| n.time_frames < departing.from_frames),
            None => self.nodes.len() - 1,
        };
        let end = end.saturating_sub(GUARD_NODES).max(first);
        let from = first.max(end.saturating_sub(FLIGHT_NODES));
        let flight = samples(&self.nodes[from..end], NORMAL);
        if flight.len() < FLIGHT_MIN_NODES {
            return Event::None;
        }
        let since = samples(&self.nodes[end..], NORMAL);
        let tested = test_departure(&flight, &since, gravity, turning_sigma(&self.nodes[from..]));
        let Some(Departure { sigmas, certain_sigmas, rate }) = tested else { return Event::None };
        if sigmas.abs() <= OFF_SIGMAS {
            self.departing = None;
            return Event::None;
        }
        let departing = self.departing_to(sigmas.signum());
        if departing.nodes < OFF_FRAMES {
            return Event::None;
        }
        if certain_sigmas.abs() <= OFF_SIGMAS {
            // The centre of a turning body may drift so far. A contact departs ever faster.
            if departing.nodes >= DRIFT_FRAMES {
                self.restart_flight(departing.from_frames);
            }
            return Event::None;
        }
        let is_approaching = rate.value < -APPROACH_SIGMAS * rate.sigma;
        if departing.side < 0.0 || !is_approaching {
            self.restart_flight(departing.from_frames);
            return Event::None;
        }
        self.decide_departure(departing, &flight, rate, gravity)
    }

    /// Adds the newest node to the departure, or begins another one to this `side`.
    fn departing_to(&mut self, side: f64) -> Departing {
        let departing = match self.departing {
            Some(before) if before.side * side > 0.0 => Departing { nodes: before.nodes + 1, ..before },
            _ => Departing { from_frames: self.nodes[self.nodes.len() - 1].time_frames, side, nodes: 1 },
        };
        self.departing = Some(departing);
        departing
    }

    /// Begins a contact if an approaching body departs gradually, as a force moves it. A jump restarts the flight.
    fn decide_departure(
        &mut self,
        departing: Departing,
        flight: &[Sample],
        rate: Estimate,
        gravity: Option<f64>,
    ) -> Event {
        let Departing { from_frames, nodes, .. } = departing;
        let first = self.nodes.partition_point(|n| n.time_frames < self.flight_from);
        let back = self.nodes.partition_point(|n| n.time_frames < from_frames - ONSET_FRAMES).max(first);
        let recent = samples(&self.nodes[back..], NORMAL);
        let curve = plausible_curves(flight, gravity).into_iter().next();
        match curve.and_then(|curve| fit_onset(&curve, &recent, from_frames)) {
            Some(onset) if !onset.gradual && nodes < JUMP_FRAMES => Event::None,
            Some(onset) if !onset.gradual => {
                self.restart_flight(from_frames);
                Event::None
            }
            onset => {
                // Without a common offset (lost frames), the onset lies anywhere between the last node and this one.
                let between = 0.5 * (flight[flight.len() - 1].time_frames + from_frames);
                self.begin_contact(onset.map_or(between, |onset| onset.start_frames), from_frames, rate);
                Event::Began
            }
        }
    }

    /// Restarts the flight at `from_frames`, after a release or a wrong step.
    fn restart_flight(&mut self, from_frames: f64) {
        self.flight_from = from_frames;
        self.departing = None;
        let from = self.frame_at(from_frames);
        self.store_break(Break { from, to: Some(from), published_after: None, speed: 0.0, acceleration: 0.0 });
    }

    /// Begins a contact. `approach` is the normal velocity before it, px/frame.
    fn begin_contact(&mut self, start_frames: f64, departed_frames: f64, approach: Estimate) {
        (self.departing, self.quiet) = (None, None);
        let first = self.nodes.partition_point(|n| n.time_frames < self.flight_from);
        let flight_from_frames = self.nodes[first].time_frames;
        self.contact = Some(Contact {
            flight_from_frames,
            flight_to_frames: departed_frames - CERTAIN_FRAMES,
            start_frames,
            departed_frames,
            approach,
            acceleration_max: 0.0,
            end_frames: None,
        });
        let from = self.frame_at(start_frames);
        self.store_break(Break {
            from,
            to: None,
            published_after: None,
            speed: approach.value.abs(),
            acceleration: 0.0,
        });
    }

    /// Tests whether the force of the contact has ended; `gravity` along the normal, px/frame^2.
    ///
    /// A contact that never ends, or after which the body still approaches, is dismissed.
    fn check_for_end(&mut self, mut contact: Contact, gravity: f64) -> Event {
        let since = samples(nodes_between(&self.nodes, contact.start_frames, f64::INFINITY), NORMAL);
        let newest = &since[since.len().saturating_sub(ACCELERATION_NODES)..];
        if let Some(acceleration) = fit_acceleration(newest) {
            contact.acceleration_max = contact.acceleration_max.max(acceleration.value - gravity);
        }
        self.contact = Some(contact);
        if let Some(b) = self.breaks.back_mut() {
            b.acceleration = contact.acceleration_max;
        }
        let flight = match test_force_free(&since, gravity, contact.acceleration_max) {
            EndOfForce::Ended(flight) => Some(flight),
            EndOfForce::Acting => None,
            EndOfForce::Undecided => {
                find_force_free(nodes_between(&self.nodes, contact.departed_frames, f64::INFINITY), gravity)
            }
        };
        if let Some(FreeFlight { start_frames: from, rate }) = flight {
            if rate.value < -APPROACH_SIGMAS * rate.sigma {
                // Free of force but still approaching: it was no collision.
                return self.dismiss(from);
            }
            contact.end_frames = Some(from);
            self.contact = Some(contact);
            self.set_end(from);
            self.quiet = Some((from, since.iter().filter(|s| s.time_frames >= from).count() as u32));
            return Event::Ended;
        }
        if self.nodes.len() >= MAX_NODES { self.dismiss(since[since.len() - 1].time_frames) } else { Event::None }
    }

    /// Sets the end of the contact, or corrects it, and restarts the flight there.
    fn set_end(&mut self, end_frames: f64) {
        self.flight_from = end_frames;
        let (to, newest) = (self.frame_at(end_frames), self.nodes[self.nodes.len() - 1].frame);
        if let Some(b) = self.breaks.back_mut() {
            // Frames this old have been published already.
            let was_published = b.to.filter(|before| before + self.lag_frames < newest);
            b.published_after = b.published_after.or(was_published);
            b.to = Some(to.max(b.from + 1));
        }
        if let Some(contact) = &mut self.contact {
            contact.end_frames = Some(end_frames);
        }
    }

    /// Counts a frame after a contact and, at [`END_AGAIN_FRAMES`], estimates the end of the force again.
    ///
    /// The curve of the flight after the contact is followed backwards in time. The end is where the nodes leave it.
    /// The previous end stays if the flight is too short or no node leaves the curve.
    fn refine_end(&mut self, gravity: Option<f64>) {
        let Some((from, count)) = self.quiet else { return };
        let count = count + 1;
        self.quiet = (count < END_AGAIN_FRAMES[3] && self.departing.is_none()).then_some((from, count));
        let Some(contact) = self.contact.filter(|_| END_AGAIN_FRAMES.contains(&count)) else { return };
        let flight = nodes_between(&self.nodes, from + QUIET_EARLY_FRAMES, f64::INFINITY);
        let (after, turning_sigma) = (samples(flight, NORMAL), turning_sigma(flight));
        let all = time_reversed(&samples(nodes_between(&self.nodes, contact.start_frames, f64::INFINITY), NORMAL));
        let curve = plausible_curves(&time_reversed(&after), gravity).into_iter().next();
        let Some(curve) = curve.filter(|_| after.len() >= FLIGHT_MIN_NODES) else { return };
        let is_off = |s: &&crate::numeric::Sample| {
            let drift = drift(turning_sigma, (from + QUIET_EARLY_FRAMES + s.time_frames).max(0.0));
            residual(&curve, &[], s).is_some_and(|r| r.value > OFF_SIGMAS * r.sigma.hypot(drift))
        };
        let Some(departed) = all.iter().find(is_off).map(|s| s.time_frames) else { return };
        let near = &all[..all.partition_point(|s| s.time_frames <= departed + 2.0)];
        if let Some(o) = fit_onset(&curve, near, departed) {
            self.set_end(-o.start_frames);
        }
    }

    /// Withdraws the contact and restarts the flight at `from_frames`.
    fn dismiss(&mut self, from_frames: f64) -> Event {
        self.contact = None;
        self.breaks.pop_back();
        self.restart_flight(from_frames);
        self.discard_old_nodes();
        Event::Dismissed
    }

    /// Returns the sequence number of the first node at or after a time.
    fn frame_at(&self, time_frames: f64) -> u64 {
        let i = self.nodes.partition_point(|n| n.time_frames < time_frames).min(self.nodes.len() - 1);
        self.nodes[i].frame
    }

    /// Stores a change of regime and discards the oldest beyond [`KEPT_BREAKS`].
    fn store_break(&mut self, new: Break) {
        if self.breaks.len() == KEPT_BREAKS {
            self.breaks.pop_front();
        }
        self.breaks.push_back(new);
    }

    /// Returns the known regime of the motion at a frame. The first flight starts at 0, the newest ends at `u64::MAX`.
    pub fn regime(&self, frame: u64) -> Regime {
        let next = self.breaks.partition_point(|b| b.from <= frame);
        let to = self.breaks.get(next).map_or(u64::MAX, |b| b.from.saturating_sub(1));
        match next.checked_sub(1).map(|i| self.breaks[i]) {
            None => Regime::Flight { from: 0, to },
            Some(b) => match b.to {
                Some(end) if frame >= end => Regime::Flight { from: end, to },
                _ => Regime::Contact { speed_px: b.speed, acceleration_px: b.acceleration, from: b.from, to: b.to },
            },
        }
    }

    /// Returns the phase at a frame: flight, contact or rebound, as known by now.
    pub fn phase(&self, frame: u64) -> Phase {
        let newest = self.breaks.iter().rev().find(|b| b.from <= frame);
        // A contact that was published as ended is not published as lasting again.
        let is_over = newest.and_then(|b| b.published_after).is_some_and(|after| after <= frame);
        match self.regime(frame) {
            Regime::Contact { .. } if !is_over => Phase::Contact,
            _ if self.breaks.iter().any(|b| b.is_contact() && b.from <= frame) => Phase::Rebound,
            _ => Phase::Flight,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The detector's events for these positions, with up to 4 sigmas of noise, and the frame of each.
    fn events(frames: u64, position: impl Fn(f64) -> f64) -> (Vec<(u64, Event)>, Detector) {
        events_of_turning(frames, 0.0, position)
    }

    /// The same for a body whose centre adds this uncertainty to its velocity while it turns, px/frame.
    fn events_of_turning(
        frames: u64,
        turning_sigma: f64,
        position: impl Fn(f64) -> f64,
    ) -> (Vec<(u64, Event)>, Detector) {
        let (mut detector, sigma) = (Detector::new(20), 1.3e-3);
        let mut events = Vec::new();
        for frame in 0..frames {
            let noise = sigma * ((frame * 37 % 17) as f64 - 8.0) / 5.0;
            let value = [position(frame as f64) + noise, 0.0, 0.0];
            let node = SurfaceNode {
                frame,
                time_frames: frame as f64,
                component: 0,
                turn: 0,
                value,
                sigma: [sigma; 3],
                walk_share: [0.0; 3],
                turning_sigma,
            };
            match detector.add_node(node, Some(0.0)) {
                Event::None => (),
                event => events.push((frame, event)),
            }
        }
        (events, detector)
    }

    #[test]
    fn a_blow_that_leaves_a_body_on_its_way_in_is_no_contact_for_good() {
        // The contact is detected late, when no force is left to detect.
        let creeps = |t: f64| -2.58 * t + 2e-5 * (t - 17.0).clamp(0.0, 9.0).powi(3) + 0.0044 * (t - 26.0).max(0.0);
        let (was_published, detector) = events(80, creeps);
        let [(began, Event::Began), (over, Event::Dismissed)] = was_published[..] else { panic!("{was_published:?}") };
        assert!(over < began + 26 && detector.phase(79) == Phase::Flight, "{was_published:?}");
    }

    #[test]
    fn a_contact_that_is_gentle_and_long_lasts_until_it_is_over() {
        // Half a period of 300 frames, from a speed of 0.5 px/frame on.
        let omega = std::f64::consts::PI / 300.0;
        let position = |t: f64| match t - 40.0 {
            since if since <= 0.0 => -0.5 * since,
            since if since <= 300.0 => -0.5 * (omega * since).sin() / omega,
            since => 0.5 * (since - 300.0),
        };
        let (was_published, _) = events(400, position);
        let [(began, Event::Began), (over, Event::Ended)] = was_published[..] else { panic!("{was_published:?}") };
        assert!(began < 80 && (336..360).contains(&over), "{was_published:?}");
    }

    /// A ball that falls for 48 frames, and whose velocity changes after 16 by the error of its centre.
    fn drifts(jump_px: f64) -> impl Fn(f64) -> f64 {
        move |t| {
            let away = (t - 48.0).max(0.0);
            -1.4 * t + jump_px * (t - 16.0).max(0.0) + 0.12 * away.min(5.0).powi(2) + 1.2 * (away - 5.0).max(0.0)
        }
    }

    #[test]
    fn a_velocity_that_changes_by_the_error_of_the_centre_begins_no_contact() {
        let (certain, _) = events(64, drifts(0.012));
        assert!(certain.first().is_some_and(|(frame, _)| *frame < 40), "without an error it is none: {certain:?}");
        let (turning, _) = events_of_turning(64, 0.01, drifts(0.012));
        let [(began, Event::Began), ..] = turning[..] else { panic!("{turning:?}") };
        assert!((49..56).contains(&began), "{turning:?}");
    }
}
