//! The pipe from a supervisor to a process that it starts, which is the process's standard input.
//!
//! It carries the rig file, then single bytes: a step of a stepped camera, the last step, the regular end. Its end
//! shows the process that the supervisor is gone, however it ended and whenever that happened. So a process can neither
//! miss the death of its supervisor nor mistake a signal from elsewhere for the regular end.

use super::stop::Stop;
use rustix::process::{Signal, getpid, kill_process};
use std::io::{BufRead, Read, Write};
use std::process::ChildStdin;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

/// Ends the rig file.
const END_OF_CONFIG: u8 = 0;
/// Plays the next frame.
const STEP: u8 = b'\n';
/// Ends a stepped stream.
const LAST_STEP: u8 = b'.';
/// Ends the process regularly.
const END: u8 = b'q';
/// Time for a process to end by itself once its supervisor is gone.
const GRACE: Duration = Duration::from_secs(2);

/// The supervisor's end of the pipe.
#[derive(Debug, Clone)]
pub(super) struct SupervisorPipe(Sender<u8>);

impl SupervisorPipe {
    /// Sends the rig file, and keeps the pipe open for single bytes. A process that has died already receives nothing,
    /// which its end shows.
    ///
    /// A thread writes, so that a process that does not read cannot stop its supervisor.
    pub(super) fn open(mut stdin: ChildStdin, config: &str) -> Self {
        let (sender, receiver) = channel();
        let mut config = config.as_bytes().to_vec();
        config.push(END_OF_CONFIG);
        std::thread::spawn(move || {
            let mut written = stdin.write_all(&config);
            while let (Ok(()), Ok(byte)) = (&written, receiver.recv()) {
                written = stdin.write_all(&[byte]);
            }
        });
        Self(sender)
    }

    /// Asks the process to end regularly.
    pub(super) fn end(&self) {
        let _ = self.0.send(END);
    }

    /// Plays the next frame of a stepped camera; returns `false` if the process is gone.
    pub(super) fn step(&self) -> bool {
        self.0.send(STEP).is_ok()
    }

    /// Ends the stream of a stepped camera.
    pub(super) fn end_steps(&self) {
        let _ = self.0.send(LAST_STEP);
    }
}

/// Reads the rig file from standard input, up to its end mark or the end of the input.
///
/// # Errors
///
/// If standard input cannot be read or holds no UTF-8.
pub fn read_config() -> std::io::Result<String> {
    let mut bytes = Vec::new();
    std::io::stdin().lock().read_until(END_OF_CONFIG, &mut bytes)?;
    bytes.pop_if(|last| *last == END_OF_CONFIG);
    String::from_utf8(bytes).map_err(std::io::Error::other)
}

/// Follows the supervisor on a thread of its own. Returns a channel with one message per step of a stepped camera,
/// which closes after the last step.
///
/// Once the supervisor is gone, a stop is requested, and a process that does not end soon is killed.
pub fn follow_supervisor(stop: &Stop) -> Receiver<()> {
    let (steps, receiver) = channel();
    let stop = stop.clone();
    std::thread::spawn(move || {
        let mut steps = Some(steps);
        for byte in std::io::stdin().lock().bytes().map_while(Result::ok) {
            match (byte, &steps) {
                (STEP, Some(steps)) => {
                    // Sending fails once the camera is dropped.
                    let _ = steps.send(());
                }
                (LAST_STEP, _) => steps = None,
                (END, _) => stop.request(),
                _ => {}
            }
        }
        stop.abandon();
        std::thread::sleep(GRACE);
        let _ = kill_process(getpid(), Signal::KILL);
    });
    receiver
}
