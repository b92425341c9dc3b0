//! A process of a rig, as its supervisor sees it.

use super::heartbeat::Heartbeat;
use super::restarts::RecentDeaths;
use crate::message::Role;
use crate::process::line::Line;
use std::process::Child as Process;

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

/// Whether a supervisor also serves the page that the rig file asks for.
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
    First,
    Again,
}

/// A process of the rig as its supervisor sees it.
#[derive(Debug, Default)]
pub(super) struct Running {
    pub(super) process: Option<Process>,
    /// The pipe to the process.
    pub(super) line: Option<Line>,
    pub(super) deaths: RecentDeaths,
    pub(super) heartbeat: Heartbeat,
    /// Whether it died and waits for free memory before it is started again.
    pub(super) waits_for_memory: bool,
    /// Exit code of its last regular end.
    pub(super) code: Option<i32>,
}

impl Running {
    pub(super) fn is_alive(&self) -> bool {
        self.process.is_some() || self.waits_for_memory
    }

    /// Whether this is still the process with that number.
    pub(super) fn is_process(&self, pid: u32) -> bool {
        self.process.as_ref().is_some_and(|process| process.id() == pid)
    }
}
