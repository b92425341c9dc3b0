//! The output table of a field.

use std::io::Write;
use std::path::Path;

use crate::command::json_cells;
use crate::console::{Overwrite, write_file};
use crate::failure::Failure;
use crate::results::FieldPoint;

/// The first column of a table of several fields.
const TARGET: &str = "target";

/// The layout of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// JSON lines with null for missing numbers, else CSV with empty cells.
    pub(super) json: bool,
    /// Whether each row starts with the name of its target.
    pub(super) named: bool,
}

impl Layout {
    /// Writes the names of the columns; JSON lines have none.
    pub(super) fn write_header(self, out: impl Write) -> Result<(), Failure> {
        if !self.json {
            let mut table = csv::Writer::from_writer(out);
            let names = FieldPoint::COLUMNS.iter().map(|column| column.heading.name);
            table.write_record(self.named.then_some(TARGET).into_iter().chain(names))?;
            table.flush()?;
        }
        Ok(())
    }

    /// Writes the rows of one field.
    pub(super) fn write_rows(self, field: &[FieldPoint], target: &Path, mut out: impl Write) -> Result<(), Failure> {
        let name = self.named.then(|| target.display().to_string());
        if self.json {
            for point in field {
                let mut object = serde_json::Map::new();
                if let Some(name) = &name {
                    object.insert(TARGET.to_owned(), serde_json::json!(name));
                }
                object.extend(json_cells(point, FieldPoint::COLUMNS).map(|(name, value)| (name.to_owned(), value)));
                writeln!(out, "{}", serde_json::Value::Object(object))?;
            }
        } else {
            let mut table = csv::Writer::from_writer(&mut out);
            for point in field {
                let cells = FieldPoint::COLUMNS.iter().map(|column| (column.cell)(point).to_string());
                table.write_record(name.clone().into_iter().chain(cells))?;
            }
            table.flush()?;
        }
        out.flush()?;
        Ok(())
    }

    /// Writes the table of one field to a file.
    ///
    /// # Errors
    ///
    /// Errors of [`write_file`].
    pub(super) fn write_file(self, path: &Path, field: &[FieldPoint], overwrite: Overwrite) -> Result<(), Failure> {
        let (layout, mut bytes) = (Self { named: false, ..self }, Vec::new());
        layout.write_header(&mut bytes)?;
        layout.write_rows(field, path, &mut bytes)?;
        write_file(path, bytes, overwrite)
    }
}
