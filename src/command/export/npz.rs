//! Tables as NumPy archives: a zip file with an array (`.npy`) per column.
//!
//! Layouts: "A simple file format for NumPy arrays" (NumPy Enhancement Proposal 1); PKWARE APPNOTE 6.3, stored entries.

use super::sink::Sink;
use super::{ExportError, rows};
use crate::console::{OutputFile, progress};
use crate::recording::Recording;
use crate::results::{Cell, Heading, Kind};
use std::collections::BTreeMap;
use std::io::{self, BufWriter, Write};

/// The alignment of the data of an array, bytes.
const ALIGNMENT: usize = 64;
/// The date of all entries, 1 January 1980, so that the same table gives the same file.
const DATE: u16 = 1 << 5 | 1;

/// Writes a table and returns the number of its rows. All columns are held in memory. Errors call the file `name`.
pub(super) fn write(recording: &Recording, topic: &str, file: &mut OutputFile, name: &str) -> Result<u64, ExportError> {
    let mut table = Table { name, columns: Vec::new(), rows: 0 };
    let bar = progress::bar(rows::progress_steps(recording, topic), "export");
    rows::send_table(recording, topic, &mut table, &bar)?;
    let failure = |source| ExportError::Write { to: name.into(), source };
    let mut archive = Archive { to: BufWriter::new(file), written: 0, directory: Vec::new(), entries: 0 };
    for (name, values) in &table.columns {
        archive.add(&format!("{name}.npy"), &values.array(table.rows)).map_err(failure)?;
    }
    archive.finish().map_err(failure)?;
    Ok(table.rows)
}

/// A table in memory, column by column.
struct Table<'a> {
    name: &'a str,
    columns: Vec<(&'static str, Values)>,
    rows: u64,
}

/// A column, little-endian as in its array; a missing number is NaN.
enum Values {
    /// Numbers of this NumPy type.
    Numbers(&'static str, Vec<u8>),
    /// The distinct texts, and the index of the one in each row.
    Words(BTreeMap<String, usize>, Vec<usize>),
}

impl Sink for Table<'_> {
    fn write_header(&mut self, columns: &[Heading]) -> Result<(), ExportError> {
        let values = |kind| match kind {
            Kind::Integer => Values::Numbers("<i8", Vec::new()),
            Kind::Stamp => Values::Numbers("<u8", Vec::new()),
            Kind::Double => Values::Numbers("<f8", Vec::new()),
            Kind::Single => Values::Numbers("<f4", Vec::new()),
            Kind::Text => Values::Words(BTreeMap::new(), Vec::new()),
        };
        self.columns = columns.iter().map(|column| (column.name, values(column.kind))).collect();
        Ok(())
    }

    fn write_row(&mut self, cells: Vec<Cell>) -> Result<(), ExportError> {
        self.rows += 1;
        for ((_, values), cell) in self.columns.iter_mut().zip(cells) {
            let pushed = values.push(cell);
            pushed.map_err(|source| ExportError::Write { to: self.name.into(), source })?;
        }
        Ok(())
    }
}

impl Values {
    /// Appends the cell of a row.
    ///
    /// # Errors
    ///
    /// When the cell is not of the type of its column, or a number exceeds 64 bits.
    fn push(&mut self, cell: Cell) -> io::Result<()> {
        match (self, cell) {
            (Self::Words(known, rows), Cell::Text(word)) => {
                let next = known.len();
                rows.push(*known.entry(word).or_insert(next));
            }
            (Self::Numbers(_, bytes), Cell::Integer(number)) => {
                let whole = i64::try_from(number).map_err(io::Error::other)?;
                bytes.extend(whole.to_le_bytes());
            }
            (Self::Numbers(_, bytes), Cell::Stamp(stamp_ns)) => bytes.extend(stamp_ns.to_le_bytes()),
            (Self::Numbers(_, bytes), Cell::Double(number)) => {
                let number = number.filter(|number| number.is_finite()).unwrap_or(f64::NAN);
                bytes.extend(number.to_le_bytes());
            }
            (Self::Numbers(_, bytes), Cell::Single(number)) => {
                let number = number.filter(|number| number.is_finite()).unwrap_or(f32::NAN);
                bytes.extend(number.to_le_bytes());
            }
            (_, cell) => return Err(io::Error::other(format!("{cell:?} is not of the type of its column"))),
        }
        Ok(())
    }

