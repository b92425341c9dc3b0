//! The state of a rig, from its events and the reports of its processes.

use crate::config::{Config, TriggerMode};
use crate::message::{Event, EventKind, Role, StatusMessage};
use crate::results::{Estimate, Impact};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Time that a saved shot is shown before the rig counts as ready again, s.
const SAVED_S: f64 = 4.0;
/// Time without a report of the camera's process after which it is at fault, s.
const SILENCE_S: f64 = 2.0;
/// The maximum number of collisions that are kept.
const MAX_IMPACTS: usize = 64;

/// The state of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RigState {
    Starting,
    Disarmed,
    Filling,
    Ready,
    Triggered,
    Measuring,
    Saved,
    Ended,
    Fault,
}

impl RigState {
    /// Returns the word that the page shows.
    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Starting => "STARTING",
            Self::Disarmed => "DISARMED",
            Self::Filling => "FILLING",
            Self::Ready => "READY",
            Self::Triggered => "TRIGGERED",
            Self::Measuring => "MEASURING",
            Self::Saved => "SAVED",
            Self::Ended => "ENDED",
            Self::Fault => "FAULT",
        }
    }
}

/// A state with its explanation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ExplainedState {
    pub(super) state: RigState,
    pub(super) detail: String,
}

/// A shot: when it was triggered, and when and under which number it was saved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShotState {
    /// The stamp of the frame that triggered it, ns since the Unix epoch.
    pub(super) trigger_ns: u64,
    pub(super) saved: Option<Saved>,
}

/// The end of a shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Saved {
    pub(super) number: u32,
    /// The time of the page's clock, s.
    pub(super) at_s: f64,
}

/// The state of a rig, derived from the topics `events`, `status` and `impact`.
///
/// Times are those of the page's clock, in seconds. They come with each call, so that the state is a function of its
/// input.
#[derive(Debug)]
pub(super) struct PageState {
    config: Arc<Config>,
    pub(super) is_running: bool,
    /// The stamp of the stream's first frame, ns since the Unix epoch.
    pub(super) origin_ns: Option<u64>,
    has_ended: bool,
    pub(super) is_armed: bool,
    /// The oldest frame that the ring may hold for the next shot, ns since the Unix epoch.
    fills_from_ns: u64,
    /// The last shot, triggered or saved.
    pub(super) shot: Option<ShotState>,
    /// The text of the last storage event.
    storage: String,
    /// The camera's fault and the number of frames at that time.
    camera: Option<(String, u64)>,
    /// The latest report of each process, by role number and index.
    pub(super) statuses: BTreeMap<(u32, u32), StatusMessage>,
    /// The time of the last report of the camera's process, s.
    heard_s: f64,
    /// The latest revision of each collision, the newest collision last.
    impacts: Vec<Impact>,
}

impl PageState {
    pub(super) fn new(config: Arc<Config>) -> Self {
        // A rig without a recorder reacts to every trigger.
        let is_armed = config.record.is_none() && config.trigger.mode != TriggerMode::Off;
        Self {
            config,
            is_running: false,
            origin_ns: None,
            has_ended: false,
            is_armed,
            fills_from_ns: 0,
            shot: None,
            storage: String::new(),
            camera: None,
            statuses: BTreeMap::new(),
            heard_s: 0.0,
            impacts: Vec::new(),
        }
    }

    /// Forgets a rig that is gone, except its collisions.
    pub(super) fn reset(&mut self) {
        *self = Self { impacts: std::mem::take(&mut self.impacts), ..Self::new(Arc::clone(&self.config)) };
    }

