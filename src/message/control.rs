//! Requests to a running rig and their answers.

use iceoryx2::prelude::ZeroCopySend;

/// What a rig can be asked to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Command {
    /// Wait for a trigger.
    Arm = 1,
    /// Ignore triggers.
    Disarm = 2,
    /// Record a shot around this moment.
    Trigger = 3,
    /// Only answer.
    Status = 4,
}

impl Command {
    /// The command with this number, if there is one.
    pub fn from_number(number: u32) -> Option<Self> {
        [Self::Arm, Self::Disarm, Self::Trigger, Self::Status].into_iter().find(|command| *command as u32 == number)
    }
}

/// How a request was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum ReplyCode {
    /// Done, or under way.
    Accepted = 1,
    /// Triggered while disarmed.
    NotArmed = 2,
    /// A shot is being written.
    Busy = 3,
    /// The rig has no trigger: it records its whole stream, or nothing.
    NoTrigger = 4,
    /// The request was not understood.
    Unknown = 5,
    /// Triggered before the first frame.
    NoFrames = 6,
    /// Shots begin on the camera's own line.
    Line = 7,
}

impl ReplyCode {
    /// The code with this number, if there is one.
    pub fn from_number(number: u32) -> Option<Self> {
        [Self::Accepted, Self::NotArmed, Self::Busy, Self::NoTrigger, Self::Unknown, Self::NoFrames, Self::Line]
            .into_iter()
            .find(|code| *code as u32 == number)
    }

    /// What it means to the person who asked.
    pub fn sentence(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::NotArmed => "the rig is disarmed; arm it first",
            Self::Busy => "the rig is writing a shot; try again when it is done",
            Self::NoTrigger => "this rig has no trigger; set [trigger] mode",
            Self::Unknown => "the rig does not know this request",
            Self::Line => "this rig's shots begin on the camera's line, [trigger] mode = \"hardware\"",
            Self::NoFrames => "no frame has come yet; try again when the camera delivers",
        }
    }
}

/// A request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
#[type_name("ricochet.Request.v1")]
#[repr(C)]
pub struct Request {
    /// Number of the `Command`.
    pub command: u32,
    /// Zero.
    pub reserved: u32,
}

/// Its answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
#[type_name("ricochet.Reply.v1")]
#[repr(C)]
pub struct Reply {
    /// Number of the `ReplyCode`.
    pub code: u32,
    /// 1 when the recorder waits for a trigger.
    pub armed: u32,
    /// Recordings completed since the recorder started.
    pub recordings: u64,
    /// The newest frame the recorder knows of.
    pub sequence: u64,
}
