//! The threads that read the bus, one per topic, and hand over to the server.
//!
//! They are plain threads, because a wait on shared memory would stop every client of the server.

use super::feed::{BATCH_ROWS, Feed};
use super::rows::{self, RowContext};
use crate::bus::{Bus, BusError};
use crate::message::VelocityMessage;
use crate::process::Stop;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// The maximum wait for a notification.
const WAIT: Duration = Duration::from_millis(20);
/// Interval of looking for a rig that is not running.
const RETRY: Duration = Duration::from_millis(200);

/// The facts about the rig that the threads share.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) stop: Stop,
    is_running: AtomicBool,
    /// The stamp of the stream's first frame, ns since the Unix epoch; 0 while it is unknown.
    origin_ns: AtomicU64,
}

impl Link {
    pub(super) fn new(stop: &Stop) -> Self {
        Self { stop: stop.clone(), is_running: AtomicBool::new(false), origin_ns: AtomicU64::new(0) }
    }

    /// Notes whether a process of the rig is alive, and when its stream began.
    pub(super) fn set(&self, is_running: bool, origin_ns: Option<u64>) {
        self.is_running.store(is_running, Ordering::Relaxed);
        self.origin_ns.store(origin_ns.unwrap_or(0), Ordering::Relaxed);
    }

    /// Whether the rig runs and the server goes on.
    pub(super) fn is_up(&self) -> bool {
        self.is_running.load(Ordering::Relaxed) && !self.stop.requested()
    }

    pub(super) fn origin_ns(&self) -> Option<u64> {
        Some(self.origin_ns.load(Ordering::Relaxed)).filter(|origin_ns| *origin_ns > 0)
    }
}

/// Calls `follow` whenever the rig runs, until a stop is requested.
///
/// Between the calls nothing of the rig is held open, so that its successor can have other limits.
pub(super) fn follow_rig(rig: &str, link: &Link, mut follow: impl FnMut(&Bus) -> Result<(), BusError>) {
    while !link.stop.requested() {
        if link.is_up() {
            match Bus::join(rig, "serve").and_then(|bus| follow(&bus)) {
                Ok(()) | Err(BusError::NoRig { .. }) => {}
                Err(error) => log::warn!("{error}; trying again"),
            }
        }
        std::thread::sleep(RETRY);
    }
}

/// Sends the rows of `velocity` to the clients that follow them.
pub(super) fn velocities(rig: &str, mut context: RowContext, feed: &Feed, link: &Link) {
    follow_rig(rig, link, |bus| {
        let topic = bus.listen::<VelocityMessage>()?;
        let ear = bus.ear("velocity")?;
        while link.is_up() {
            context.origin_ns = link.origin_ns();
            let mut batch = Vec::new();
            while let Some(message) = topic.take()? {
                if feed.is_followed() {
                    batch.extend(rows::velocity(&message, &context));
                }
                if batch.len() >= BATCH_ROWS {
                    feed.send(&std::mem::take(&mut batch));
                }
            }
            if batch.is_empty() {
                ear.wait(WAIT);
            } else {
                feed.send(&batch);
            }
        }
        Ok(())
    });
}
