//! What every reader of a stream needs to know of it: which run, where it starts, where it ends.

use crate::bus::{Bus, BusError, Limits, Subscriber};
use crate::message::{Event, EventKind};
use std::collections::VecDeque;

/// Ends of shots that are kept.
const SILENCES: usize = 4096;

/// The stream as told on `events`.
#[derive(Debug)]
pub(super) struct Stream {
    events: Subscriber<Event>,
    /// The newest run announced.
    pub(super) run_id: Option<u64>,
    /// Whether that run goes on where one that died was.
    pub(super) goes_on: bool,
    /// First frame of that run, once it was published.
    pub(super) first: Option<u64>,
    /// One past the last frame of that run, once the camera stopped.
    pub(super) end: Option<u64>,
    /// Whether the tracker has published everything of that run.
    pub(super) tracked: bool,
    /// One past the last frame of each shot of this run that ended with silence, the newest last; of a camera that waits
    /// for its line.
    pub(super) silences: VecDeque<u64>,
    /// Events not looked at yet by [`take`](Self::take).
    pending: Vec<Event>,
}

impl Stream {
    pub(super) fn new(bus: &Bus, limits: &Limits) -> Result<Self, BusError> {
        let events = bus.subscriber(limits)?;
        Ok(Self {
            events,
            run_id: None,
            goes_on: false,
            first: None,
            end: None,
            tracked: false,
            silences: VecDeque::new(),
            pending: Vec::new(),
        })
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
                if event.sequence == 0 {
                    self.silences.clear();
                }
                self.goes_on = self.run_id.is_some() && event.sequence > 0;
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
                    if self.silences.len() > SILENCES {
                        self.silences.pop_front();
                    }
                }
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
