//! The errors of the bus.

use crate::failure::{ExitCode, Fatal};

/// The reason why shared memory could not be used.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// iceoryx2 refused.
    #[error("cannot {action} {service}: {reason}")]
    Service {
        /// The action that failed.
        action: &'static str,
        /// The rig or the service.
        service: String,
        /// The reason given by iceoryx2.
        reason: String,
    },
    /// No rig of this name is running.
    #[error("no rig named {rig:?} is running ({service} does not exist); start it with `ricochet run`")]
    NoRig {
        /// The name.
        rig: String,
        /// The service that does not exist.
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
    /// All processes of the rig are gone, and the end of the stream was not announced.
    #[error("rig {rig:?} exited without closing its stream; its last results may be missing")]
    Died {
        /// The rig.
        rig: String,
    },
    /// The ring does not fit into shared memory.
    #[error(
        "shared memory holds {free_bytes} free bytes, the ring needs {needed_bytes}; lower [trigger] pre_s or the frame size, or enlarge /dev/shm"
    )]
    Memory {
        /// The bytes that the ring needs.
        needed_bytes: u64,
        /// The bytes that are free.
        free_bytes: u64,
    },
}

impl Fatal for BusError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Bus
    }
}

impl BusError {
    /// An error of iceoryx2.
    pub fn new(action: &'static str, service: &str, reason: impl std::fmt::Debug) -> Self {
        Self::Service { action, service: service.to_owned(), reason: format!("{reason:?}") }
    }
}
