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
                let result = self.impact.take().map_or_else(String::new, |impact| {
                    describe_result(self.bodies.get(impact.body as usize).map_or("", String::as_str), &impact)
                });
                format!("shot {}: {}{result}", self.shots, event.text())
            }
            Some(EventKind::Behind) => event.text(),
            Some(EventKind::Remeasured) => format!("measured after the shot: {}", event.text()),
            _ => return,
        };
        (self.print)(&line);
    }
}

/// Returns the result of a collision of a body in words: its restitution, or the reason why there is none.
fn describe_result(body: &str, impact: &Impact) -> String {
    match (impact.status, impact.restitution) {
        (PointStatus::Valid, Some(e)) => format!(", {body} restitution {:.4} +- {:.4}", e.value, e.sigma),
        (PointStatus::Valid, None) => format!(", {body} collided, without a flight on both sides"),
        // Its first revision, when the contact starts.
        (PointStatus::Lost, _) if impact.end_s.is_none() => {
            format!(", {body} collided, and the end of it was not filmed")
        }
        (PointStatus::Lost, _) => format!(", {body} collided, with too few frames around it for a result"),
        (PointStatus::Outlier, _) => format!(", {body} collided, but neither a fixed surface nor a fall explains it"),
        (status, _) => format!(", {body} collided, without a result: {}", status.as_str()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Estimate;

    #[test]
    fn a_collision_that_was_cut_off_is_no_loss() {
        let mut impact = Impact::unknown(0, 0, 0);
        assert_eq!(describe_result("ball", &impact), ", ball collided, and the end of it was not filmed");
        impact.end_s = Some(Estimate { value: 0.005, sigma: 1e-6 });
        assert_eq!(describe_result("ball", &impact), ", ball collided, with too few frames around it for a result");
        impact.status = PointStatus::Valid;
        impact.restitution = Some(Estimate { value: 0.8, sigma: 0.01 });
        assert_eq!(describe_result("ball", &impact), ", ball restitution 0.8000 +- 0.0100");
    }
}
