//! Frame-by-frame control of a rig with a stepped camera.

use super::supervisor_pipe::SupervisorPipe;
use std::io::{BufRead, BufReader, Write};
use std::process::ChildStdout;
use std::sync::mpsc::Sender;

/// Controls a rig whose camera is stepped. Dropping it ends the stream.
#[derive(Debug)]
pub struct StepControl {
    pipe: SupervisorPipe,
    answers: BufReader<ChildStdout>,
}

impl StepControl {
    /// Waits until the rig is ready for its first frame; returns `false` if it has ended.
    pub fn wait_until_ready(&mut self) -> bool {
        self.read_answer()
    }

    /// Plays a frame and waits until it is published; returns `false` if the rig has ended.
    pub fn step(&mut self) -> bool {
        self.pipe.step() && self.read_answer()
    }

    /// Waits for the next line of the camera's process; returns `false` if the process has ended.
    fn read_answer(&mut self) -> bool {
        let mut line = String::new();
        self.answers.read_line(&mut line).is_ok_and(|bytes| bytes > 0)
    }
}

impl Drop for StepControl {
    fn drop(&mut self) {
        self.pipe.end_steps();
    }
}

/// Prints an answer to the controlling program.
pub(super) fn print_answer(line: &str) {
    let mut out = std::io::stdout().lock();
    // The controlling program may have closed the pipe.
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}

/// Sends the control of a process to `leader`, the program that requested it; without one, each line on standard input
/// plays a frame.
pub(super) fn connect(pipe: &SupervisorPipe, answers: Option<ChildStdout>, leader: Option<&Sender<StepControl>>) {
    let pipe = pipe.clone();
    match leader.zip(answers) {
        Some((leader, answers)) => {
            // If the leader has gone, dropping the control ends the stream.
            let _ = leader.send(StepControl { pipe, answers: BufReader::new(answers) });
        }
        None => {
            std::thread::spawn(move || {
                let mut lines = std::io::stdin().lines().map_while(Result::ok);
                while lines.next().is_some_and(|_| pipe.step()) {}
                pipe.end_steps();
            });
        }
    }
}