    /// Updates the state by an event that arrives at `now_s`. An event without influence on the state is ignored.
    ///
    /// `recording_number` is called for an event that completes a recording, and returns the recording's number.
    pub(super) fn add_event(&mut self, event: &Event, recording_number: impl FnOnce() -> u32, now_s: f64) {
        match event.kind() {
            Some(EventKind::Prepared) if event.sequence == 0 => {
                (self.origin_ns, self.has_ended, self.shot) = (None, false, None);
                self.impacts.clear();
            }
            Some(EventKind::Started) if self.origin_ns.is_none() => {
                (self.origin_ns, self.fills_from_ns) = (Some(event.stamp_ns), event.stamp_ns);
            }
            Some(EventKind::Ended) => self.has_ended = true,
            Some(EventKind::Armed) => self.is_armed = true,
            Some(EventKind::Disarmed) => {
                self.is_armed = false;
                // Disarmed by a person, not by the end of the shot.
                let saved = self.shot.and_then(|shot| shot.saved);
                if saved.is_some_and(|saved| now_s - saved.at_s > 1.0) {
                    self.shot = None;
                }
            }
            Some(EventKind::Triggered) => {
                self.shot = Some(ShotState { trigger_ns: event.stamp_ns, saved: None });
            }
            Some(EventKind::Recorded) => {
                let trigger_ns = self.shot.map_or(event.stamp_ns, |shot| shot.trigger_ns);
                let saved = Some(Saved { number: recording_number(), at_s: now_s });
                self.shot = Some(ShotState { trigger_ns, saved });
                self.fills_from_ns = event.stamp_ns;
            }
            Some(EventKind::Storage) => self.storage = event.text(),
            Some(EventKind::Camera) => {
                self.camera = Some((event.text(), self.camera_status().map_or(0, |status| status.taken)))
            }
            _ => {}
        }
    }

    /// Updates the state by the report of a process.
    pub(super) fn add_status(&mut self, status: &StatusMessage, now_s: f64) {
        self.statuses.insert((status.role, status.index), *status);
        match Role::from_number(status.role) {
            Some(Role::Record) => self.is_armed = status.is_armed(),
            Some(Role::Acquire) => {
                self.heard_s = now_s;
                // A camera that delivers again is no longer at fault.
                self.camera.take_if(|(_, taken)| *taken != status.taken);
            }
            _ => {}
        }
    }

    /// Adds a collision as the newest one, in place of its previous revision. Beyond [`MAX_IMPACTS`] the oldest goes.
    pub(super) fn add_impact(&mut self, impact: Impact) {
        self.impacts.retain(|kept| (kept.body, kept.number) != (impact.body, impact.number));
        self.impacts.push(impact);
        if self.impacts.len() > MAX_IMPACTS {
            self.impacts.remove(0);
        }
    }

    /// Returns the latest report of the camera's process, if there is one.
    pub(super) fn camera_status(&self) -> Option<&StatusMessage> {
        self.statuses.get(&(Role::Acquire as u32, 0))
    }

    /// Returns the newest collision with its start, deepest point or end in the last shot. Without a shot, or with one
    /// whose duration is not configured, returns the newest of the stream.
    pub(super) fn last_impact(&self) -> Option<&Impact> {
        let trigger = &self.config.trigger;
        let is_timed = !matches!(trigger.mode, TriggerMode::Off | TriggerMode::Hardware);
        let window = self.shot.filter(|_| is_timed).map(|shot| {
            let ns = |seconds: f64| (seconds * 1e9) as u64;
            shot.trigger_ns.saturating_sub(ns(trigger.pre_s))..=shot.trigger_ns.saturating_add(ns(trigger.post_s))
        });
        self.impacts.iter().rev().find(|impact| {
            let stamp_ns = |moment: Estimate| impact.origin_ns.saturating_add_signed((moment.value * 1e9) as i64);
            let mut moments =
                ["start_s", "deepest_s", "end_s"].iter().filter_map(|name| impact.get(name)).map(stamp_ns);
            window.as_ref().is_none_or(|window| moments.any(|stamp_ns| window.contains(&stamp_ns)))
        })
    }

    /// Returns the share of the time before a trigger that the ring holds, 0 to 1; 1 for a rig that records none.
    pub(super) fn ring_fraction(&self) -> f64 {
        let pre_s = self.config.trigger.pre_s;
        if self.config.record.is_none() || self.config.pre_trigger_frames(1e6) == 0 {
            return 1.0;
        }
        let newest_ns = self.camera_status().map_or(0, |status| status.stamp_ns);
        (newest_ns.saturating_sub(self.fills_from_ns) as f64 * 1e-9 / pre_s).clamp(0.0, 1.0)
    }

