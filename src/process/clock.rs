//! The only clock of the main loops: when to tell, when to give up, never what was measured.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Now, for waiting and rates.
#[expect(clippy::disallowed_methods, reason = "decides when loops report and give up, never what they measure")]
pub(super) fn now() -> Instant {
    Instant::now()
}

/// Now in ns since the Unix epoch, for latencies and for telling one run from another.
#[expect(clippy::disallowed_methods, reason = "latencies compare the host's clock with frame stamps")]
pub fn host_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}

/// Something that is due every so often.
#[derive(Debug)]
pub(super) struct Every {
    period: Duration,
    last: Option<Instant>,
}

impl Every {
    pub(super) fn new(period: Duration) -> Self {
        Self { period, last: None }
    }

    /// Whether it is due; then it counts as done. Due at once the first time.
    pub(super) fn due(&mut self) -> bool {
        let due = self.last.is_none_or(|last| last.elapsed() >= self.period);
        if due {
            self.last = Some(now());
        }
        due
    }
}

/// A time after which to give up, moved on by every sign of life.
#[derive(Debug)]
pub(super) struct Patience {
    limit: Duration,
    since: Instant,
}

impl Patience {
    pub(super) fn new(limit: Duration) -> Self {
        Self { limit, since: now() }
    }

    pub(super) fn renew(&mut self) {
        self.since = now();
    }

    pub(super) fn is_over(&self) -> bool {
        self.since.elapsed() >= self.limit
    }
}
