//! The wait of a loop for new data.

use crate::bus::TopicListener;
use crate::config::WorkerMode;
use std::time::Duration;

/// Maximum wait for a notification.
const LONGEST: Duration = Duration::from_millis(2);
/// Interval of looking for data where the shortest delay counts. Notifications come at most once per millisecond.
const POLL_PERIOD: Duration = Duration::from_micros(50);

/// The wait of a loop for new data.
#[derive(Debug)]
pub(super) struct Waiting {
    listener: TopicListener,
    mode: WorkerMode,
}

impl Waiting {
    /// Waits for the notifications of a topic, or polls in the mode for the shortest delay.
    pub(super) fn new(listener: TopicListener, mode: WorkerMode) -> Self {
        Self { listener, mode }
    }

    /// Waits a little for new data, which may not have come then.
    pub(super) fn wait(&self) {
        match self.mode {
            WorkerMode::Throughput => self.listener.wait(LONGEST),
            WorkerMode::Latency => std::thread::sleep(POLL_PERIOD),
        }
    }
}
