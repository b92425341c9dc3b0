//! What the tracker concludes from what it measures: whether a shot begins, and what the rig is doing.

use super::action::{Actions, Cause};
use super::clock::{host_ns, now};
use super::report::Reporter;
use crate::bus::BusError;
use crate::config::{Config, TriggerMode};
use crate::message::{Event, EventKind};
use crate::results::{BodyStep, VelocitySample};
use crate::trigger::{Decision, MeasuredTrigger, Quiet, States};
use std::time::Instant;

/// Acts on a decision of this process where no recorder does.
#[derive(Debug)]
pub(super) struct Alone {
    quiet: Quiet,
    actions: Actions,
}

impl Alone {
    /// `None` where a recorder decides what a trigger starts.
    pub(super) fn new(config: &Config) -> Option<Self> {
        let alone = || Self { quiet: Quiet::new(config.trigger.quiet_s), actions: Actions::new(config) };
        config.record.is_none().then(alone)
    }

    /// Tells of a trigger and sets off its actions, unless it comes too soon.
    pub(super) fn trigger(&mut self, cause: &Cause, reporter: &Reporter) -> Result<(), BusError> {
        if !self.quiet.passes(cause.stamp_ns) {
            return Ok(());
        }
        reporter.event(EventKind::Triggered, cause.frame, cause.stamp_ns, &cause.text)?;
        self.actions.fire(cause);
        Ok(())
    }

    /// Tells of the actions that have ended; at the end of the loop waits for those that have not.
    pub(super) fn tell(&mut self, reporter: &Reporter, at_end: bool) -> Result<(), BusError> {
        while let Some(ended) = self.actions.ended() {
            reporter.action(&ended)?;
        }
        let last = if at_end { self.actions.last() } else { Vec::new() };
        last.iter().try_for_each(|ended| reporter.action(ended))
    }
}

/// Draws the conclusions.
#[derive(Debug)]
pub(super) struct Conclusions {
    trigger: Option<MeasuredTrigger>,
    alone: Option<Alone>,
    states: States,
    /// Whether the camera waits for its line.
    is_pulsed: bool,
    /// Whether stamps are of now.
    live: bool,
    exposure_ns: u64,
    decided: Vec<(Decision, Instant)>,
}

impl Conclusions {
    pub(super) fn new(config: &Config) -> Self {
        let mode = config.trigger.mode;
        let streams = mode == TriggerMode::Off && config.record.is_some();
        Self {
            trigger: None,
            alone: Alone::new(config),
            states: States::new(config.bodies.len(), mode != TriggerMode::Off, streams),
            is_pulsed: mode == TriggerMode::Hardware,
            live: config.camera.source.is_device(),
            exposure_ns: 0,
            decided: Vec::new(),
        }
    }

    /// Begins anew with a stream whose frames are known.
    pub(super) fn begin(&mut self, config: &Config, frame_rate_hz: f64, exposure_us: f64) {
        self.trigger = config.measured_trigger(frame_rate_hz, exposure_us);
        self.exposure_ns = (1.0e3 * config.camera.exposure_us.unwrap_or(exposure_us)).round() as u64;
    }

    /// Takes the next step in frame order, which came at `came`.
    pub(super) fn see(&mut self, step: &BodyStep, came: Instant) {
        let decision = self.trigger.as_mut().and_then(|trigger| trigger.push(step));
        self.decided.extend(decision.map(|decision| (decision, came)));
    }

    /// Takes rows that became final.
    pub(super) fn rows(&mut self, rows: &[VelocitySample]) {
        rows.iter().for_each(|row| self.states.measured(row));
    }

    /// Takes what others told.
    pub(super) fn hear(&mut self, events: &[Event], reporter: &Reporter) -> Result<(), BusError> {
        for event in events {
            match event.kind() {
                Some(EventKind::Prepared) => self.states.prepared(),
                Some(EventKind::Started) => self.states.started(),
                Some(EventKind::Armed) => self.states.armed(true),
                Some(EventKind::Disarmed) => self.states.armed(false),
                Some(EventKind::Triggered) if self.alone.is_none() => self.states.triggered(),
                // The rows of a shot may all be out before its recording is whole, or the other way round.
                Some(EventKind::Recorded) if self.is_pulsed => {
                    self.states.silent();
                    self.states.recorded();
                }
                Some(EventKind::Recorded) => self.states.recorded(),
                _ => continue,
            }
            self.state(event.sequence, event.stamp_ns, reporter)?;
        }
        Ok(())
    }

    /// The stream's rows are out.
    pub(super) fn end(&mut self, newest: (u64, u64), reporter: &Reporter) -> Result<(), BusError> {
        self.states.ended();
        self.tell(newest, reporter)?;
        self.alone.as_mut().map_or(Ok(()), |alone| alone.tell(reporter, true))
    }

    /// Tells what was decided since, and the rig's state where it changed.
    pub(super) fn tell(&mut self, newest: (u64, u64), reporter: &Reporter) -> Result<(), BusError> {
        for (decision, came) in std::mem::take(&mut self.decided) {
            let took_us = now().duration_since(came).as_micros();
            let shut_ns = decision.newest_stamp_ns + self.exposure_ns;
            let since = match self.live {
                true => format!(", {:.1} ms after its exposure", host_ns().saturating_sub(shut_ns) as f64 * 1e-6),
                false => String::new(),
            };
            let Decision { frame, stamp_ns, newest_frame, what, .. } = decision;
            let text = format!("{what}; decided {took_us} us after frame {newest_frame} was measured{since}");
            reporter.event(EventKind::Decided, frame, stamp_ns, &text)?;
            if let Some(alone) = &mut self.alone {
                alone.trigger(&Cause { frame, stamp_ns, text: what }, reporter)?;
            }
        }
        if let Some(alone) = &mut self.alone {
            alone.tell(reporter, false)?;
        }
        self.state(newest.0, newest.1, reporter)
    }

    fn state(&mut self, frame: u64, stamp_ns: u64, reporter: &Reporter) -> Result<(), BusError> {
        match self.states.changed() {
            Some(state) => reporter.event(EventKind::State, frame, stamp_ns, state.word()),
            None => Ok(()),
        }
    }
}
