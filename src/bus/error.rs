//! What can go wrong on the bus.

/// Why shared memory could not be used.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// iceoryx2 refused.
    #[error("{action} {service}: {reason}")]
    Service {
        /// What was tried.
        action: &'static str,
        /// The rig or the service.
        service: String,
        /// The answer.
        reason: String,
    },
    /// No rig of this name is running.
    #[error("no rig named {rig:?} is running ({service} does not exist); start it with `ricochet run`")]
    NoRig {
        /// The name asked for.
        rig: String,
        /// The service that was looked for.
        service: String,
    },
    /// Another process of this rig has the same role.
    #[error("rig {rig:?} has a process `ricochet {role}` already; stop it, or choose another [rig] name")]
    Taken {
        /// The rig.
        rig: String,
        /// The role.
        role: String,
    },
    /// Every process of the rig is gone, and none told the end of the stream.
    #[error("rig {rig:?} died without telling the end of its stream; what it told last may be missing")]
    Died {
        /// The rig.
        rig: String,
    },
    /// The ring does not fit into shared memory.
    #[error(
        "shared memory holds {free_bytes} free bytes, the ring needs {needed_bytes}; lower [trigger] pre_s or the frame size, or enlarge /dev/shm"
    )]
    Memory {
        /// What the ring needs.
        needed_bytes: u64,
        /// What is free.
        free_bytes: u64,
    },
}

impl BusError {
    /// An answer of iceoryx2, in words.
    pub fn new(action: &'static str, service: &str, reason: impl std::fmt::Debug) -> Self {
        Self::Service { action, service: service.to_owned(), reason: format!("{reason:?}") }
    }
}
