//! Online detection of contact in nodes at one interval.

use super::contact::Contact;
use super::contact_onset::{fit_onset, time_reversed};
use super::departure::{Departure, drift, plausible_curves, residual, test_departure};
use super::force_free::{EndOfForce, FreeFlight, find_force_free, fit_acceleration, test_force_free};
use super::trajectory::{NORMAL, SurfaceNode, nodes_between, samples, turning_sigma};
use crate::numeric::Sample;
use crate::results::Estimate;

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
/// The share of the speed of approach that a slow contact must have taken before it is one.
const BRAKED_SHARE: f64 = 0.2;
/// The minimum number of nodes kept in flight; fewer than twice as many are stored.
const KEPT_NODES: usize = 256;
/// The maximum number of nodes of a contact and the flight before it.
const MAX_NODES: usize = 4096;
/// The effect of a new node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Change {
    /// No change.
    None,
    /// The flight restarts at this time: the body was released, or a step was wrong.
    Restarted {
        from: f64,
        /// Whether the motion changed, at whatever interval it is watched.
        is_release: bool,
    },
    /// A contact was detected.
    Began,
    /// The end of the contact was detected, or estimated again.
    Ended { is_new: bool },
    /// The contact was withdrawn: there was none, or it never ends. The flight restarts at this time.
    Dismissed { from: f64 },
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

/// The watch over the normal coordinate of one body, in every `stride`-th frame.
///
/// In flight, each new position is compared with the parabola through the flight so far (gravity known). Three
/// consecutive positions more than six sigmas to the outer side, of a body that approaches the surface, are a contact.
/// The contact ends when the acceleration has returned to gravity's. No threshold is in px, and the unit of time is the
/// interval of the nodes.
#[derive(Debug, Clone)]
pub(super) struct FlightWatch {
    stride: u32,
    nodes: Vec<SurfaceNode>,
    flight_from: f64,
    /// The undecided departure from the flight.
    departing: Option<Departing>,
    contact: Option<Contact>,
    /// The start of the force-free stretch after a contact, and the nodes since then.
    quiet: Option<(f64, u32)>,
}

impl FlightWatch {
    /// Creates a watch without any node.
    pub(super) fn new(stride: u32) -> Self {
        Self { stride, nodes: Vec::new(), flight_from: f64::NEG_INFINITY, departing: None, contact: None, quiet: None }
    }

    /// Returns the stored nodes in order of time.
    pub(super) fn nodes(&self) -> &[SurfaceNode] {
        &self.nodes
    }

    /// Returns the current contact, or the last one until [`Self::release`].
    pub(super) fn contact(&self) -> Option<&Contact> {
        self.contact.as_ref()
    }

    /// Discards the last contact and the nodes kept for it.
    pub(super) fn release(&mut self) {
        if self.contact.is_some_and(|c| c.end_frames.is_some()) {
            self.contact = None;
        }
    }

    /// Whether a contact lasts.
    pub(super) fn is_in_contact(&self) -> bool {
        self.contact.is_some_and(|c| c.end_frames.is_none())
    }

    /// Whether a contact, or an undecided departure, may be acting on the body.
    pub(super) fn may_be_in_contact(&self) -> bool {
        self.departing.is_some() || self.is_in_contact()
    }

    /// Adds the next node. Discards the oldest ones, but none during a contact.
    pub(super) fn add_node(&mut self, node: SurfaceNode) {
        self.nodes.push(node);
        if !self.is_in_contact() {
            self.discard_old_nodes();
        }
    }

    /// Tests whether a contact begins or ends with the newest node. `gravity` is along the normal, px/node^2; `None`
    /// without a scale.
    pub(super) fn test_newest(&mut self, gravity: Option<f64>) -> Change {
        match self.contact {
            Some(contact) if contact.end_frames.is_none() => self.check_for_end(contact, gravity.unwrap_or(0.0)),
            _ => self.check_for_contact(gravity),
        }
    }

