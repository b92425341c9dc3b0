//! Notices contact while it happens.

use std::collections::VecDeque;

use super::contact_onset::{mirrored, onset};
use super::departure::{Departure, departure, plausible_curves, residual};
use super::trajectory::{NORMAL, SurfaceNode, between, samples};
use crate::motion::{AUTO_AHEAD_FRAMES, Regime};
use crate::numeric::Polynomial;
use crate::results::{Estimate, Phase};

/// A position further than this from the flight's curve is off it, sigmas.
const OFF_SIGMAS: f64 = 6.0;
/// So many in a row, to one side, are a departure.
const OFF_FRAMES: u32 = 3;
/// A departure that still looks like a jump after so many is one.
const JUMP_FRAMES: u32 = 8;
/// Approach slower than so many sigmas is none.
const APPROACH_SIGMAS: f64 = 6.0;
/// Nodes of the flight a new one is judged by, at most.
const FLIGHT_NODES: usize = 48;
/// And at least.
const FLIGHT_MIN_NODES: usize = 6;
/// Newest nodes kept out of the flight's fit, so that a slow beginning does not bend it.
const GUARD_NODES: usize = 4;
/// Frames between the first node off the curve and what is certainly flight.
const CERTAIN_FRAMES: f64 = 9.0;
/// Nodes the running acceleration is fitted to.
const ACCELERATION_NODES: usize = 7;
/// Free again: the acceleration is gravity's within this share of the strongest one.
const QUIET_SHARE: f64 = 0.02;
/// Most nodes the end is judged by.
const QUIET_NODES: usize = 40;
/// Where these do not tell a share of it, so many nodes after what looked like a contact tell whether any force acts,
const FORCELESS_NODES: usize = 16;
/// when it is so many sigmas.
const FORCE_SIGMAS: f64 = 3.0;
/// The quiet stretch begins up to so many frames before the force is gone.
const QUIET_EARLY_FRAMES: f64 = 4.0;
/// The end is judged anew when so many frames have passed since the quiet stretch began.
const END_AGAIN_FRAMES: [u32; 4] = [10, 14, 18, 26];
/// Nodes kept in flight.
const KEPT_NODES: usize = 256;
/// Longest stretch of nodes a contact may span with the flight before it.
const MOST_NODES: usize = 4096;
/// Changes of regime remembered.
const KEPT_BREAKS: usize = 16;

/// A contact as noticed, before any law is fitted. Times in frames since the stream's first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The flight before is known from here.
    pub flight_from_frames: f64,
    /// To here it is certainly flight.
    pub flight_to_frames: f64,
    /// The force begins, by the hinge.
    pub start_frames: f64,
    /// First node off the flight's curve.
    pub departed_frames: f64,
    /// Normal velocity before, px/frame.
    pub approach: Estimate,
    /// Strongest normal acceleration seen, px/frame^2.
    pub acceleration_max: f64,
    /// Free again from here on; `None` while it lasts.
    pub end_frames: Option<f64>,
}

/// What a new node changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// Nothing.
    None,
    /// Contact was noticed.
    Began,
    /// Its end was noticed.
    Ended,
    /// It was none, or lasts for ever.
    Dismissed,
}

/// From one frame on the motion follows another rule.
#[derive(Debug, Clone, Copy)]
struct Break {
    from: u64,
    /// First frame after a contact; `from` where the flight only starts anew.
    to: Option<u64>,
    /// From here on frames were told to be after it before a later `to` was known.
    told_after: Option<u64>,
    speed: f64,
    acceleration: f64,
}

impl Break {
    fn is_contact(&self) -> bool {
        self.to != Some(self.from)
    }
}

/// Watches the normal coordinate of one body.
///
/// In flight each new position is held against the parabola through the flight
/// so far (gravity known); three in a row more than six sigmas to the outer
/// side, of a body that approaches the surface, are contact. Contact is over when
/// the acceleration has become gravity's again. There is no threshold in px.
#[derive(Debug, Clone)]
pub struct Detector {
    trail: Vec<SurfaceNode>,
    flight_from: f64,
    off: Option<(f64, f64, u32)>,
    contact: Option<Contact>,
    /// Frames since the quiet stretch after a contact began at the given time.
    quiet: Option<(f64, u32)>,
    breaks: VecDeque<Break>,
}

impl Detector {
    /// Nothing seen yet.
    pub fn new() -> Self {
        Self {
            trail: Vec::new(),
            flight_from: f64::NEG_INFINITY,
            off: None,
            contact: None,
            quiet: None,
            breaks: VecDeque::new(),
        }
    }

