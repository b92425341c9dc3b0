//! The requests to a running rig and their answers.

use super::layout::described;
use crate::results::named_enum;
use iceoryx2::prelude::ZeroCopySend;

named_enum! {
    /// A request to a running rig.
    Command: "request" {
        /// Wait for a trigger.
        Arm = 1 "arm",
        /// Ignore triggers.
        Disarm = 2 "disarm",
        /// Record a shot around this moment.
        Trigger = 3 "trigger",
        /// Only answer.
        Status = 4 "status",
    }
}

named_enum! {
    /// The answer to a request; its name is a sentence for the person who asked.
    ReplyCode: "answer" {
        /// Done, or under way.
        Accepted = 1 "accepted",
        /// Triggered while disarmed.
        NotArmed = 2 "the rig is disarmed; arm it first",
        /// A shot is being written.
        Busy = 3 "the rig is writing a shot; try again when it is done",
        /// The rig has no trigger: it records its whole stream, or nothing.
        NoTrigger = 4 "this rig has no trigger; set [trigger] mode",
        /// The request was not understood.
        Unknown = 5 "the rig does not know this request",
        /// Triggered before the first frame.
        NoFrames = 6 "no frame has come yet; try again when the camera delivers",
        /// Shots begin on the camera's own line.
        HardwareTrigger = 7 "this rig's shots begin on the camera's line, [trigger] mode = \"hardware\"",
    }
}

described! {
    "ricochet.Request.v1"
    /// A request.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct Request {
        /// The number of the `Command`.
        pub command: u32,
        /// Zero.
        pub reserved: u32,
    }
}

described! {
    "ricochet.Reply.v1"
    /// The answer to a request.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct Reply {
        /// The number of the `ReplyCode`.
        pub code: u32,
        /// 1 when the recorder waits for a trigger, else 0.
        pub armed: u32,
        /// The number of recordings completed since the recorder started.
        pub recordings: u64,
        /// The sequence number of the newest frame of the recorder's shots.
        pub sequence: u64,
    }
}
