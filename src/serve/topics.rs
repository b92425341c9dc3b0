//! The threads that read the bus, one per topic, and hand over to the server.
//!
//! They are plain threads, because a wait on shared memory would stop every client of the server.

use super::datagrams::Datagrams;
use super::feed::{Feed, MAX_BATCH_ROWS};
use super::rows::{self, RowContext};
use crate::bus::{Bus, BusError};
use crate::message::VelocityMessage;
use crate::process::Stop;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The maximum wait for a notification.
const WAIT: Duration = Duration::from_millis(20);
/// Interval of looking for a rig that is not running.
const RETRY: Duration = Duration::from_millis(200);

/// The facts about the rig that the threads share.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) stop: Stop,
    /// The number of the run that is followed; 0 while the rig does not run.
    run: AtomicU64,
    /// The number of runs so far.
    runs: AtomicU64,
    /// The stamp of the stream's first frame, ns since the Unix epoch; 0 while it is unknown.
    origin_ns: AtomicU64,
}

impl Link {
    pub(super) fn new(stop: &Stop) -> Self {
        Self { stop: stop.clone(), run: AtomicU64::new(0), runs: AtomicU64::new(0), origin_ns: AtomicU64::new(0) }
    }

    /// Records that a run of the rig is followed from now on. Each has shared memory of its own.
    pub(super) fn begin_run(&self) {
        let run = self.runs.fetch_add(1, Ordering::Relaxed) + 1;
        self.run.store(run, Ordering::Relaxed);
    }

    /// Records that no process of the rig is alive.
    pub(super) fn end_run(&self) {
        self.run.store(0, Ordering::Relaxed);
    }

    /// Records the stamp of the stream's first frame, ns since the Unix epoch; `None` while it is unknown.
    pub(super) fn set_origin(&self, origin_ns: Option<u64>) {
        self.origin_ns.store(origin_ns.unwrap_or(0), Ordering::Relaxed);
    }

    /// Returns the stamp of the stream's first frame, ns since the Unix epoch; `None` while it is unknown.
    pub(super) fn origin_ns(&self) -> Option<u64> {
        Some(self.origin_ns.load(Ordering::Relaxed)).filter(|origin_ns| *origin_ns > 0)
    }
}

/// One run of the rig, as a thread follows it.
#[derive(Debug)]
pub(super) struct Run<'a> {
    pub(super) bus: Bus,
    pub(super) link: &'a Link,
    number: u64,
}

impl Run<'_> {
    /// Whether this run of the rig lasts and the server goes on.
    pub(super) fn is_up(&self) -> bool {
        self.link.run.load(Ordering::Relaxed) == self.number && !self.link.stop.requested()
    }
}

/// Calls `follow` while a run of the rig lasts, and again after it returns, until a stop is requested. Errors are
/// logged.
///
/// Between the calls nothing of the rig is held open, so that its successor can have other limits.
pub(super) fn follow_rig(rig: &str, link: &Link, mut follow: impl FnMut(&Run<'_>) -> Result<(), BusError>) {
    while !link.stop.requested() {
        let number = link.run.load(Ordering::Relaxed);
        if number > 0 {
            match Bus::join(rig, "serve").and_then(|bus| follow(&Run { bus, link, number })) {
                Ok(()) | Err(BusError::NoRig { .. }) => {}
                Err(error) => log::warn!("{error}; trying again"),
            }
        }
        std::thread::sleep(RETRY);
    }
}

/// The receivers of velocities.
pub(super) struct VelocityOutputs<'a> {
    /// The clients of the server.
    pub(super) feed: &'a Feed,
    /// The controller that gets datagrams, if there is one.
    pub(super) datagrams: Option<Datagrams>,
}

/// Sends the rows of `velocity` to those that receive them, until a stop is requested. Without a receiver, they are read
/// and dropped.
pub(super) fn send_velocities(rig: &str, mut context: RowContext, outputs: VelocityOutputs<'_>, link: &Link) {
    let VelocityOutputs { feed, mut datagrams } = outputs;
    follow_rig(rig, link, |run| {
        let topic = run.bus.listen::<VelocityMessage>()?;
        let listener = run.bus.listener("velocity")?;
        while run.is_up() {
            context.origin_ns = link.origin_ns();
            let mut batch = Vec::new();
            while let Some(message) = topic.take()? {
                if let Some(datagrams) = &mut datagrams {
                    datagrams.send(&message);
                }
                if feed.is_followed() {
                    batch.extend(rows::velocity_row(&message, &context));
                }
                if batch.len() >= MAX_BATCH_ROWS {
                    feed.send(&std::mem::take(&mut batch));
                }
            }
            if batch.is_empty() {
                listener.wait(WAIT);
            } else {
                feed.send(&batch);
            }
        }
        Ok(())
    });
}
