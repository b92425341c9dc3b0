//! The writer of a table, and the one for CSV.

use super::ExportError;
use crate::results::{Cell, Heading, Kind};
use std::io::{self, Write};

/// A writer of a table: the header first, then every row.
pub(super) trait Sink {
    /// Writes the header of the table.
    fn write_header(&mut self, headings: &[Heading]) -> Result<(), ExportError>;
    /// Writes a row, with a cell for each column.
    fn write_row(&mut self, cells: Vec<Cell>) -> Result<(), ExportError>;
}

/// Comma-separated values.
pub(super) struct Csv<W: Write> {
    csv: csv::Writer<W>,
    name: String,
    rows: u64,
}

/// Returns the error of the system inside an error of the CSV writer, with its kind.
fn system_error(error: csv::Error) -> io::Error {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error,
        kind => io::Error::other(format!("{kind:?}")),
    }
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

    /// Writes the cells of a line.
    fn write_record<T: AsRef<[u8]>>(&mut self, cells: impl IntoIterator<Item = T>) -> Result<(), ExportError> {
        let written = self.csv.write_record(cells);
        written.map_err(|error| ExportError::Write { to: self.name.clone(), source: system_error(error) })
    }
}

impl<W: Write> Sink for Csv<W> {
    fn write_header(&mut self, headings: &[Heading]) -> Result<(), ExportError> {
        self.write_record(headings.iter().map(|heading| heading.name))
    }

    fn write_row(&mut self, cells: Vec<Cell>) -> Result<(), ExportError> {
        self.rows += 1;
        self.write_record(cells.iter().map(Cell::to_string))
    }
}

/// The table of one of several recordings, written into a table of all.
pub(super) struct Merged<'a> {
    /// The table of all.
    pub(super) table: &'a mut dyn Sink,
    /// The names of its columns, once the first recording is written.
    pub(super) columns: &'a mut Option<Vec<&'static str>>,
    /// The name of the recording.
    pub(super) recording: &'a str,
}

impl Sink for Merged<'_> {
    fn write_header(&mut self, headings: &[Heading]) -> Result<(), ExportError> {
        let names: Vec<&'static str> = headings.iter().map(|heading| heading.name).collect();
        match self.columns {
            Some(columns) if *columns == names => Ok(()),
            Some(_) => {
                let reason = "has other columns than the recordings before it; merge those of one kind of body";
                Err(ExportError::Usage(format!("{} {reason}", self.recording)))
            }
            None => {
                *self.columns = Some(names);
                let first = Heading { name: "recording", kind: Kind::Text };
                self.table.write_header(&[&[first], headings].concat())
            }
        }
    }

    fn write_row(&mut self, mut cells: Vec<Cell>) -> Result<(), ExportError> {
        cells.insert(0, Cell::Text(self.recording.to_owned()));
        self.table.write_row(cells)
    }
}
