//! Letting the frames of a rig go one by one.

use std::io::{BufRead, BufReader, Write};
use std::process::{ChildStdin, ChildStdout};
use std::sync::mpsc::Sender;

/// Ends the rig file on the standard input of a process that goes on reading there.
pub const END_OF_CONFIG: u8 = 0;

/// What leads a rig whose camera is stepped. Dropped, it ends the stream.
#[derive(Debug)]
pub struct Reins {
    steps: ChildStdin,
    told: BufReader<ChildStdout>,
}

impl Reins {
    /// Waits until the rig is ready for its first frame; `false` when it has ended.
    pub fn is_ready(&mut self) -> bool {
        self.hears()
    }

    /// Lets a frame go and waits until it is published; `false` when the rig has ended.
    pub fn step(&mut self) -> bool {
        self.steps.write_all(b"\n").is_ok() && self.hears()
    }

    fn hears(&mut self) -> bool {
        let mut line = String::new();
        self.told.read_line(&mut line).is_ok_and(|bytes| bytes > 0)
    }
}

/// Tells whoever leads.
pub(super) fn tell(line: &str) {
    let mut out = std::io::stdout().lock();
    // Nobody need listen.
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}

/// Gives the reins of a process to who asked for them, else to whoever sits at the terminal.
pub(super) fn hand_over(mut steps: ChildStdin, told: Option<ChildStdout>, to: Option<&Sender<Reins>>) {
    match to.zip(told) {
        Some((to, told)) => {
            // One who no longer wants them drops them, which ends the stream.
            let _ = to.send(Reins { steps, told: BufReader::new(told) });
        }
        None => {
            std::thread::spawn(move || std::io::copy(&mut std::io::stdin(), &mut steps));
        }
    }
}
