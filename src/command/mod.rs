//! What a person runs and waits for, one file a command.

pub mod cameras;

use std::io::Write;

/// Writes a line to standard output; a reader that went away is no error.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}