    /// The nodes remembered, in order.
    pub fn trail(&self) -> &[SurfaceNode] {
        &self.trail
    }

    /// The contact that lasts, or the last one until [`Detector::release`].
    pub fn contact(&self) -> Option<&Contact> {
        self.contact.as_ref()
    }

    /// Forgets the last contact and the nodes that were kept for it.
    pub fn release(&mut self) {
        if self.contact.is_some_and(|c| c.end_frames.is_some()) {
            self.contact = None;
        }
    }

    /// Whether the surface, or something not decided yet, may be acting on the body.
    pub fn is_suspicious(&self) -> bool {
        self.off.is_some() || self.contact.is_some_and(|c| c.end_frames.is_none())
    }

    /// Takes the next node; `gravity` along the normal in px/frame^2 where the scale is known.
    pub fn push(&mut self, node: SurfaceNode, gravity: Option<f64>) -> Event {
        self.trail.push(node);
        match self.contact {
            Some(contact) if contact.end_frames.is_none() => self.watch_contact(contact, gravity.unwrap_or(0.0)),
            _ => {
                self.prune();
                self.judge_end(gravity);
                self.watch_flight(gravity)
            }
        }
    }

    fn prune(&mut self) {
        let keep_from = self.contact.map(|c| c.flight_from_frames);
        let old = self.trail.len().saturating_sub(KEPT_NODES);
        let old = keep_from.map_or(old, |t| old.min(self.trail.partition_point(|n| n.time_frames < t)));
        if old >= KEPT_NODES {
            self.trail.drain(..old);
        }
    }

    fn watch_flight(&mut self, gravity: Option<f64>) -> Event {
        let first = self.trail.partition_point(|n| n.time_frames < self.flight_from);
        let end = match self.off {
            Some((from, ..)) => self.trail.partition_point(|n| n.time_frames < from),
            None => self.trail.len() - 1,
        };
        let end = end.saturating_sub(GUARD_NODES).max(first);
        let flight = samples(&self.trail[first.max(end.saturating_sub(FLIGHT_NODES))..end], NORMAL);
        let since = samples(&self.trail[end..], NORMAL);
        let judged = if flight.len() < FLIGHT_MIN_NODES { None } else { departure(&flight, &since, gravity) };
        let time = self.trail[self.trail.len() - 1].time_frames;
        let Some(Departure { sigmas, rate }) = judged else { return Event::None };
        if sigmas.abs() <= OFF_SIGMAS {
            self.off = None;
            return Event::None;
        }
        let (from, side, count) = match self.off {
            Some((from, side, count)) if side * sigmas > 0.0 => (from, side, count + 1),
            _ => (time, sigmas.signum(), 1),
        };
        self.off = Some((from, side, count));
        if count < OFF_FRAMES {
            return Event::None;
        }
        let approaching = rate.value < -APPROACH_SIGMAS * rate.sigma;
        if side < 0.0 || !approaching {
            self.restart(from);
            return Event::None;
        }
        let back = self.trail.partition_point(|n| n.time_frames < from - 15.0).max(first);
        let recent = samples(&self.trail[back..], NORMAL);
        let begun = plausible_curves(&flight, gravity).first().and_then(|curve| onset(curve, &recent, from));
        match begun {
            Some(o) if !o.gradual && count < JUMP_FRAMES => Event::None,
            Some(o) if !o.gradual => {
                self.restart(from);
                Event::None
            }
            begun => {
                // Without a common offset (frames lost) the start lies anywhere between the last node and this one.
                let between = 0.5 * (flight[flight.len() - 1].time_frames + from);
                self.begin(begun.map_or(between, |o| o.start_frames), from, rate);
                Event::Began
            }
        }
    }

    /// The flight starts anew at `from_frames`: released, or a wrong step.
    fn restart(&mut self, from_frames: f64) {
        self.flight_from = from_frames;
        self.off = None;
        let from = self.frame_at(from_frames);
        self.remember(Break { from, to: Some(from), told_after: None, speed: 0.0, acceleration: 0.0 });
    }

    fn begin(&mut self, start_frames: f64, departed_frames: f64, approach: Estimate) {
        (self.off, self.quiet) = (None, None);
        let first = self.trail.partition_point(|n| n.time_frames < self.flight_from);
        let flight_from_frames = self.trail[first].time_frames;
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
        self.remember(Break { from, to: None, told_after: None, speed: approach.value.abs(), acceleration: 0.0 });
    }

