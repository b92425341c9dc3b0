//! The request to stop, shared by loops.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag shared by several loops; once set, it is never cleared.
#[derive(Debug, Clone)]
pub struct Stop {
    flag: Arc<AtomicBool>,
    parent: Option<u32>,
}

impl Default for Stop {
    fn default() -> Self {
        Self { flag: Arc::new(AtomicBool::new(false)), parent: None }
    }
}

impl Stop {
    /// Creates a flag that is also set when the parent process is gone.
    pub fn with_parent() -> Self {
        Self { parent: Some(std::os::unix::process::parent_id()), ..Self::default() }
    }

    /// Returns the flag itself, for a signal handler.
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.flag)
    }

    /// Requests to stop.
    pub fn request(&self) {
        self.flag.store(true, Ordering::Relaxed);
    }

    /// Whether a stop was requested.
    pub fn requested(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
            || self.parent.is_some_and(|parent| std::os::unix::process::parent_id() != parent)
    }
}
