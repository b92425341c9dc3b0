//! The requests to a rig: whether each is accepted, and its execution.

use super::Recorder;
use crate::config::TriggerMode;
use crate::failure::Failure;
use crate::message::{Command, Reply, ReplyCode};

/// The state of a recorder on which its answers depend.
#[derive(Debug, Clone, Copy)]
struct RecorderState {
    mode: TriggerMode,
    is_armed: bool,
    /// Whether a shot is being written.
    is_busy: bool,
    has_frames: bool,
}

impl RecorderState {
    /// Returns the code of the reply to a request; `None` stands for an unknown request.
    fn reply_code(self, command: Option<Command>) -> ReplyCode {
        let is_off = self.mode == TriggerMode::Off;
        let is_hardware = self.mode == TriggerMode::Hardware;
        match command {
            Some(Command::Status) => ReplyCode::Accepted,
            None => ReplyCode::Unknown,
            Some(_) if is_off => ReplyCode::NoTrigger,
            Some(Command::Trigger) if is_hardware => ReplyCode::HardwareTrigger,
            Some(Command::Trigger) if self.is_busy => ReplyCode::Busy,
            Some(Command::Trigger) if !self.is_armed => ReplyCode::NotArmed,
            Some(Command::Trigger) if !self.has_frames => ReplyCode::NoFrames,
            Some(_) => ReplyCode::Accepted,
        }
    }
}

impl Recorder<'_> {
    /// Answers all pending requests. Each accepted one is carried out before the next one is answered.
    pub(super) fn answer_requests(&mut self) -> Result<(), Failure> {
        while let Some(request) = self.control.take()? {
            let state = self.state();
            let (command, code) = (request.command(), state.reply_code(request.command()));
            request.answer(Reply {
                code: code as u32,
                armed: u32::from(state.is_armed),
                recordings: self.summary.recordings.len() as u64,
                sequence: self.feeds[0].newest.sequence,
            });
            if let Some(command) = command.filter(|_| code == ReplyCode::Accepted) {
                self.execute_command(command)?;
            }
        }
        Ok(())
    }

    /// Returns the present state on which answers depend.
    fn state(&self) -> RecorderState {
        RecorderState {
            mode: self.config.trigger.mode,
            is_armed: self.armed,
            is_busy: self.shot.is_some(),
            has_frames: self.feeds[0].stream.first.is_some(),
        }
    }

    /// Executes an accepted request.
    fn execute_command(&mut self, command: Command) -> Result<(), Failure> {
        match command {
            Command::Status => Ok(()),
            Command::Trigger => self.trigger(None, "software"),
            Command::Arm | Command::Disarm => {
                // A request during a shot also holds after it, whatever `rearm` says.
                self.requested_arming = Some(command).filter(|_| self.shot.is_some()).or(self.requested_arming);
                self.arm(command)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trigger_is_accepted_by_an_armed_idle_recorder_with_frames_alone() {
        let ready = RecorderState { mode: TriggerMode::Software, is_armed: true, is_busy: false, has_frames: true };
        let trigger = Some(Command::Trigger);
        assert_eq!(ready.reply_code(trigger), ReplyCode::Accepted);
        for (state, code) in [
            (RecorderState { is_busy: true, ..ready }, ReplyCode::Busy),
            (RecorderState { is_armed: false, ..ready }, ReplyCode::NotArmed),
            (RecorderState { has_frames: false, ..ready }, ReplyCode::NoFrames),
            (RecorderState { mode: TriggerMode::Hardware, ..ready }, ReplyCode::HardwareTrigger),
            (RecorderState { mode: TriggerMode::Off, ..ready }, ReplyCode::NoTrigger),
        ] {
            assert_eq!(state.reply_code(trigger), code, "{state:?}");
            assert_eq!(
                (state.reply_code(Some(Command::Status)), state.reply_code(None)),
                (ReplyCode::Accepted, ReplyCode::Unknown)
            );
        }
        let busy = RecorderState { is_busy: true, has_frames: false, ..ready };
        assert_eq!(
            [Command::Arm, Command::Disarm].map(|command| busy.reply_code(Some(command))),
            [ReplyCode::Accepted; 2]
        );
    }
}
