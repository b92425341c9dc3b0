//! Where the rows of a table go.

use super::ExportError;
use std::io::Write;

/// What is in a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A whole number.
    Integer,
    /// Nanoseconds since the Unix epoch.
    Stamp,
    /// A number in double precision, or none.
    Double,
    /// A number in single precision, or none.
    Single,
    /// Words.
    Text,
}

/// A column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Column {
    /// Its name, with the unit.
    pub(super) name: String,
    /// What is in it.
    pub(super) kind: Kind,
}

/// Columns of these names.
pub(super) fn named(columns: &[(&str, Kind)]) -> Vec<Column> {
    columns.iter().map(|(name, kind)| Column { name: (*name).into(), kind: *kind }).collect()
}

/// One cell, of its column's kind.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    /// A whole number.
    Integer(i128),
    /// Nanoseconds since the Unix epoch.
    Stamp(u64),
    /// A number in double precision, or none.
    Double(Option<f64>),
    /// A number in single precision, or none.
    Single(Option<f32>),
    /// Words.
    Text(String),
}

/// Takes a table: its header first, then every row.
pub(super) trait Sink {
    /// The columns.
    fn header(&mut self, columns: &[Column]) -> Result<(), ExportError>;
    /// A row, a cell for each column.
    fn row(&mut self, cells: Vec<Cell>) -> Result<(), ExportError>;
}

/// Comma-separated values.
pub(super) struct Csv<W: Write> {
    csv: csv::Writer<W>,
    name: String,
    rows: u64,
}

impl<W: Write> Csv<W> {
    /// Into `to`, called `name` in errors.
    pub(super) fn new(to: W, name: &str) -> Self {
        Self { csv: csv::Writer::from_writer(to), name: name.into(), rows: 0 }
    }

    /// Writes what is held back; gives the number of rows.
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
    fn header(&mut self, columns: &[Column]) -> Result<(), ExportError> {
        self.record(columns.iter().map(|column| &column.name))
    }

    fn row(&mut self, cells: Vec<Cell>) -> Result<(), ExportError> {
        self.rows += 1;
        self.record(cells.into_iter().map(text))
    }
}

/// A number as the shortest text that reads back as the same number; nothing for one that is missing.
fn text(cell: Cell) -> String {
    match cell {
        Cell::Integer(number) => number.to_string(),
        Cell::Stamp(stamp_ns) => stamp_ns.to_string(),
        Cell::Double(number) => number.filter(|number| number.is_finite()).map(|n| n.to_string()).unwrap_or_default(),
        Cell::Single(number) => number.filter(|number| number.is_finite()).map(|n| n.to_string()).unwrap_or_default(),
        Cell::Text(text) => text,
    }
}
