//! The terminal: output, outcomes, progress bars.

mod output;
pub mod progress;

pub use output::{Outcome, UsageError, say, table};
