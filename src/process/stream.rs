//! What every reader of a stream needs to know of it: which run, where it starts, where it ends.

use crate::bus::{Bus, BusError, Limits, Subscriber};
use crate::message::{Event, EventKind};

/// The stream as told on `events`.
#[derive(Debug)]
pub(super) struct Stream {
    events: Subscriber<Event>,
    /// The newest run announced.
    pub(super) run_id: Option<u64>,
    /// First frame of that run, once it was published.
    pub(super) first: Option<u64>,
    /// One past the last frame of that run, once the camera stopped.
    pub(super) end: Option<u64>,
    /// Whether the tracker has published everything of that run.
    pub(super) tracked: bool,
    /// Events not looked at yet by [`take`](Self::take).
    pending: Vec<Event>,
}

impl Stream {
    pub(super) fn new(bus: &Bus, limits: &Limits) -> Result<Self, BusError> {
        let events = bus.subscriber(limits)?;
        Ok(Self { events, run_id: None, first: None, end: None, tracked: false, pending: Vec::new() })
    }

    /// Reads what was told since; `true` when another run has begun.
    ///
    /// Stops after the event that begins a run, so that its reader can end the one before.
    pub(super) fn update(&mut self) -> Result<bool, BusError> {
        while let Some(event) = self.events.take()? {
            self.pending.push(event);
            if event.kind() == Some(EventKind::Prepared) {
                if self.run_id == Some(event.run_id) {
                    continue;
                }
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
                _ => {}
            }
        }
        Ok(false)
    }

    /// Every event told since the last call.
    pub(super) fn take(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.pending)
    }
}
