//! The request to stop, shared by loops.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag shared by several loops; once set, it is never cleared.
#[derive(Debug, Clone, Default)]
pub struct Stop {
    flag: Arc<AtomicBool>,
    abandoned: Arc<AtomicBool>,
}

impl Stop {
    /// Requests to stop.
    pub fn request(&self) {
        self.flag.store(true, Ordering::Relaxed);
    }

    /// Requests to stop at once, without waiting for other processes of the rig.
    pub fn abandon(&self) {
        self.abandoned.store(true, Ordering::Relaxed);
        self.request();
    }

    /// Whether a stop was requested.
    pub fn requested(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
    }

    /// Whether the supervisor is gone, and with it the rig.
    pub fn is_abandoned(&self) -> bool {
        self.abandoned.load(Ordering::Relaxed)
    }
}
