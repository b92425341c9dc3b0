//! The requests to a running rig and their answers.

use super::layout::described;
use crate::results::named_enum;
use iceoryx2::prelude::ZeroCopySend;

named_enum! {
    /// A request to a running rig.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::Command;
    ///
    /// // The names are those of the subcommands.
    /// let command: Command = "trigger".parse()?;
    /// assert_eq!(command, Command::Trigger);
    /// assert_eq!(Command::Disarm.as_str(), "disarm");
    /// # Ok::<(), ricochet::results::UnknownName>(())
    /// ```
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
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::ReplyCode;
    ///
    /// assert_eq!(ReplyCode::NotArmed.as_str(), "the rig is disarmed; arm it first");
    /// // A number that this version does not know.
    /// assert_eq!(ReplyCode::from_number(99), None);
    /// ```
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
    ///
    /// # Examples
    ///
    /// ```no_run
    /// use ricochet::bus::Bus;
    /// use ricochet::message::{Command, ReplyCode};
    /// use std::time::Duration;
    ///
    /// let bus = Bus::join("lacrosse", "example")?;
    /// if let Some(reply) = bus.control_client()?.ask(Command::Trigger, Duration::from_secs(2))? {
    ///     match ReplyCode::from_number(reply.code) {
    ///         Some(ReplyCode::Accepted) => println!("triggered; {} shots were recorded before", reply.recordings),
    ///         Some(refused) => println!("{}", refused.as_str()),
    ///         None => println!("answer {}", reply.code),
    ///     }
    /// }
    /// # Ok::<(), ricochet::bus::BusError>(())
    /// ```
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