    /// Restarts the flight at a time, after a contact or a release that another watch detected.
    pub(super) fn restart(&mut self, from: f64) {
        (self.contact, self.departing, self.quiet) = (None, None, None);
        self.flight_from = from;
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
    fn check_for_contact(&mut self, gravity: Option<f64>) -> Change {
        let first = self.nodes.partition_point(|n| n.time_frames < self.flight_from);
        let end = match self.departing {
            Some(departing) => self.nodes.partition_point(|n| n.time_frames < departing.from_frames),
            None => self.nodes.len() - 1,
        };
        let end = end.saturating_sub(GUARD_NODES).max(first);
        let from = first.max(end.saturating_sub(FLIGHT_NODES));
        let flight = samples(&self.nodes[from..end], NORMAL);
        if flight.len() < FLIGHT_MIN_NODES {
            return Change::None;
        }
        let since = samples(&self.nodes[end..], NORMAL);
        let tested = test_departure(&flight, &since, gravity, turning_sigma(&self.nodes[from..]));
        let Some(Departure { sigmas, certain_sigmas, rate }) = tested else { return Change::None };
        if sigmas.abs() <= OFF_SIGMAS {
            self.departing = None;
            return Change::None;
        }
        let departing = self.departing_to(sigmas.signum());
        if departing.nodes < OFF_FRAMES {
            return Change::None;
        }
        if certain_sigmas.abs() <= OFF_SIGMAS {
            // The centre of a turning body may drift so far. A contact departs ever faster.
            if departing.nodes >= DRIFT_FRAMES {
                return self.restart_flight(departing.from_frames, false);
            }
            return Change::None;
        }
        let is_approaching = rate.value < -APPROACH_SIGMAS * rate.sigma;
        if departing.side < 0.0 || !is_approaching {
            return self.restart_flight(departing.from_frames, true);
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
    ) -> Change {
        let Departing { from_frames, nodes, .. } = departing;
        let first = self.nodes.partition_point(|n| n.time_frames < self.flight_from);
        let back = self.nodes.partition_point(|n| n.time_frames < from_frames - ONSET_FRAMES).max(first);
        let recent = samples(&self.nodes[back..], NORMAL);
        let curve = plausible_curves(flight, gravity).into_iter().next();
        match curve.and_then(|curve| fit_onset(&curve, &recent, from_frames)) {
            Some(onset) if !onset.gradual && nodes < JUMP_FRAMES => Change::None,
            Some(onset) if !onset.gradual => self.restart_flight(from_frames, false),
            _ if !self.has_braked(from_frames, rate) => Change::None,
            onset => {
                // Without a common offset (lost frames), the onset lies anywhere between the last node and this one.
                let between = 0.5 * (flight[flight.len() - 1].time_frames + from_frames);
                self.begin_contact(onset.map_or(between, |onset| onset.start_frames), from_frames, rate);
                Change::Began
            }
        }
    }

    /// Whether the body has lost much of its speed of approach since a time.
    ///
    /// Over long intervals, drag and perspective bend a flight as well. In single frames nothing but a force does.
    fn has_braked(&self, from: f64, approach: Estimate) -> bool {
        let since = &self.nodes[self.nodes.partition_point(|n| n.time_frames < from)..];
        let (Some(first), Some(last)) = (since.first(), since.last()) else { return false };
        let mean_speed = (last.value[NORMAL] - first.value[NORMAL]) / (last.time_frames - first.time_frames);
        self.stride == 1 || mean_speed > (1.0 - BRAKED_SHARE) * approach.value
    }

    /// Restarts the flight at a time, after a release or a wrong step.
    fn restart_flight(&mut self, from: f64, is_release: bool) -> Change {
        self.flight_from = from;
        self.departing = None;
        Change::Restarted { from, is_release }
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
            stride: self.stride,
        });
    }

    /// Tests whether the force of the contact has ended; `gravity` along the normal, px/frame^2.
    ///
    /// A contact that never ends, or after which the body still approaches, is dismissed.
    fn check_for_end(&mut self, mut contact: Contact, gravity: f64) -> Change {
        let since = samples(nodes_between(&self.nodes, contact.start_frames, f64::INFINITY), NORMAL);
        let newest = &since[since.len().saturating_sub(ACCELERATION_NODES)..];
        if let Some(acceleration) = fit_acceleration(newest) {
            contact.acceleration_max = contact.acceleration_max.max(acceleration.value - gravity);
        }
        self.contact = Some(contact);
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
            return Change::Ended { is_new: true };
        }
        if self.nodes.len() >= MAX_NODES { self.dismiss(since[since.len() - 1].time_frames) } else { Change::None }
    }

    /// Sets the end of the contact, or corrects it, and restarts the flight there.
    fn set_end(&mut self, end_frames: f64) {
        self.flight_from = end_frames;
        if let Some(contact) = &mut self.contact {
            contact.end_frames = Some(end_frames);
        }
    }

    /// Counts the newest node after a contact and, at [`END_AGAIN_FRAMES`], estimates the end of the force again.
    ///
    /// The curve of the flight after the contact is followed backwards in time. The end is where the nodes leave it.
    /// The previous end stays if the flight is too short or no node leaves the curve. Returns whether it was moved.
    pub(super) fn refine_end(&mut self, gravity: Option<f64>) -> bool {
        let Some((from, count)) = self.quiet else { return false };
        let count = count + 1;
        self.quiet = (count < END_AGAIN_FRAMES[3] && self.departing.is_none()).then_some((from, count));
        let Some(contact) = self.contact.filter(|_| END_AGAIN_FRAMES.contains(&count)) else { return false };
        let flight = nodes_between(&self.nodes, from + QUIET_EARLY_FRAMES, f64::INFINITY);
        let (after, turning_sigma) = (samples(flight, NORMAL), turning_sigma(flight));
        let all = time_reversed(&samples(nodes_between(&self.nodes, contact.start_frames, f64::INFINITY), NORMAL));
        let curve = plausible_curves(&time_reversed(&after), gravity).into_iter().next();
        let Some(curve) = curve.filter(|_| after.len() >= FLIGHT_MIN_NODES) else { return false };
        let is_off = |s: &&crate::numeric::Sample| {
            let drift = drift(turning_sigma, (from + QUIET_EARLY_FRAMES + s.time_frames).max(0.0));
            residual(&curve, &[], s).is_some_and(|r| r.value > OFF_SIGMAS * r.sigma.hypot(drift))
        };
        let Some(departed) = all.iter().find(is_off).map(|s| s.time_frames) else { return false };
        let near = &all[..all.partition_point(|s| s.time_frames <= departed + 2.0)];
        let Some(onset) = fit_onset(&curve, near, departed) else { return false };
        self.set_end(-onset.start_frames);
        true
    }

    /// Withdraws the contact and restarts the flight at a time.
    fn dismiss(&mut self, from: f64) -> Change {
        self.restart(from);
        self.discard_old_nodes();
        Change::Dismissed { from }
    }

    /// Returns the sequence number of the first node at or after a time.
    pub(super) fn frame_at(&self, time: f64) -> u64 {
        let i = self.nodes.partition_point(|n| n.time_frames < time).min(self.nodes.len() - 1);
        self.nodes[i].frame
    }
}
