//! A process of a rig, as its supervisor sees it.

use super::heartbeat::Heartbeat;
use super::restarts::RecentDeaths;
use crate::bus;
use crate::failure::{ExitCode, Fatal};
use crate::message::Role;
use crate::process::supervisor_pipe::SupervisorPipe;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child as Process, ExitStatus};

/// Signal of a process whose memory the system could not provide.
const SIGBUS: i32 = 7;
/// Exit code of a process that could not use shared memory.
const BUS_FAILURE: i32 = ExitCode::Bus as i32;
/// Free shared memory that every process of a rig finds enough, bytes.
const SCARCE_BYTES: u64 = 128 << 20;

/// A process of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Child {
    /// Index of its camera: 0 the main one, then the views in their order.
    pub camera: u32,
    /// Its role.
    pub role: Role,
    /// Index among processes of the same role.
    pub index: u32,
}

impl Child {
    /// Returns the only, or first, process of this role for the main camera.
    pub const fn first(role: Role) -> Self {
        Self { camera: 0, role, index: 0 }
    }
}

/// A process of the rig failed, and the rig cannot continue.
#[derive(Debug, thiserror::Error)]
#[error("`ricochet {role}` ended with exit code {code}")]
pub(super) struct ChildFailure {
    /// Its subcommand.
    pub(super) role: &'static str,
    /// Its exit code.
    pub(super) code: i32,
    /// Whether the process itself has printed the reason.
    pub(super) is_reported: bool,
}

impl Fatal for ChildFailure {
    fn exit_code(&self) -> ExitCode {
        ExitCode::from_number(self.code)
    }

    fn is_reported(&self) -> bool {
        self.is_reported
    }
}

/// Whether a supervisor also serves the page of the rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Page {
    /// It does not.
    #[default]
    None,
    /// It does.
    Served,
}

/// Whether a process starts with the rig or replaces one that died.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Start {
    /// It starts with the rig.
    First,
    /// It replaces one that died.
    Again,
}

/// A process of the rig as its supervisor sees it.
#[derive(Debug, Default)]
pub(super) struct Running {
    pub(super) process: Option<Process>,
    /// The pipe to the process.
    pub(super) pipe: Option<SupervisorPipe>,
    pub(super) deaths: RecentDeaths,
    pub(super) heartbeat: Heartbeat,
    /// Whether the process died and waits for free memory before it is started again.
    pub(super) waits_for_memory: bool,
    /// The free shared memory when it was started, bytes.
    pub(super) free_at_start_bytes: u64,
    /// The free shared memory that it waits for, in addition to what every process needs, bytes.
    pub(super) wanted_bytes: u64,
    /// Exit code of its last regular end.
    pub(super) code: Option<i32>,
}

impl Running {
    /// Whether the process runs, or is about to be started again.
    pub(super) fn is_alive(&self) -> bool {
        self.process.is_some() || self.waits_for_memory
    }

    /// Returns whether the process died because there was too little shared memory. If it was started with little, sets
    /// that it waits for a quarter more.
    pub(super) fn check_lack_of_memory(&mut self, status: ExitStatus) -> bool {
        let is_suspect = status.signal() == Some(SIGBUS) || status.code() == Some(BUS_FAILURE);
        let was_scarce = self.free_at_start_bytes < SCARCE_BYTES;
        self.wanted_bytes = if is_suspect && was_scarce { self.free_at_start_bytes / 4 * 5 } else { 0 };
        is_suspect && (was_scarce || bus::check_room(0, 1).is_err())
    }

    /// Whether the process waits for shared memory, and there is enough for it now.
    pub(super) fn has_room(&self) -> bool {
        self.waits_for_memory && bus::check_room(self.wanted_bytes, 1).is_ok()
    }

    /// Whether the process runs and has this process id.
    pub(super) fn is_process(&self, pid: u32) -> bool {
        self.process.as_ref().is_some_and(|process| process.id() == pid)
    }
}
