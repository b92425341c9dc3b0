//! Triggering on live measurements, and tracking of the rig's state.

use super::action::{Actions, TriggerCause};
use super::clock::{host_ns, now};
use super::frame_stamp::FrameStamp;
use super::status_reporter::StatusReporter;
use crate::bus::BusError;
use crate::config::{Config, TriggerMode};
use crate::message::{Event, EventKind};
use crate::results::{BodyStep, VelocitySample};
use crate::trigger::{Decision, MeasuredTrigger, Quiet, Recorder, States};
use std::time::Instant;

/// Executes a trigger in this process if the rig has no recorder.
#[derive(Debug)]
pub(super) struct StandaloneTrigger {
    quiet: Quiet,
    actions: Actions,
}

impl StandaloneTrigger {
    /// Returns `None` if a recorder executes triggers.
    pub(super) fn new(config: &Config) -> Option<Self> {
        let standalone = || Self { quiet: Quiet::new(config.trigger.quiet_s), actions: Actions::new(config) };
        config.record.is_none().then(standalone)
    }

    /// Publishes a trigger and starts its actions, unless it comes within the quiet time.
    pub(super) fn trigger(&mut self, cause: &TriggerCause, reporter: &StatusReporter) -> Result<(), BusError> {
        if !self.quiet.passes(cause.frame.stamp_ns) {
            return Ok(());
        }
        reporter.publish_event(EventKind::Triggered, cause.frame, &cause.text)?;
        self.actions.start(cause);
        Ok(())
    }

    /// Publishes the outcomes of actions that have ended.
    pub(super) fn publish(&mut self, reporter: &StatusReporter) -> Result<(), BusError> {
        while let Some(outcome) = self.actions.next_outcome() {
            reporter.publish_outcome(&outcome)?;
        }
        Ok(())
    }

    /// Waits a limited time for the actions that still run, and publishes the outcomes of those that have ended.
    pub(super) fn finish(&mut self, reporter: &StatusReporter) -> Result<(), BusError> {
        self.actions.wait_for_all().iter().try_for_each(|outcome| reporter.publish_outcome(outcome))
    }
}

/// Evaluates the measured trigger and the rig's state.
#[derive(Debug)]
pub(super) struct LiveTrigger {
    trigger: Option<MeasuredTrigger>,
    standalone: Option<StandaloneTrigger>,
    states: States,
    /// Whether the camera has a hardware trigger.
    is_pulsed: bool,
    /// Whether stamps are of the present.
    is_live: bool,
    /// The exposure time, ns; 0 if unknown.
    exposure_ns: u64,
    /// Decisions that are not published yet, and when the step behind each arrived.
    decided: Vec<(Decision, Instant)>,
}

impl LiveTrigger {
    pub(super) fn new(config: &Config) -> Self {
        let mode = config.trigger.mode;
        let recorder = match mode {
            TriggerMode::Off if config.record.is_some() => Recorder::Writing,
            TriggerMode::Off => Recorder::Off,
            _ => Recorder::Armed,
        };
        Self {
            trigger: None,
            standalone: StandaloneTrigger::new(config),
            states: States::new(config.bodies.len(), recorder),
            is_pulsed: mode == TriggerMode::Hardware,
            is_live: config.camera.has_present_stamps(),
            exposure_ns: 0,
            decided: Vec::new(),
        }
    }

    /// Restarts the trigger with a stream of this frame rate. `exposure_us` is the camera's exposure, 0 if unknown; one
    /// in the rig file overrides it for the latencies.
    pub(super) fn begin_stream(&mut self, config: &Config, frame_rate_hz: f64, exposure_us: f64) {
        self.trigger = config.measured_trigger(frame_rate_hz, exposure_us);
        self.exposure_ns = (1.0e3 * config.camera.exposure_us.unwrap_or(exposure_us)).round() as u64;
    }

    /// Passes the next step in frame order, which arrived at `arrival`, to the trigger on measured motion.
    ///
    /// Its decision is published by the next [`Self::publish`]. Without such a trigger this has no effect.
    pub(super) fn observe(&mut self, step: &BodyStep, arrival: Instant) {
        let decision = self.trigger.as_mut().and_then(|trigger| trigger.push(step));
        self.decided.extend(decision.map(|decision| (decision, arrival)));
    }

    /// Updates the rig's state by rows that became final.
    pub(super) fn add_rows(&mut self, rows: &[VelocitySample]) {
        rows.iter().for_each(|row| self.states.add_velocity(row));
    }

    /// Updates the rig's state by the events of other processes, and publishes each change.
    pub(super) fn handle_events(&mut self, events: &[Event], reporter: &StatusReporter) -> Result<(), BusError> {
        for event in events {
            match event.kind() {
                Some(EventKind::Prepared) => self.states.note_prepared(),
                Some(EventKind::Started) => self.states.note_started(),
                Some(EventKind::Armed) => self.states.note_armed(),
                Some(EventKind::Disarmed) => self.states.note_disarmed(),
                Some(EventKind::Triggered) if self.standalone.is_none() => self.states.note_triggered(),
                // The rows of a shot and its recording may become complete in either order.
                Some(EventKind::Recorded) if self.is_pulsed => {
                    self.states.note_silence();
                    self.states.note_recorded();
                }
                Some(EventKind::Recorded) => self.states.note_recorded(),
                _ => continue,
            }
            self.publish_state(event.into(), reporter)?;
        }
        Ok(())
    }

    /// Ends the stream, once all its rows are published: publishes the last decisions and the state, and waits for
    /// running actions. `newest` is the newest frame.
    pub(super) fn end_stream(&mut self, newest: FrameStamp, reporter: &StatusReporter) -> Result<(), BusError> {
        self.states.note_ended();
        self.publish(newest, reporter)?;
        self.standalone.as_mut().map_or(Ok(()), |standalone| standalone.finish(reporter))
    }

    /// Publishes new decisions, and executes them if the rig has no recorder. Also publishes the outcomes of actions,
    /// and at frame `newest` the rig's state if it changed.
    pub(super) fn publish(&mut self, newest: FrameStamp, reporter: &StatusReporter) -> Result<(), BusError> {
        for (decision, arrival) in std::mem::take(&mut self.decided) {
            let took_us = now().duration_since(arrival).as_micros();
            let exposure_end_ns = decision.newest_stamp_ns + self.exposure_ns;
            let since = match self.is_live {
                true => {
                    format!(", {:.1} ms after its exposure", host_ns().saturating_sub(exposure_end_ns) as f64 * 1e-6)
                }
                false => String::new(),
            };
            let Decision { frame, stamp_ns, newest_frame, what, .. } = decision;
            let frame = FrameStamp { sequence: frame, stamp_ns };
            let text = format!("{what}; decided {took_us} us after frame {newest_frame} was measured{since}");
            reporter.publish_event(EventKind::Decided, frame, &text)?;
            if let Some(standalone) = &mut self.standalone {
                standalone.trigger(&TriggerCause { frame, text: what }, reporter)?;
            }
        }
        if let Some(standalone) = &mut self.standalone {
            standalone.publish(reporter)?;
        }
        self.publish_state(newest, reporter)
    }

    /// Publishes the rig's state, as an event at this frame, if it has changed.
    fn publish_state(&mut self, frame: FrameStamp, reporter: &StatusReporter) -> Result<(), BusError> {
        match self.states.take_change() {
            Some(state) => reporter.publish_event(EventKind::State, frame, state.as_str()),
            None => Ok(()),
        }
    }
}
