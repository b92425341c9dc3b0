//! The output of a study: files in a directory, and a text or a JSON object on standard output.

use crate::failure::Failure;
use std::path::Path;

use serde_json::{Map, Value};

use crate::console::{Overwrite, check_no_input, create_directory, print_line, table, write_file};

/// A cell of a table: its column and its value, null if it is missing.
pub(super) type Cell = (&'static str, Value);

/// A table with one value per row and column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    pub(super) columns: Vec<String>,
    pub(super) rows: Vec<Vec<Value>>,
}

impl Table {
    /// Returns a table of rows that have the same columns.
    pub(super) fn new(rows: impl IntoIterator<Item = Vec<Cell>>) -> Self {
        let mut rows = rows.into_iter().peekable();
        let columns = rows.peek().into_iter().flatten().map(|(name, _)| (*name).to_owned()).collect();
        let values = |row: Vec<Cell>| row.into_iter().map(|(_, value)| value).collect();
        Self { columns, rows: rows.map(values).collect() }
    }

    /// Returns an array of one object per row, with the columns as keys.
    pub(super) fn as_json(&self) -> Value {
        let object = |row: &Vec<Value>| -> Map<String, Value> {
            self.columns.iter().cloned().zip(row.iter().cloned()).collect()
        };
        self.rows.iter().map(object).collect()
    }

    /// Returns the table as CSV with empty cells for missing values.
    ///
    /// # Errors
    ///
    /// When a row cannot be encoded.
    pub(super) fn as_csv(&self) -> Result<Vec<u8>, Failure> {
        let mut csv = csv::Writer::from_writer(Vec::new());
        if !self.columns.is_empty() {
            csv.write_record(&self.columns)?;
        }
        for row in &self.rows {
            csv.write_record(row.iter().map(|value| match value {
                Value::Null => String::new(),
                Value::String(text) => text.clone(),
                other => other.to_string(),
            }))?;
        }
        csv.into_inner().map_err(|error| Failure::internal(format!("{error}")))
    }
}

/// Everything that a study writes and prints.
#[derive(Debug)]
pub(super) struct Report {
    /// Names and contents of the files.
    pub(super) files: Vec<(String, Vec<u8>)>,
    /// The text or the JSON object for standard output.
    pub(super) printed: String,
}

impl Report {
    /// Writes the files into a directory and prints the rest.
    ///
    /// # Errors
    ///
    /// Errors of [`write_file`].
    pub(super) fn publish(&self, directory: Option<&Path>, overwrite: Overwrite) -> Result<(), Failure> {
        if let Some(directory) = directory {
            for (name, bytes) in &self.files {
                write_file(&directory.join(name), bytes, overwrite)?;
            }
        }
        print_line(&self.printed);
        Ok(())
    }
}

/// Creates the directory of a study, and checks that none of its `files` is an input or an output that must stay.
///
/// # Errors
///
/// When the directory is a file or cannot be created, or a file would overwrite an input or, unasked, an output.
pub(super) fn prepare(directory: &Path, files: &[&str], inputs: &[&Path], overwrite: Overwrite) -> Result<(), Failure> {
    create_directory("--output", directory)?;
    for name in files {
        let path = directory.join(name);
        check_no_input(&path, inputs)?;
        overwrite.check(&path)?;
    }
    Ok(())
}

/// Rounds to the 7 decimals of the tables, without a negative zero.
pub(super) fn rounded(value: f64) -> f64 {
    // Adding 0 turns -0 into 0.
    (value * 1e7).round() / 1e7 + 0.0
}

/// Formats a table with a labelled row for each `R` and a labelled column for each `C`. `corner` is the label of the
/// row labels.
pub(super) fn cross_table<R, C>(
    corner: &str,
    rows: &[(String, R)],
    columns: &[(String, C)],
    cell: impl Fn(&R, &C) -> String,
) -> String {
    let head = std::iter::once(corner.to_owned()).chain(columns.iter().map(|(name, _)| name.clone())).collect();
    let line = |(name, row): &(String, R)| {
        std::iter::once(name.clone()).chain(columns.iter().map(|(_, column)| cell(row, column))).collect()
    };
    table(&std::iter::once(head).chain(rows.iter().map(line)).collect::<Vec<_>>())
}
