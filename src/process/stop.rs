//! Asking a loop to end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that several loops share: set once, never cleared.
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
    /// A flag that is also raised when the process that started this one is gone.
    pub fn with_parent() -> Self {
        Self { parent: Some(std::os::unix::process::parent_id()), ..Self::default() }
    }

    /// The flag itself, for a signal handler.
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.flag)
    }

    /// Raises it.
    pub fn request(&self) {
        self.flag.store(true, Ordering::Relaxed);
    }

    /// Whether it was raised.
    pub fn requested(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
            || self.parent.is_some_and(|parent| std::os::unix::process::parent_id() != parent)
    }
}
