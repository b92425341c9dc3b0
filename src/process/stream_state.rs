//! The state of a stream for its readers: its run, its start and its end.

use crate::bus::{Bus, BusError, Limits, Subscriber};
use crate::message::{Event, EventKind};
use std::collections::VecDeque;

/// Maximum number of shot ends that are kept.
const MAX_SILENCES: usize = 4096;

/// The state of a stream, as announced on `events`.
#[derive(Debug)]
pub(super) struct StreamState {
    events: Subscriber<Event>,
    /// The latest run announced.
    pub(super) run_id: Option<u64>,
    /// Whether that run continues one whose process died.
    pub(super) continues: bool,
    /// First frame of that run, once published.
    pub(super) first: Option<u64>,
    /// One past the last frame of that run, once the camera stopped.
    pub(super) end: Option<u64>,
    /// Whether the tracker has published all results of that run.
    pub(super) tracked: bool,
    /// One past the last frame of each shot that ended with silence, the newest last; only with a hardware trigger.
    pub(super) silences: VecDeque<u64>,
    /// Events not returned by [`take_events`](Self::take_events) yet.
    pending: Vec<Event>,
}

impl StreamState {
    /// Subscribes to the events of a rig; nothing is known of its stream yet.
    ///
    /// # Errors
    ///
    /// Returns [`BusError`] when shared memory cannot be used.
    pub(super) fn new(bus: &Bus, limits: &Limits) -> Result<Self, BusError> {
        let events = bus.subscriber(limits)?;
        Ok(Self {
            events,
            run_id: None,
            continues: false,
            first: None,
            end: None,
            tracked: false,
            silences: VecDeque::new(),
            pending: Vec::new(),
        })
    }

    /// Reads new events and returns whether another run has begun.
    ///
    /// Stops after the event that begins a run, so that its reader can finish the previous one.
    pub(super) fn update(&mut self) -> Result<bool, BusError> {
        while let Some(event) = self.events.take()? {
            self.pending.push(event);
            if event.kind() == Some(EventKind::Prepared) {
                if self.run_id == Some(event.run_id) {
                    continue;
                }
                if event.sequence == 0 {
                    self.silences.clear();
                }
                self.continues = self.run_id.is_some() && event.sequence > 0;
                (self.run_id, self.first, self.end, self.tracked) = (Some(event.run_id), None, None, false);
                return Ok(true);
            }
            if self.run_id != Some(event.run_id) {
                continue;
            }
            match event.kind() {
                Some(EventKind::Started) => self.first = Some(event.sequence),
                Some(EventKind::Ended) => self.end = Some(event.sequence),
                Some(EventKind::Tracked) => self.tracked = true,
                Some(EventKind::Silent) => {
                    self.silences.push_back(event.sequence);
                    if self.silences.len() > MAX_SILENCES {
                        self.silences.pop_front();
                    }
                }
                _ => {}
            }
        }
        Ok(false)
    }

    /// Returns the events since the last call.
    pub(super) fn take_events(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.pending)
    }
}