    fn watch_contact(&mut self, mut contact: Contact, gravity: f64) -> Event {
        let since = samples(between(&self.trail, contact.start_frames, f64::INFINITY), NORMAL);
        let newest = &since[since.len().saturating_sub(ACCELERATION_NODES)..];
        if let Some(acceleration) = curvature(newest) {
            contact.acceleration_max = contact.acceleration_max.max(acceleration.value - gravity);
        }
        self.contact = Some(contact);
        if let Some(b) = self.breaks.back_mut() {
            b.acceleration = contact.acceleration_max;
        }
        let forceless = || forceless(between(&self.trail, contact.departed_frames, f64::INFINITY), gravity);
        if let Some((from, rate)) = quiet(&since, gravity, contact.acceleration_max).unwrap_or_else(forceless) {
            if rate.value < -APPROACH_SIGMAS * rate.sigma {
                // Free, and still on its way in: whatever that was, it was no collision.
                return self.dismiss(from);
            }
            contact.end_frames = Some(from);
            self.contact = Some(contact);
            self.set_end(from);
            self.quiet = Some((from, since.iter().filter(|s| s.time_frames >= from).count() as u32));
            return Event::Ended;
        }
        if self.trail.len() >= MOST_NODES { self.dismiss(since[since.len() - 1].time_frames) } else { Event::None }
    }

    fn set_end(&mut self, end_frames: f64) {
        self.flight_from = end_frames;
        let (to, newest) = (self.frame_at(end_frames), self.trail[self.trail.len() - 1].frame);
        if let Some(b) = self.breaks.back_mut() {
            // Of frames so far back it was told already what they are.
            let told = b.to.filter(|before| before + AUTO_AHEAD_FRAMES < newest);
            b.told_after = b.told_after.or(told);
            b.to = Some(to.max(b.from + 1));
        }
        if let Some(contact) = &mut self.contact {
            contact.end_frames = Some(end_frames);
        }
    }

    /// Looks back from the flight after a contact for the moment the force was gone.
    fn judge_end(&mut self, gravity: Option<f64>) {
        let Some((from, count)) = self.quiet else { return };
        let count = count + 1;
        self.quiet = (count < END_AGAIN_FRAMES[3] && self.off.is_none()).then_some((from, count));
        let Some(contact) = self.contact.filter(|_| END_AGAIN_FRAMES.contains(&count)) else { return };
        let after = samples(between(&self.trail, from + QUIET_EARLY_FRAMES, f64::INFINITY), NORMAL);
        let all = mirrored(&samples(between(&self.trail, contact.start_frames, f64::INFINITY), NORMAL));
        let curve = plausible_curves(&mirrored(&after), gravity).into_iter().next();
        let Some(curve) = curve.filter(|_| after.len() >= FLIGHT_MIN_NODES) else { return };
        let is_off =
            |s: &&crate::numeric::Sample| residual(&curve, &[], s).is_some_and(|r| r.value > OFF_SIGMAS * r.sigma);
        let Some(departed) = all.iter().find(is_off).map(|s| s.time_frames) else { return };
        let near = &all[..all.partition_point(|s| s.time_frames <= departed + 2.0)];
        if let Some(o) = onset(&curve, near, departed) {
            self.set_end(-o.start_frames);
        }
    }

    fn dismiss(&mut self, from_frames: f64) -> Event {
        self.contact = None;
        self.breaks.pop_back();
        self.restart(from_frames);
        self.prune();
        Event::Dismissed
    }

    fn frame_at(&self, time_frames: f64) -> u64 {
        let i = self.trail.partition_point(|n| n.time_frames < time_frames).min(self.trail.len() - 1);
        self.trail[i].frame
    }

    fn remember(&mut self, new: Break) {
        if self.breaks.len() == KEPT_BREAKS {
            self.breaks.pop_front();
        }
        self.breaks.push_back(new);
    }

    /// What is known of the motion at a frame.
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

    /// Flight, contact or rebound at a frame, as far as is known by now.
    pub fn phase(&self, frame: u64) -> Phase {
        let newest = self.breaks.iter().rev().find(|b| b.from <= frame);
        // Of a contact that has been told to be over it is not told again that it lasts.
        let is_over = newest.and_then(|b| b.told_after).is_some_and(|after| after <= frame);
        match self.regime(frame) {
            Regime::Contact { .. } if !is_over => Phase::Contact,
            _ if self.breaks.iter().any(|b| b.is_contact() && b.from <= frame) => Phase::Rebound,
            _ => Phase::Flight,
        }
    }
}

