//! The heartbeat of the page's process, which shows its supervisor that the server answers.

use super::clock::now;
use crate::bus::{Bus, BusError, Publisher};
use crate::message::{Role, StatusMessage};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The interval of the heartbeats.
const PERIOD: Duration = Duration::from_millis(200);

/// The number of times that the server's thread has taken its turn.
#[derive(Debug, Clone, Default)]
pub(super) struct TurnCounter(Arc<AtomicU64>);

impl TurnCounter {
    /// Counts a turn of the server's thread every [`PERIOD`], which stops when the thread hangs. It never ends.
    pub(super) async fn count_turns(self) {
        loop {
            self.0.fetch_add(1, Ordering::Relaxed);
            tokio::time::sleep(PERIOD).await;
        }
    }
}

/// Publishes the heartbeat as a status message.
#[derive(Debug)]
pub(super) struct Heartbeat {
    turns: TurnCounter,
    status: Publisher<StatusMessage>,
    /// The number of turns at the last heartbeat, and its time.
    last: (u64, Instant),
}

impl Heartbeat {
    /// Opens the status of a running rig.
    pub(super) fn new(bus: &Bus, turns: TurnCounter) -> Result<Self, BusError> {
        Ok(Self { turns, status: bus.guest_publisher()?, last: (0, now()) })
    }

    /// Publishes a status, at most once per [`PERIOD`], if the server has taken a turn since the last one.
    pub(super) fn publish_if_due(&mut self) -> Result<(), BusError> {
        let turns = self.turns.0.load(Ordering::Relaxed);
        if turns == self.last.0 || self.last.1.elapsed() < PERIOD {
            return Ok(());
        }
        self.last = (turns, now());
        let (role, pid) = (Role::Serve as u32, std::process::id());
        self.status.send(&StatusMessage { role, pid, ..StatusMessage::default() })
    }
}
