//! The terminal and the output files: text, outcomes, progress bars.

mod files;
mod output;
pub mod progress;

pub use files::{OutputFile, Overwrite, WriteError, check_no_input, create_directory, write_file};
pub use output::{Outcome, UsageError, print_line, print_note, table, wrapped};