impl Default for Detector {
    fn default() -> Self {
        Self::new()
    }
}

fn curvature(nodes: &[crate::numeric::Sample]) -> Option<Estimate> {
    let middle = 0.5 * (nodes.first()?.time_frames + nodes.last()?.time_frames);
    let fit = Polynomial::fit(nodes, middle, 2, 0.0)?;
    let a = fit.curvature();
    Some(Estimate { value: a.value, sigma: a.sigma * fit.excess() })
}

/// Whether the newest nodes are free of force; if so, since when and how fast. `None` where they do not tell.
fn quiet(since: &[crate::numeric::Sample], gravity: f64, strongest: f64) -> Option<Option<(f64, Estimate)>> {
    let mut width = 5;
    while width <= QUIET_NODES.min(since.len()) {
        let newest = &since[since.len() - width..];
        let acceleration = curvature(newest).filter(|a| a.sigma <= QUIET_SHARE * strongest);
        if let Some(a) = acceleration {
            let still = (a.value - gravity).abs() <= QUIET_SHARE * strongest + 2.0 * a.sigma;
            let middle = 0.5 * (newest[0].time_frames + newest[width - 1].time_frames);
            let fit = Polynomial::fit(newest, middle, 1, gravity)?;
            let rate = fit.rate(middle);
            return Some(still.then_some((newest[0].time_frames, rate)));
        }
        width += 1;
    }
    None
}

/// Whether no force can be told from none in the nodes since a departure; if so, since when and how fast.
///
/// A blow between two frames, or poses that wander, may look like the begin of a contact.
fn forceless(since: &[SurfaceNode], gravity: f64) -> Option<(f64, Estimate)> {
    let newest = samples(&since[since.len().saturating_sub(QUIET_NODES)..], NORMAL);
    if newest.len() < FORCELESS_NODES {
        return None;
    }
    let acceleration = curvature(&newest)?;
    let middle = 0.5 * (newest[0].time_frames + newest[newest.len() - 1].time_frames);
    let rate = Polynomial::fit(&newest, middle, 1, gravity)?.rate(middle);
    (acceleration.value - gravity <= FORCE_SIGMAS * acceleration.sigma).then_some((newest[0].time_frames, rate))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a detector says of these positions, up to 4 sigmas of noise apart, and in which frame.
    fn events(frames: u64, position: impl Fn(f64) -> f64) -> (Vec<(u64, Event)>, Detector) {
        let (mut detector, sigma) = (Detector::new(), 1.3e-3);
        let mut events = Vec::new();
        for frame in 0..frames {
            let noise = sigma * ((frame * 37 % 17) as f64 - 8.0) / 5.0;
            let value = [position(frame as f64) + noise, 0.0, 0.0];
            let node = SurfaceNode {
                frame,
                time_frames: frame as f64,
                component: 0,
                value,
                sigma: [sigma; 3],
                walk_share: [0.0; 3],
            };
            match detector.push(node, Some(0.0)) {
                Event::None => (),
                event => events.push((frame, event)),
            }
        }
        (events, detector)
    }

    #[test]
    fn a_blow_that_leaves_a_body_on_its_way_in_is_no_contact_for_good() {
        // It is noticed late, when no force is left to be seen.
        let creeps = |t: f64| -2.58 * t + 2e-5 * (t - 17.0).clamp(0.0, 9.0).powi(3) + 0.0044 * (t - 26.0).max(0.0);
        let (told, detector) = events(80, creeps);
        let [(began, Event::Began), (over, Event::Dismissed)] = told[..] else { panic!("{told:?}") };
        assert!(over < began + 26 && detector.phase(79) == Phase::Flight, "{told:?}");
    }

    #[test]
    fn a_contact_that_is_gentle_and_long_lasts_until_it_is_over() {
        // Half a period of 300 frames from a speed of 0.5 px/frame on.
        let omega = std::f64::consts::PI / 300.0;
        let position = |t: f64| match t - 40.0 {
            since if since <= 0.0 => -0.5 * since,
            since if since <= 300.0 => -0.5 * (omega * since).sin() / omega,
            since => 0.5 * (since - 300.0),
        };
        let (told, _) = events(400, position);
        let [(began, Event::Began), (over, Event::Ended)] = told[..] else { panic!("{told:?}") };
        assert!(began < 80 && (336..360).contains(&over), "{told:?}");
    }
}