    /// Returns the commands that the rig accepts now: of `arm`, `disarm` and `trigger`.
    pub(super) fn actions(&self) -> &'static [&'static str] {
        let mode = self.config.trigger.mode;
        let is_open = self.shot.is_some_and(|shot| shot.saved.is_none());
        if !self.is_running || self.has_ended || mode == TriggerMode::Off || self.config.record.is_none() {
            return &[];
        }
        match self.is_armed {
            false => &["arm"],
            true if is_open || mode == TriggerMode::Hardware || self.origin_ns.is_none() => &["disarm"],
            true => &["disarm", "trigger"],
        }
    }

    /// Returns the state and its explanation at this time of the page's clock, s.
    pub(super) fn state(&self, now_s: f64) -> ExplainedState {
        let explained = |state: RigState, detail: String| ExplainedState { state, detail };
        if let Some(fault) = self.fault(now_s) {
            return explained(RigState::Fault, fault);
        }
        let saved = self.shot.and_then(|shot| shot.saved);
        let is_open = self.shot.is_some() && saved.is_none();
        match (self.config.trigger.mode, &self.config.record) {
            _ if self.origin_ns.is_none() => explained(RigState::Starting, "waiting for the first frame".into()),
            _ if is_open => self.open_shot_state(),
            _ if self.has_ended && saved.is_none() => {
                explained(RigState::Ended, "the camera delivers no more frames".into())
            }
            _ if self.has_ended => explained(RigState::Saved, "the camera delivers no more frames".into()),
            (TriggerMode::Off, Some(_)) => explained(RigState::Measuring, "the whole stream is recorded".into()),
            (TriggerMode::Off, None) => explained(RigState::Measuring, "nothing is recorded".into()),
            _ if saved.is_some_and(|saved| !self.is_armed || now_s - saved.at_s < SAVED_S) => {
                let then = if self.is_armed { "the rig is armed again" } else { "the rig is disarmed" };
                explained(RigState::Saved, then.into())
            }
            _ if !self.is_armed => explained(RigState::Disarmed, "triggers are ignored".into()),
            _ if self.ring_fraction() < 1.0 => explained(RigState::Filling, "the ring of frames fills".into()),
            (mode, _) => explained(RigState::Ready, format!("waiting for the trigger ({})", mode.as_str())),
        }
    }

    /// Returns the state during a shot: triggered until its last frame was filmed, then measuring.
    fn open_shot_state(&self) -> ExplainedState {
        let end_ns = self.shot.map_or(0, |shot| shot.trigger_ns) + (self.config.trigger.post_s * 1e9) as u64;
        match self.camera_status().is_some_and(|status| status.stamp_ns >= end_ns) {
            true => ExplainedState { state: RigState::Measuring, detail: "the shot is measured and written".into() },
            false => ExplainedState { state: RigState::Triggered, detail: "the shot is filmed".into() },
        }
    }

    /// Returns the fault that keeps the rig from taking a shot: it does not run, its camera fails or is silent, or
    /// recordings cannot be written. `None` without one.
    fn fault(&self, now_s: f64) -> Option<String> {
        if !self.is_running {
            return Some(format!("rig {} is not running", self.config.rig.name));
        }
        if let Some((text, _)) = self.camera.as_ref().filter(|_| !self.has_ended) {
            return Some(format!("camera: {text}"));
        }
        let recorder = self.statuses.get(&(Role::Record as u32, 0));
        if recorder.is_some_and(|status| status.is_disk_full()) {
            let unknown = "recordings do not fit or cannot be written";
            return Some(if self.storage.is_empty() { unknown.into() } else { self.storage.clone() });
        }
        let is_silent = self.camera_status().is_some() && now_s - self.heard_s > SILENCE_S;
        (is_silent && !self.has_ended).then(|| "the camera process does not report".into())
    }
}

#[cfg(test)]
mod tests;
