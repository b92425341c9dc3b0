//! The output table of a field.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use super::FieldError;
use crate::results::FieldPoint;

/// The columns of the table.
const COLUMNS: [&str; 9] = ["x_px", "y_px", "u_px", "v_px", "sigma_u_px", "sigma_v_px", "zncc", "peak_ratio", "status"];

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
    /// Writes the header.
    pub(super) fn head(self, out: impl Write) -> anyhow::Result<()> {
        if !self.json {
            let mut table = csv::Writer::from_writer(out);
            table.write_record(self.named.then_some(TARGET).into_iter().chain(COLUMNS))?;
            table.flush()?;
        }
        Ok(())
    }

    /// Writes the rows of one field.
    pub(super) fn rows(self, field: &[FieldPoint], target: &Path, mut out: impl Write) -> anyhow::Result<()> {
        let name = self.named.then(|| target.display().to_string());
        if self.json {
            for point in field {
                let mut object = serde_json::Map::new();
                if let Some(name) = &name {
                    object.insert(TARGET.to_owned(), serde_json::json!(name));
                }
                for (name, value) in COLUMNS.into_iter().zip(row(point)) {
                    object.insert(name.to_owned(), serde_json::json!(value));
                }
                object.insert("status".to_owned(), serde_json::json!(point.status.word()));
                writeln!(out, "{}", serde_json::Value::Object(object))?;
            }
        } else {
            let mut table = csv::Writer::from_writer(&mut out);
            for point in field {
                let cells = row(point).map(|value| value.map_or(String::new(), |value| value.to_string()));
                let cells = name.as_deref().into_iter().chain(cells.iter().map(String::as_str));
                table.write_record(cells.chain([point.status.word()]))?;
            }
            table.flush()?;
        }
        out.flush()?;
        Ok(())
    }

    /// Writes the table of one field to a file, replacing an existing one.
    ///
    /// # Errors
    ///
    /// [`FieldError::Write`] naming the file.
    pub(super) fn write_file(self, path: &Path, field: &[FieldPoint]) -> Result<(), FieldError> {
        let layout = Self { named: false, ..self };
        let mut file = BufWriter::new(File::create(path).map_err(|error| FieldError::write(path, error))?);
        let written = layout.head(&mut file).and_then(|()| layout.rows(field, path, file));
        written.map_err(|error| FieldError::write(path, error))
    }
}

/// Returns the values of a row; missing ones are `None`.
fn row(point: &FieldPoint) -> [Option<f32>; 8] {
    let displacement = point.displacement;
    [
        Some(point.x_px),
        Some(point.y_px),
        displacement.map(|d| d.u_px),
        displacement.map(|d| d.v_px),
        displacement.map(|d| d.sigma_u_px),
        displacement.map(|d| d.sigma_v_px),
        point.zncc,
        point.peak_ratio,
    ]
}
