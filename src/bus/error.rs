//! The errors of the bus.

use crate::failure::{ExitCode, Fatal};

/// The reason why shared memory could not be used.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::{Bus, BusError};
/// use ricochet::message::VelocityMessage;
///
/// let bus = Bus::join("lacrosse", "example")?;
/// // Waits until somebody starts the rig; other errors do not pass by themselves.
/// let velocities = loop {
///     match bus.listen::<VelocityMessage>() {
///         Err(BusError::NoRig { .. }) => std::thread::sleep(std::time::Duration::from_millis(10)),
///         answer => break answer?,
///     }
/// };
/// # Ok::<(), ricochet::bus::BusError>(())
/// ```
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
    /// The rig runs, but the process that answers requests does not answer.
    #[error(
        "rig {rig:?} is running, but its recorder (process {pid}) does not answer; `ricochet status` shows its state"
    )]
    Silent {
        /// The rig.
        rig: String,
        /// The process.
        pid: u32,
    },
    /// A folder is not private to this user.
    #[error(
        "cannot use {path:?}: {reason}; remove it, or set RICOCHET_RUNTIME_DIR to a folder that only you can enter"
    )]
    Folder {
        /// The folder or a file in it.
        path: std::path::PathBuf,
        /// The reason.
        reason: String,
    },
    /// The rig does not fit into shared memory.
    #[error(
        "shared memory is full: /dev/shm has {free_bytes} bytes free, {needed_bytes} are needed; remove files from /dev/shm or enlarge it, or lower [trigger] pre_s or the frame size"
    )]
    Memory {
        /// The bytes that are needed.
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
    /// Returns the error of an action on a service that failed, with the debug text of the reason.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn new(action: &'static str, service: &str, reason: impl std::fmt::Debug) -> Self {
        Self::Service { action, service: service.to_owned(), reason: format!("{reason:?}") }
    }
}
