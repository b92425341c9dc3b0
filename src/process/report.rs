//! Telling how a process is doing: a few times a second on `status`, after every piece of work on `progress`.

use super::action::Ended;
use super::clock::{Every, host_ns, now};
use super::summary::Summary;
use crate::bus::{Bus, BusError, Limits, Publisher};
use crate::message::{Event, EventKind, Progress, Role, StatusMessage};
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_millis(200);

/// One process's voice on the bus.
#[derive(Debug)]
pub(super) struct Reporter {
    status: Publisher<StatusMessage>,
    progress: Publisher<Progress>,
    /// What begins and ends a stream has a history of its own, so that no flood of other events hides it.
    milestones: Publisher<Event>,
    events: Publisher<Event>,
    every: Every,
    told: Progress,
    rate: (Instant, u64),
    message: StatusMessage,
    live: bool,
}

impl Reporter {
    pub(super) fn new(bus: &Bus, limits: &Limits, role: Role, index: u32) -> Result<Self, BusError> {
        Ok(Self {
            status: bus.publisher(limits)?,
            progress: bus.publisher(limits)?,
            milestones: bus.publisher(limits)?,
            events: bus.publisher(limits)?,
            every: Every::new(PERIOD),
            told: Progress { role: role as u32, index, ..Progress::default() },
            rate: (now(), 0),
            message: StatusMessage { role: role as u32, index, pid: std::process::id(), ..StatusMessage::default() },
            live: false,
        })
    }

    /// Whether stamps are of now, so that latencies mean something.
    pub(super) fn set_live(&mut self, live: bool) {
        self.live = live;
    }

    /// The run that everything from here on belongs to.
    pub(super) fn set_run(&mut self, run_id: u64) {
        self.message.run_id = run_id;
        self.told.run_id = run_id;
    }

    pub(super) fn run_id(&self) -> u64 {
        self.told.run_id
    }

    /// State number of the status; see [`StatusMessage::state`].
    pub(super) fn set_state(&mut self, state: u32) {
        self.message.state = state;
    }

    /// How many processes were started again.
    pub(super) fn set_restarts(&mut self, restarts: u64) {
        self.message.restarts = restarts;
    }

    /// How full this process's queue is.
    pub(super) fn set_queue(&mut self, waiting: u64, capacity: u64) {
        self.message.waiting = waiting;
        self.message.capacity = capacity;
    }

    /// Tells the readiness or progress of a reader of the frames.
    pub(super) fn progress(&mut self, next_sequence: u64, done: bool) -> Result<(), BusError> {
        self.told.next_sequence = next_sequence;
        self.told.done = u32::from(done);
        self.progress.send(&self.told)
    }

    /// Tells an event of the current run.
    pub(super) fn event(&self, kind: EventKind, sequence: u64, stamp_ns: u64, text: &str) -> Result<(), BusError> {
        log::info!("{}: {text} (frame {sequence})", kind.word());
        let milestone =
            matches!(kind, EventKind::Prepared | EventKind::Started | EventKind::Ended | EventKind::Tracked);
        let publisher = if milestone { &self.milestones } else { &self.events };
        publisher.send(&Event::new(kind, self.told.run_id, sequence, stamp_ns, text))
    }

    /// Tells how something that a trigger set off has ended.
    pub(super) fn action(&self, ended: &Ended) -> Result<(), BusError> {
        if ended.failed {
            log::warn!("{}", ended.text);
        }
        self.event(EventKind::Action, ended.cause.frame, ended.cause.stamp_ns, &ended.text)
    }

    /// Tells the counts, when it is time again.
    pub(super) fn status(&mut self, summary: &Summary, sequence: u64, stamp_ns: u64) -> Result<(), BusError> {
        self.milestones.greet();
        self.events.greet();
        self.progress.greet();
        if self.every.due() { self.status_now(summary, sequence, stamp_ns) } else { Ok(()) }
    }

    /// Tells the counts.
    pub(super) fn status_now(&mut self, summary: &Summary, sequence: u64, stamp_ns: u64) -> Result<(), BusError> {
        let elapsed_s = self.rate.0.elapsed().as_secs_f64();
        if elapsed_s > 0.0 {
            self.message.rate_hz = (summary.taken - self.rate.1.min(summary.taken)) as f64 / elapsed_s;
        }
        self.rate = (now(), summary.taken);
        let message = &mut self.message;
        message.sequence = sequence;
        message.stamp_ns = stamp_ns;
        message.taken = summary.taken;
        message.given = summary.given;
        message.lost = summary.lost;
        message.dropped = summary.dropped;
        message.latency_s = if self.live { host_ns().saturating_sub(stamp_ns) as f64 * 1e-9 } else { 0.0 };
        self.status.send(message)
    }
}
