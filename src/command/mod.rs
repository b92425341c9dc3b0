//! What a person runs and waits for, one file a command.

pub mod analyze;
pub mod cameras;
pub mod control;
pub mod demo;
pub mod export;
pub mod field;
mod film;
pub mod import;
pub mod info;
pub mod listen;
pub mod progress;
pub mod recover;
pub mod replay;
pub mod report;
pub mod rig;
pub mod simulate;
pub mod status;

use std::io::Write;

/// How a command ended that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Everything is there.
    Clean,
    /// It finished, but this much was lost.
    Lost(u64),
}

impl Outcome {
    /// Clean when nothing was lost.
    pub fn of_losses(lost: u64) -> Self {
        if lost == 0 { Self::Clean } else { Self::Lost(lost) }
    }
}

/// The command line asks for something that does not make sense.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

/// Writes a line to standard output; a reader that went away is no error.
pub fn say(line: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}

/// Columns of text, each as wide as its widest cell; all but the first to the right.
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
