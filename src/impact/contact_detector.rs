//! Online detection of contact.

use super::contact::Contact;
use super::flight_watch::{Change, FlightWatch};
use super::regime_history::RegimeHistory;
use super::trajectory::SurfaceNode;
use crate::motion::Regime;
use crate::results::Phase;

/// The intervals at which the motion is watched, frames. The longest suits contacts of about 5000 frames.
const STRIDES: [u32; 5] = [1, 4, 16, 64, 256];
/// The number of watches whose positions of a moving surface are kept, which bounds their memory.
const USUAL_WATCHES: usize = 3;

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

/// A contact detector for one body.
///
/// The motion is watched in every frame, and in every 4th, 16th, 64th and 256th, so that contacts of any length are a few to
/// some hundred nodes long in one of the watches. The first that detects a contact measures it.
#[derive(Debug, Clone)]
pub struct Detector {
    watches: Vec<FlightWatch>,
    /// The watch of the current or last contact.
    current: usize,
    history: RegimeHistory,
}

impl Detector {
    /// Creates a detector without any node. Rows of frames older than `lag_frames` are published.
    pub fn new(lag_frames: u64) -> Self {
        let watches = STRIDES.map(FlightWatch::new).into();
        Self { watches, current: 0, history: RegimeHistory::new(lag_frames) }
    }

    /// Returns the nodes of a contact, or all nodes of flight, in order of time. Their unit of time is `stride` frames.
    pub fn nodes(&self, stride: u32) -> &[SurfaceNode] {
        let index = STRIDES.iter().position(|known| *known == stride);
        index.map_or(&[], |index| self.watches[index].nodes())
    }

    /// Returns the first frame whose position may still be needed. Contacts of thousands of frames may need earlier ones.
    pub fn kept_from(&self) -> u64 {
        let usual = self.watches.iter().take(USUAL_WATCHES);
        usual.filter_map(|watch| watch.nodes().first()).map(|node| node.frame).min().unwrap_or(0)
    }

    /// Returns the current contact, or the last one until [`Detector::release`].
    pub fn contact(&self) -> Option<&Contact> {
        self.watches[self.current].contact()
    }

    /// Discards the last contact and the nodes kept for it.
    pub fn release(&mut self) {
        self.watches[self.current].release();
    }

    /// Whether a contact, or an undecided departure, may be acting on the body.
    pub fn may_be_in_contact(&self) -> bool {
        self.watches[0].may_be_in_contact() || self.watches[self.current].is_in_contact()
    }

    /// Adds the position in a frame and returns its effect. `gravity` is along the normal, px/frame^2; `None` without a
    /// scale.
    pub fn add_node(&mut self, node: SurfaceNode, gravity: Option<f64>) -> Event {
        let mut event = Event::None;
        for (index, stride) in STRIDES.into_iter().enumerate() {
            if !node.frame.is_multiple_of(u64::from(stride)) {
                break;
            }
            let periods = f64::from(stride);
            self.watches[index].add_node(node.with_period(periods));
            if index != self.current && self.watches[self.current].is_in_contact() {
                continue;
            }
            let gravity = gravity.map(|g| g * periods.powi(2));
            if self.watches[index].refine_end(gravity) {
                self.apply(index, Change::Ended { is_new: false }, node.frame);
            }
            let change = self.watches[index].test_newest(gravity);
            event = self.apply(index, change, node.frame).unwrap_or(event);
        }
        event
    }

    /// Records the change that a watch has found at the `newest` frame; returns its event, if it is one.
    fn apply(&mut self, index: usize, change: Change, newest: u64) -> Option<Event> {
        let periods = f64::from(STRIDES[index]);
        let frame_at = |time: f64| self.watches[index].frame_at(time);
        let contact = self.watches[index].contact().copied();
        if let Some(contact) = contact.filter(|contact| contact.end_frames.is_none() && change == Change::None) {
            self.history.set_acceleration(contact.acceleration_max / periods.powi(2));
        }
        match change {
            Change::None => None,
            Change::Restarted { from, is_release } => {
                if index == 0 {
                    self.history.restart_flight(frame_at(from));
                }
                if index == 0 && is_release {
                    self.restart_others(index, from);
                }
                None
            }
            Change::Began => {
                let contact = contact?;
                self.history.begin_contact(frame_at(contact.start_frames), contact.approach.value.abs() / periods);
                self.current = index;
                Some(Event::Began)
            }
            Change::Ended { is_new } => {
                let contact = contact?;
                let end = contact.end_frames?;
                self.history.set_acceleration(contact.acceleration_max / periods.powi(2));
                self.history.set_end(frame_at(end), newest);
                self.restart_others(index, end);
                is_new.then_some(Event::Ended)
            }
            Change::Dismissed { from } => {
                self.history.withdraw_contact();
                if index == 0 {
                    self.history.restart_flight(frame_at(from));
                    self.restart_others(index, from);
                }
                Some(Event::Dismissed)
            }
        }
    }

    /// Restarts the flight of all watches but one at a time of that one.
    fn restart_others(&mut self, index: usize, from: f64) {
        let from_frames = from * f64::from(STRIDES[index]);
        for (other, watch) in self.watches.iter_mut().enumerate().filter(|(other, _)| *other != index) {
            watch.restart(from_frames / f64::from(STRIDES[other]));
        }
    }

    /// Returns the known regime of the motion at a frame. The first flight starts at 0, the newest ends at `u64::MAX`.
    pub fn regime(&self, frame: u64) -> Regime {
        self.history.regime(frame)
    }

    /// Returns the phase at a frame: flight, contact or rebound, as known by now.
    pub fn phase(&self, frame: u64) -> Phase {
        self.history.phase(frame)
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
