//! The frames that a warning names.

use std::fmt;

/// The maximum number of frames that are named.
const MAX_NAMED: usize = 4;

/// Numbers of frames, of which the first few and the last are named.
#[derive(Debug, Clone, Default)]
pub(super) struct FrameNumbers {
    pub(super) count: u64,
    first: Vec<u64>,
    pub(super) last: u64,
}

impl FrameNumbers {
    /// Adds the number of a frame.
    pub(super) fn push(&mut self, number: u64) {
        if self.first.len() < MAX_NAMED {
            self.first.push(number);
        }
        self.last = number;
        self.count += 1;
    }
}

impl fmt::Display for FrameNumbers {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.first.iter().map(u64::to_string).collect();
        formatter.write_str(if self.count == 1 { "number " } else { "numbers " })?;
        formatter.write_str(&numbers.join(", "))?;
        if self.count > self.first.len() as u64 {
            write!(formatter, " ... {}", self.last)?;
        }
        Ok(())
    }
}