    /// Returns the array of `rows` elements: the header, then the values.
    fn array(&self, rows: u64) -> Vec<u8> {
        match self {
            Self::Numbers(kind, bytes) => {
                let mut array = array_header(kind, rows);
                array.extend(bytes);
                array
            }
            Self::Words(known, places) => {
                // Fixed width: each text as long as the longest, in UTF-32.
                let longest = known.keys().map(|word| word.chars().count()).max().unwrap_or(0).max(1);
                let mut array = array_header(&format!("<U{longest}"), rows);
                let mut encoded = vec![Vec::new(); known.len()];
                for (word, place) in known {
                    let mut bytes: Vec<u8> = word.chars().flat_map(|letter| u32::from(letter).to_le_bytes()).collect();
                    bytes.resize(4 * longest, 0);
                    encoded[*place] = bytes;
                }
                places.iter().for_each(|place| array.extend(&encoded[*place]));
                array
            }
        }
    }
}

/// Returns the header of a one-dimensional array of this NumPy type, padded to [`ALIGNMENT`].
fn array_header(kind: &str, rows: u64) -> Vec<u8> {
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({rows},), }}");
    let before = 10 + text.len() + 1;
    text.extend(std::iter::repeat_n(' ', before.next_multiple_of(ALIGNMENT) - before));
    text.push('\n');
    let length = (text.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], text.as_bytes()].concat()
}

/// A zip file with stored entries.
struct Archive<W: Write> {
    to: W,
    written: usize,
    /// The directory at its end.
    directory: Vec<u8>,
    entries: u16,
}

impl<W: Write> Archive<W> {
    /// Writes an entry under a name, without compression, and adds its record to the directory.
    fn add(&mut self, name: &str, content: &[u8]) -> io::Result<()> {
        let offset = size(self.written)?;
        // The common part of the header of an entry and of its record in the directory.
        let mut common = Vec::new();
        let version_to_read = 20_u16;
        [version_to_read, 0, 0, 0, DATE].iter().for_each(|field| common.extend(field.to_le_bytes()));
        [crc32fast::hash(content), size(content.len())?, size(content.len())?]
            .iter()
            .for_each(|field| common.extend(field.to_le_bytes()));
        [size(name.len())? as u16, 0].iter().for_each(|field| common.extend(field.to_le_bytes()));

        self.put(b"PK\x03\x04")?;
        self.put(&common)?;
        self.put(name.as_bytes())?;
        self.put(content)?;

        self.directory.extend(b"PK\x01\x02");
        self.directory.extend(version_to_read.to_le_bytes());
        self.directory.extend(common);
        // No comment, disk, type or permissions.
        self.directory.extend([0; 10]);
        self.directory.extend(offset.to_le_bytes());
        self.directory.extend(name.as_bytes());
        self.entries += 1;
        Ok(())
    }

    /// Writes the directory and the record of its end.
    fn finish(mut self) -> io::Result<()> {
        let (offset, directory) = (size(self.written)?, std::mem::take(&mut self.directory));
        self.put(&directory)?;
        self.put(b"PK\x05\x06")?;
        for field in [0, 0, self.entries, self.entries] {
            self.put(&field.to_le_bytes())?;
        }
        self.put(&size(directory.len())?.to_le_bytes())?;
        self.put(&offset.to_le_bytes())?;
        self.put(&0_u16.to_le_bytes())?;
        self.to.flush()
    }

    /// Writes bytes and counts them.
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.written += bytes.len();
        self.to.write_all(bytes)
    }
}

/// Returns a size or offset as the format stores it.
///
/// # Errors
///
/// At 4 GiB or more.
fn size(bytes: usize) -> io::Result<u32> {
    u32::try_from(bytes).map_err(|_| io::Error::other("an npz file holds at most 4 GiB; use --format parquet"))
}
