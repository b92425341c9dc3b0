//! Tables as Apache Parquet, with plain columns without compression, which all readers support.

use super::sink::Sink;
use super::{ExportError, rows};
use crate::console::{OutputFile, progress};
use crate::recording::Recording;
use crate::results::{Cell, Heading, Kind};
use parquet::basic::{ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::Type;
use std::io;
use std::sync::Arc;

/// The number of rows per group, which are held in memory.
const GROUP_ROWS: usize = 1 << 16;

/// Writes a table and returns the number of its rows. Errors call the file `name`.
///
/// The metadata of the recording become those of the file, as `ricochet.KEY`.
pub(super) fn write(recording: &Recording, topic: &str, file: &mut OutputFile, name: &str) -> Result<u64, ExportError> {
    let entries = recording.metadata().iter();
    let metadata = entries.map(|(key, value)| KeyValue::new(format!("ricochet.{key}"), value.clone())).collect();
    let mut table =
        Table { name, file: Some(file), metadata, writer: None, columns: Vec::new(), rows: Vec::new(), count: 0 };
    let bar = progress::bar(rows::progress_steps(recording, topic), "export");
    rows::send_table(recording, topic, &mut table, &bar)?;
    table.write_group()?;
    if let Some(writer) = table.writer.take() {
        writer.close().map_err(|error| write_error(name, error))?;
    }
    Ok(table.count)
}

/// A table that is written group by group.
struct Table<'a> {
    name: &'a str,
    /// The file, until the header is known.
    file: Option<&'a mut OutputFile>,
    metadata: Vec<KeyValue>,
    writer: Option<SerializedFileWriter<&'a mut OutputFile>>,
    columns: Vec<Heading>,
    rows: Vec<Vec<Cell>>,
    count: u64,
}

/// Returns the error of a write to the target `name`.
fn write_error(name: &str, error: ParquetError) -> ExportError {
    ExportError::Write { to: name.into(), source: io::Error::other(error) }
}

impl Sink for Table<'_> {
    fn write_header(&mut self, columns: &[Heading]) -> Result<(), ExportError> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let properties = WriterProperties::builder()
            .set_created_by(concat!("ricochet ", env!("CARGO_PKG_VERSION")).into())
            .set_key_value_metadata(Some(std::mem::take(&mut self.metadata)))
            .build();
        let writer = schema(columns).and_then(|schema| SerializedFileWriter::new(file, schema, Arc::new(properties)));
        self.writer = Some(writer.map_err(|error| write_error(self.name, error))?);
        self.columns = columns.to_vec();
        Ok(())
    }

    fn write_row(&mut self, cells: Vec<Cell>) -> Result<(), ExportError> {
        self.rows.push(cells);
        self.count += 1;
        if self.rows.len() < GROUP_ROWS { Ok(()) } else { self.write_group() }
    }
}

/// Returns the schema: whole numbers and texts are required, other numbers may be missing.
fn schema(columns: &[Heading]) -> Result<Arc<Type>, ParquetError> {
    let field = |column: &Heading| {
        let (physical, converted) = match column.kind {
            Kind::Integer => (Physical::INT64, ConvertedType::NONE),
            Kind::Stamp => (Physical::INT64, ConvertedType::UINT_64),
            Kind::Double => (Physical::DOUBLE, ConvertedType::NONE),
            Kind::Single => (Physical::FLOAT, ConvertedType::NONE),
            Kind::Text => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
        };
        let repetition = match column.kind {
            Kind::Double | Kind::Single => Repetition::OPTIONAL,
            Kind::Integer | Kind::Stamp | Kind::Text => Repetition::REQUIRED,
        };
        let field = Type::primitive_type_builder(column.name, physical).with_converted_type(converted);
        field.with_repetition(repetition).build().map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<_, _>>()?;
    Type::group_type_builder("ricochet").with_fields(fields).build().map(Arc::new)
}

impl Table<'_> {
    /// Writes the held rows as a group.
    fn write_group(&mut self) -> Result<(), ExportError> {
        let Some(writer) = self.writer.as_mut().filter(|_| !self.rows.is_empty()) else { return Ok(()) };
        let rows = std::mem::take(&mut self.rows);
        let mut write = || {
            let mut group = writer.next_row_group()?;
            for (k, column) in self.columns.iter().enumerate() {
                let Some(mut writer) = group.next_column()? else { break };
                write_column(&mut writer, column.kind, rows.iter().map(|row| &row[k]))?;
                writer.close()?;
            }
            group.close().map(|_| ())
        };
        write().map_err(|error| write_error(self.name, error))
    }
}

/// Writes the cells of a column of a group.
fn write_column<'a>(
    writer: &mut SerializedColumnWriter<'_>,
    kind: Kind,
    cells: impl Iterator<Item = &'a Cell>,
) -> Result<(), ParquetError> {
    match kind {
        Kind::Integer | Kind::Stamp => {
            let values = cells.map(whole_number).collect::<Result<Vec<i64>, _>>()?;
            writer.typed::<Int64Type>().write_batch(&values, None, None)?;
        }
        Kind::Text => {
            let text = |cell: &Cell| match cell {
                Cell::Text(text) => ByteArray::from(text.as_str()),
                _ => ByteArray::from(""),
            };
            let values: Vec<ByteArray> = cells.map(text).collect();
            writer.typed::<ByteArrayType>().write_batch(&values, None, None)?;
        }
        Kind::Double => write_numbers::<DoubleType>(writer, cells, |cell| match cell {
            Cell::Double(number) => number.filter(|number| number.is_finite()),
            _ => None,
        })?,
        Kind::Single => write_numbers::<FloatType>(writer, cells, |cell| match cell {
            Cell::Single(number) => number.filter(|number| number.is_finite()),
            _ => None,
        })?,
    }
    Ok(())
}

/// Returns a whole number. A stamp keeps its bits, which the type of the column declares as unsigned.
///
/// # Errors
///
/// When it exceeds 64 bits, or the cell is no whole number.
fn whole_number(cell: &Cell) -> Result<i64, ParquetError> {
    match cell {
        Cell::Integer(number) => {
            i64::try_from(*number).map_err(|_| ParquetError::General(format!("{number} does not fit 64 bits")))
        }
        Cell::Stamp(stamp_ns) => Ok(stamp_ns.cast_signed()),
        _ => Err(ParquetError::General("the cell is not a whole number".into())),
    }
}

/// Writes the numbers that are present, and for each cell whether it is. `number` returns that of a cell; `None` is
/// missing.
fn write_numbers<'a, T: DataType>(
    writer: &mut SerializedColumnWriter<'_>,
    cells: impl Iterator<Item = &'a Cell>,
    number: impl Fn(&Cell) -> Option<T::T>,
) -> Result<(), ParquetError> {
    let cells: Vec<Option<T::T>> = cells.map(number).collect();
    let known: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    let values: Vec<T::T> = cells.into_iter().flatten().collect();
    writer.typed::<T>().write_batch(&values, Some(&known), None)?;
    Ok(())
}
