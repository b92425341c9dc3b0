//! The heartbeat of a process: its status messages, which its main loop publishes several times per second.

/// Number of polls of the supervisor without a heartbeat after which a process counts as hung; 10 s.
///
/// Polls are counted instead of time, so that a supervisor that was itself stopped blames nobody.
const MAX_SILENT_POLLS: u32 = 500;

/// The heartbeat of a process.
#[derive(Debug, Default)]
pub(super) struct Heartbeat {
    /// Polls since the last status; `None` before the first, because a camera may take long to open.
    silent_polls: Option<u32>,
}

impl Heartbeat {
    /// Records a status message.
    pub(super) fn record(&mut self) {
        self.silent_polls = Some(0);
    }

    /// Counts a poll of a process whose state in the system is `state` (see [`process_state`]), unless it waits for a
    /// disk; returns whether it counts as hung now.
    pub(super) fn count_poll(&mut self, state: Option<char>) -> bool {
        let Some(polls) = &mut self.silent_polls else { return false };
        // Waiting for a disk is no fault of the process, and a kill would have to wait as well.
        if state != Some('D') {
            *polls += 1;
        }
        *polls >= MAX_SILENT_POLLS
    }
}

/// Returns the state of a process as in `proc_pid_stat(5)`: `R`unning, `S`leeping, `D`isk, s`T`opped, `Z`ombie. `None`
/// if there is no such process.
pub(super) fn process_state(pid: u32) -> Option<char> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit_once(") ")?.1.chars().next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_without_a_heartbeat_is_hung_unless_it_starts_or_waits_for_a_disk() {
        let polls = 0..2 * MAX_SILENT_POLLS;
        let mut starting = Heartbeat::default();
        assert!(polls.clone().all(|_| !starting.count_poll(Some('S'))));
        let mut writing = Heartbeat::default();
        writing.record();
        assert!(polls.clone().all(|_| !writing.count_poll(Some('D'))));
        assert_eq!(polls.clone().find(|_| writing.count_poll(Some('T'))), Some(MAX_SILENT_POLLS - 1));
        writing.record();
        assert!(!writing.count_poll(Some('S')));
        assert!(process_state(std::process::id()).is_some_and(char::is_alphabetic));
    }
}
