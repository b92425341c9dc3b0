//! The clock of the main loops. It controls reports and timeouts, never measurements.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Returns the present time, for waiting and rates.
#[expect(clippy::disallowed_methods, reason = "controls reports and timeouts, never measurements")]
pub(super) fn now() -> Instant {
    Instant::now()
}

/// Returns the present time in ns since the Unix epoch, for latencies and run ids.
#[expect(clippy::disallowed_methods, reason = "latencies compare the host's clock with frame stamps")]
pub fn host_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}

/// A timer for periodic work.
#[derive(Debug)]
pub(super) struct PeriodicTimer {
    period: Duration,
    last: Option<Instant>,
}

impl PeriodicTimer {
    pub(super) fn new(period: Duration) -> Self {
        Self { period, last: None }
    }

    /// Returns whether the period has passed, and then starts the next one; the first call always does.
    pub(super) fn restart_if_due(&mut self) -> bool {
        let due = self.last.is_none_or(|last| last.elapsed() >= self.period);
        if due {
            self.last = Some(now());
        }
        due
    }
}

/// A timeout that can be renewed.
#[derive(Debug)]
pub(super) struct Timeout {
    limit: Duration,
    since: Instant,
}

impl Timeout {
    pub(super) fn new(limit: Duration) -> Self {
        Self { limit, since: now() }
    }

    /// Starts the timeout again.
    pub(super) fn renew(&mut self) {
        self.since = now();
    }

    pub(super) fn has_expired(&self) -> bool {
        self.since.elapsed() >= self.limit
    }
}
