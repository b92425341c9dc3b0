//! One line for each change of a rig's state and each shot, for the person who started it.

use crate::bus::{Bus, BusError, Limits, Subscriber};
use crate::config::{Config, TriggerMode};
use crate::message::{Event, EventKind, ImpactMessage};
use crate::results::{Impact, PointStatus};

/// The state of a rig that records at a trigger.
const ARMED: &str = "armed";

/// The lines of a rig.
pub(super) struct ShotLines {
    impacts: Subscriber<ImpactMessage>,
    print: fn(&str),
    rig: String,
    bodies: Vec<String>,
    has_trigger: bool,
    /// The newest collision since the last recording.
    impact: Option<Impact>,
    /// The number of recordings so far.
    shots: u32,
}

impl ShotLines {
    pub fn new(bus: &Bus, config: &Config, limits: &Limits, print: fn(&str)) -> Result<Self, BusError> {
        Ok(Self {
            impacts: bus.subscriber(limits)?,
            print,
            rig: config.rig.name.clone(),
            bodies: config.bodies.iter().map(|body| body.name.clone()).collect(),
            has_trigger: config.trigger.mode != TriggerMode::Off,
            impact: None,
            shots: 0,
        })
    }

    /// Reads the collisions that were published and keeps the newest; to be called before their recording is printed.
    pub fn note_impacts(&mut self) -> Result<(), BusError> {
        while let Some(message) = self.impacts.take()? {
            self.impact = message.impact().or(self.impact.take());
        }
        Ok(())
    }

    /// Prints the line of an event, if it has one.
    pub fn print(&mut self, event: &Event) {
        let rig = &self.rig;
        let line = match event.kind() {
            Some(EventKind::State) if event.text() == ARMED => format!("ready: rig {rig} waits for a trigger"),
            Some(EventKind::Disarmed) => format!("disarmed: rig {rig} ignores triggers"),
            Some(EventKind::Started) if !self.has_trigger => format!("filming: rig {rig}"),
            Some(EventKind::Recorded) => {
                self.shots += 1;
                let result = self.impact.take().map_or_else(String::new, |impact| self.describe_result(&impact));
                format!("shot {}: {}{result}", self.shots, event.text())
            }
            _ => return,
        };
        (self.print)(&line);
    }

    /// Returns the result of a collision in words: its restitution, or its status.
    fn describe_result(&self, impact: &Impact) -> String {
        let body = self.bodies.get(impact.body as usize).map_or("", String::as_str);
        match (impact.status, impact.restitution) {
            (PointStatus::Valid, Some(e)) => format!(", {body} restitution {:.4} +- {:.4}", e.value, e.sigma),
            (PointStatus::Valid, None) => format!(", {body} collided, without a flight on both sides"),
            (status, _) => format!(", {body} collided, {}", status.as_str()),
        }
    }
}
