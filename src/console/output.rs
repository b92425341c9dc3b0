//! The output and the outcome of a command.

use crate::failure::{ExitCode, Fatal};
use crate::process::{RigLosses, Summary};
use std::io::Write;
use std::path::Path;

/// The outcome of a command that did not fail.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing was lost.
    Clean,
    /// The command finished, but data were lost.
    Lost {
        /// The number of lost frames, rows or messages; 0 if a process died without losing any.
        count: u64,
        /// The place and reason of the loss, if known.
        cause: Option<String>,
    },
    /// A rig finished, but it lost data or a process of it died.
    RigLost {
        /// The losses by kind; none if a process died without losing any.
        losses: RigLosses,
        /// The place and reason of the loss, if known.
        cause: Option<String>,
    },
    /// The command finished and printed why no body was measured in any frame.
    NothingMeasured {
        /// The number of lost frames, rows or messages; may be 0.
        count: u64,
        /// The place and reason of the loss, if known.
        cause: Option<String>,
    },
}

impl Fatal for csv::Error {}

impl Fatal for serde_json::Error {}

impl Outcome {
    /// Returns the outcome of a command that measured no body in any frame, with the losses of this one.
    #[must_use]
    pub fn with_nothing_measured(self) -> Self {
        match self {
            Self::Clean => Self::NothingMeasured { count: 0, cause: None },
            Self::Lost { count, cause } | Self::NothingMeasured { count, cause } => {
                Self::NothingMeasured { count, cause }
            }
            Self::RigLost { losses, cause } => Self::NothingMeasured { count: losses.largest(), cause },
        }
    }

    /// Returns the line about lost data, or about a process that died without losing any; `None` if there is nothing to
    /// report.
    pub fn losses(&self) -> Option<String> {
        match self {
            Self::Lost { count: 0, cause: Some(cause) } => Some(format!("finished, but {cause}")),
            Self::Lost { count, cause } | Self::NothingMeasured { count, cause } if *count > 0 => {
                let cause = cause.as_ref().map_or_else(String::new, |cause| format!("; {cause}"));
                Some(format!("finished, but data were lost: {count}{cause}"))
            }
            Self::RigLost { losses, cause } => {
                let lost = (losses.largest() > 0).then(|| format!("data were lost: {losses}"));
                let parts: Vec<String> = lost.into_iter().chain(cause.clone()).collect();
                Some(format!("finished, but {}", parts.join("; ")))
            }
            _ => None,
        }
    }

    /// Returns the exit code; `None` for success.
    pub fn exit_code(&self) -> Option<ExitCode> {
        match self {
            Self::Clean => None,
            Self::Lost { .. } | Self::RigLost { .. } => Some(ExitCode::DataLost),
            Self::NothingMeasured { .. } => Some(ExitCode::NothingMeasured),
        }
    }

    /// Returns `Clean` if `lost` is 0, else the loss of this many frames, rows or messages, without a cause.
    pub fn from_losses(lost: u64) -> Self {
        if lost == 0 { Self::Clean } else { Self::Lost { count: lost, cause: None } }
    }

    /// Returns the outcome of a rig or of one of its processes, with the causes of its losses. Faults count as a loss
    /// without lost data.
    pub fn from_rig(summary: &Summary) -> Self {
        let cause = (!summary.causes.is_empty()).then(|| summary.causes.join(", "));
        let losses = summary.by_kind;
        match summary.lost + summary.dropped {
            0 if losses.largest() == 0 && summary.faults == 0 => Self::Clean,
            0 => Self::RigLost { losses, cause },
            count => Self::Lost { count, cause },
        }
    }

    /// Returns the outcome of a file; a truncated file counts as one more loss.
    pub fn from_file(lost: u64, path: &Path, truncated: Option<&str>) -> Self {
        match truncated {
            None => Self::from_losses(lost),
            Some(reason) => Self::Lost { count: lost + 1, cause: Some(format!("{}: {reason}", path.display())) },
        }
    }
}

/// An error in the command line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

impl Fatal for UsageError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}

/// Prints a line to standard error and ignores a closed pipe.
pub fn print_note(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// Prints a line to standard output and ignores a closed pipe.
pub fn print_line(line: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}

/// The width of running text, characters.
const TEXT_COLUMNS: usize = 80;

/// Breaks text at blanks into lines of at most 80 characters, including `indent` blanks before each. A longer word has
/// a line of its own.
pub fn wrapped(text: &str, indent: usize) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let columns = lines.last().map_or(0, |line| line.chars().count());
        if columns > 0 && indent + columns + 1 + word.chars().count() > TEXT_COLUMNS {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            *line += if line.is_empty() { "" } else { " " };
            *line += word;
        }
    }
    lines.iter().map(|line| format!("{:indent$}{line}", "")).collect::<Vec<_>>().join("\n")
}

/// Formats rows as columns, two blanks apart and each as wide as its widest cell; all but the first are right-aligned.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).enumerate().map(|(column, (cell, width))| match column {
            0 => format!("{cell:<width$}"),
            _ => format!("{cell:>width$}"),
        });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up_with_the_widest_cell() {
        let row = |cells: [&str; 2]| cells.map(str::to_owned).to_vec();
        assert_eq!(table(&[row(["a", "1"]), row(["long", "100"])]), "a       1\nlong  100");
    }
}
