//! The `status` topic (a few times a second) and the progress that holds back on-demand sources.

use iceoryx2::prelude::ZeroCopySend;

/// A process of a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u32)]
pub enum Role {
    /// Fills the ring.
    Acquire = 1,
    /// Measures blocks of frames.
    Correlate = 2,
    /// Puts them in order.
    Track = 3,
    /// Writes recordings.
    Record = 4,
    /// Watches the others.
    Supervise = 5,
}

impl Role {
    /// Every role.
    pub const ALL: [Self; 5] = [Self::Acquire, Self::Correlate, Self::Track, Self::Record, Self::Supervise];

    /// The subcommand that runs it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Acquire => "acquire",
            Self::Correlate => "correlate",
            Self::Track => "track",
            Self::Record => "record",
            Self::Supervise => "run",
        }
    }

    /// The role with this number, if there is one.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|role| *role as u32 == number)
    }
}

/// How one process of the rig is doing; all counts since it started.
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("ricochet.Status.v1")]
#[repr(C)]
pub struct StatusMessage {
    /// Which start of the acquire process it works on.
    pub run_id: u64,
    /// Number of the `Role`.
    pub role: u32,
    /// Which of several (workers), from 0.
    pub index: u32,
    /// Process id.
    pub pid: u32,
    /// Camera: the epoch of its frames. Recorder: 1 when armed, and 2 added when recordings would not fit or cannot be written. Supervisor: how many of its processes run.
    pub state: u32,
    /// Newest sequence number dealt with.
    pub sequence: u64,
    /// Newest stamp dealt with, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Frames (or rows) taken in.
    pub taken: u64,
    /// Frames (or rows) given out.
    pub given: u64,
    /// Lost before they arrived here: camera gaps, overrun queues.
    pub lost: u64,
    /// Lost here: no free slot, torn frames, late rows.
    pub dropped: u64,
    /// Processes started again after they died (supervisor).
    pub restarts: u64,
    /// Entries waiting in this process's queue when it last looked.
    pub waiting: u64,
    /// Size of that queue.
    pub capacity: u64,
    /// Frames a second since the last status.
    pub rate_hz: f64,
    /// Host time minus frame stamp of the last piece of work, s; 0 when the source is not live.
    pub latency_s: f64,
}

/// How far one reader of the frames has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
#[type_name("ricochet.Progress.v1")]
#[repr(C)]
pub struct Progress {
    /// The run it has attached to.
    pub run_id: u64,
    /// One past the newest frame it is done with.
    pub next_sequence: u64,
    /// Number of the `Role`.
    pub role: u32,
    /// Which of several (workers), from 0.
    pub index: u32,
    /// 1 when it will take no more.
    pub done: u32,
    /// Zero.
    pub reserved: u32,
}
