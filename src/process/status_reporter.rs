//! Publishing of status (several times per second), progress and events of a process.

use super::action::ActionOutcome;
use super::clock::{PeriodicTimer, host_ns, now};
use super::frame_stamp::FrameStamp;
use super::latency::LatencyHistogram;
use super::summary::Summary;
use crate::bus::{Bus, BusError, Limits, Publisher};
use crate::message::{Event, EventKind, Progress, Role, StatusMessage};
use std::time::{Duration, Instant};

/// Interval of the status messages.
const STATUS_PERIOD: Duration = Duration::from_millis(200);

/// Publishes the status, progress and events of a process.
#[derive(Debug)]
pub(super) struct StatusReporter {
    status: Publisher<StatusMessage>,
    progress: Publisher<Progress>,
    /// Milestones of a stream have a history of their own, so that other events cannot displace them.
    milestones: Publisher<Event>,
    events: Publisher<Event>,
    timer: PeriodicTimer,
    progress_message: Progress,
    /// The time of the last status and the number of frames received until then.
    rate: (Instant, u64),
    status_message: StatusMessage,
    is_live: bool,
    /// Time from the stamps of frames to their rows, in this run; `None` for a process without rows.
    row_latencies: Option<LatencyHistogram>,
}

impl StatusReporter {
    pub(super) fn new(bus: &Bus, limits: &Limits, role: Role, index: u32) -> Result<Self, BusError> {
        Ok(Self {
            status: bus.publisher(limits)?,
            progress: bus.publisher(limits)?,
            milestones: bus.publisher(limits)?,
            events: bus.publisher(limits)?,
            timer: PeriodicTimer::new(STATUS_PERIOD),
            progress_message: Progress { role: role as u32, index, ..Progress::default() },
            rate: (now(), 0),
            status_message: StatusMessage {
                role: role as u32,
                index,
                pid: std::process::id(),
                ..StatusMessage::default()
            },
            is_live: false,
            row_latencies: None,
        })
    }

    /// Marks the stamps as those of the present, so that latencies are meaningful.
    pub(super) fn set_live(&mut self) {
        self.is_live = true;
    }

    /// Marks the stamps as those of the present, in a process that reports each row that it publishes.
    pub(super) fn set_live_rows(&mut self) {
        self.set_live();
        self.row_latencies = Some(LatencyHistogram::default());
    }

    /// Adds the latency of a row that was published just now, of the frame with this stamp, ns. Has no effect without
    /// [`set_live_rows`](Self::set_live_rows).
    pub(super) fn add_row(&mut self, stamp_ns: u64) {
        if let Some(latencies) = &mut self.row_latencies {
            latencies.add(Duration::from_nanos(host_ns().saturating_sub(stamp_ns)));
        }
    }

    /// Describes the latencies of the rows of this run in words; `None` if there are none.
    pub(super) fn row_latencies(&self) -> Option<String> {
        self.row_latencies.as_ref().and_then(LatencyHistogram::description)
    }

    /// Sets the run of all following messages, and forgets the latencies of the previous one.
    pub(super) fn set_run(&mut self, run_id: u64) {
        if let Some(latencies) = &mut self.row_latencies {
            latencies.clear();
        }
        self.status_message.run_id = run_id;
        self.progress_message.run_id = run_id;
    }

    /// Returns the run of the messages; 0 before one is set.
    pub(super) fn run_id(&self) -> u64 {
        self.progress_message.run_id
    }

    /// Sets the state number; see [`StatusMessage::state`].
    pub(super) fn set_state(&mut self, state: u32) {
        self.status_message.state = state;
    }

    /// Sets the number of restarted processes.
    pub(super) fn set_restarts(&mut self, restarts: u64) {
        self.status_message.restarts = restarts;
    }

    /// Sets the fill level of this process's queue and its capacity, both in frames or steps.
    pub(super) fn set_queue(&mut self, waiting: u64, capacity: u64) {
        self.status_message.waiting = waiting;
        self.status_message.capacity = capacity;
    }

    /// Publishes the next frame that this reader will take; `u64::MAX` if nobody must wait for it.
    pub(super) fn publish_progress(&mut self, next_sequence: u64) -> Result<(), BusError> {
        self.progress_message.next_sequence = next_sequence;
        self.progress_message.done = 0;
        self.progress.send(&self.progress_message)
    }

    /// Publishes that this reader is done with all frames before `end`.
    pub(super) fn publish_done(&mut self, end: u64) -> Result<(), BusError> {
        self.progress_message.next_sequence = end;
        self.progress_message.done = 1;
        self.progress.send(&self.progress_message)
    }

    /// Logs and publishes an event of the current run.
    pub(super) fn publish_event(&self, kind: EventKind, frame: FrameStamp, text: &str) -> Result<(), BusError> {
        log::info!("{}: {text} (frame {})", kind.as_str(), frame.sequence);
        let milestone =
            matches!(kind, EventKind::Prepared | EventKind::Started | EventKind::Ended | EventKind::Tracked);
        let publisher = if milestone { &self.milestones } else { &self.events };
        publisher.send(&Event::new(kind, self.run_id(), frame.sequence, frame.stamp_ns, text))
    }

    /// Publishes the outcome of an action.
    pub(super) fn publish_outcome(&self, outcome: &ActionOutcome) -> Result<(), BusError> {
        if outcome.failed {
            log::warn!("{}", outcome.text);
        }
        self.publish_event(EventKind::Action, outcome.cause.frame, &outcome.text)
    }

    /// Publishes the status if its period has passed, and connects to readers that joined in the meantime.
    pub(super) fn publish_status_if_due(&mut self, summary: &Summary, newest: FrameStamp) -> Result<(), BusError> {
        self.milestones.update_connections();
        self.events.update_connections();
        self.progress.update_connections();
        if self.timer.restart_if_due() { self.publish_status(summary, newest) } else { Ok(()) }
    }

    /// Publishes the status: the counts, the newest frame, the frame rate since the last status, and the newest frame's
    /// age as the latency, 0 unless the stamps are of the present.
    pub(super) fn publish_status(&mut self, summary: &Summary, newest: FrameStamp) -> Result<(), BusError> {
        let elapsed_s = self.rate.0.elapsed().as_secs_f64();
        if elapsed_s > 0.0 {
            self.status_message.rate_hz = (summary.taken - self.rate.1.min(summary.taken)) as f64 / elapsed_s;
        }
        self.rate = (now(), summary.taken);
        let message = &mut self.status_message;
        message.sequence = newest.sequence;
        message.stamp_ns = newest.stamp_ns;
        message.taken = summary.taken;
        message.given = summary.given;
        message.lost = summary.lost;
        message.dropped = summary.dropped;
        if let Some(latencies) = &self.row_latencies {
            let quantile_s = |probability| latencies.quantile_us(probability).map_or(0.0, |us| us as f64 * 1e-6);
            message.row_latency_median_s = quantile_s(0.5);
            message.row_latency_p99_s = quantile_s(0.99);
            message.row_latency_p999_s = quantile_s(0.999);
            message.row_latency_max_s = latencies.max().as_secs_f64();
            message.row_latency_deviation_s = latencies.deviation_s();
        }
        message.latency_s = if self.is_live { host_ns().saturating_sub(newest.stamp_ns) as f64 * 1e-9 } else { 0.0 };
        self.status.send(message)
    }
}
