//! The writer of a table, and the one for CSV.

use super::ExportError;
use crate::results::{Cell, Heading};
use std::io::Write;

/// A writer of a table: the header first, then every row.
pub(super) trait Sink {
    /// Takes the headings of the columns.
    fn header(&mut self, headings: &[Heading]) -> Result<(), ExportError>;
    /// Takes a row, with a cell for each column.
    fn row(&mut self, cells: Vec<Cell>) -> Result<(), ExportError>;
}

/// Comma-separated values.
pub(super) struct Csv<W: Write> {
    csv: csv::Writer<W>,
    name: String,
    rows: u64,
}

impl<W: Write> Csv<W> {
    /// Creates a writer to `to`, which errors call `name`.
    pub(super) fn new(to: W, name: &str) -> Self {
        Self { csv: csv::Writer::from_writer(to), name: name.into(), rows: 0 }
    }

    /// Flushes the writer and returns the number of rows.
    pub(super) fn finish(mut self) -> Result<u64, ExportError> {
        self.csv.flush().map_err(|source| ExportError::Write { to: self.name, source })?;
        Ok(self.rows)
    }

    fn record<T: AsRef<[u8]>>(&mut self, cells: impl IntoIterator<Item = T>) -> Result<(), ExportError> {
        let written = self.csv.write_record(cells);
        written.map_err(|error| ExportError::Write { to: self.name.clone(), source: error.into() })
    }
}

impl<W: Write> Sink for Csv<W> {
    fn header(&mut self, headings: &[Heading]) -> Result<(), ExportError> {
        self.record(headings.iter().map(|heading| heading.name))
    }

    fn row(&mut self, cells: Vec<Cell>) -> Result<(), ExportError> {
        self.rows += 1;
        self.record(cells.iter().map(Cell::to_string))
    }
}
