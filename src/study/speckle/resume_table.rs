//! The table of films on disk, written film by film and resumable.
//!
//! Films are written in the order of the plan with one call each. An interruption thus leaves a complete beginning of
//! the table and at most a part of one film, which is cut off. The last complete film is measured again, and the
//! study is only resumed if this program measures the same.

use crate::failure::Failure;
use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::films_plan::Film;
use super::methods::Method;
use super::row::Row;
use crate::console::{Overwrite, UsageError, WriteError, create_directory, write_file};

/// Advice for a table that cannot be resumed.
const ADVICE: &str = "choose another directory, or delete both files to start again";

/// The films and methods of a study.
#[derive(Debug, Clone)]
pub(super) struct Contents<'a> {
    pub(super) films: &'a [Film],
    pub(super) methods: &'a [Method],
    /// Frames per film.
    pub(super) frames: u64,
}

impl Contents<'_> {
    /// Returns the number of rows per film.
    pub(super) fn rows(&self) -> usize {
        self.methods.len() * (self.frames as usize - 1)
    }

    /// Whether these rows belong to a film, in order: all of its rows or the first ones.
    fn rows_belong_to(&self, film: &Film, rows: &[Row]) -> bool {
        let wanted = (0..self.frames - 1).flat_map(|frame| self.methods.iter().map(move |method| (frame, *method)));
        rows.iter().zip(wanted).all(|(row, (frame, method))| row.belongs_to(film, frame, method))
    }
}

/// An open table of films.
#[derive(Debug)]
pub(super) struct ResumeTable {
    path: PathBuf,
    file: File,
    has_header: bool,
}

impl ResumeTable {
    /// Opens or creates the table in a directory; returns it with the rows of the completed films.
    ///
    /// # Errors
    ///
    /// When the directory is a file, the table belongs to another study or other settings, or a file cannot be read
    /// or written.
    pub(super) fn open(
        directory: &Path,
        name: &str,
        settings: &Value,
        contents: &Contents<'_>,
    ) -> Result<(Self, Vec<Row>), Failure> {
        create_directory("--output", directory)?;
        let path = directory.join(format!("{name}_films.csv"));
        check_settings(&directory.join(format!("{name}_settings.json")), &path, settings)?;
        let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
        let mut file = open.map_err(|error| WriteError::new(&path, error))?;
        let bytes = std::fs::read(&path).map_err(|error| WriteError::new(&path, error))?;
        let (rows, whole) = read_completed(&path, &bytes, contents)?;
        file.set_len(whole).map_err(|error| WriteError::new(&path, error))?;
        file.seek(SeekFrom::End(0)).map_err(|error| WriteError::new(&path, error))?;
        Ok((Self { path, file, has_header: whole > 0 }, rows))
    }

    /// Returns the error for a film whose rows in the table are not those that this version measures.
    ///
    /// `film` is its index from 0. The message counts from 1.
    pub(super) fn film_mismatch_error(&self, film: usize) -> UsageError {
        UsageError(format!(
            "{}: film {} was measured differently by another version; {ADVICE}",
            self.path.display(),
            film + 1
        ))
    }

    /// Appends the rows of one film.
    ///
    /// # Errors
    ///
    /// [`WriteError`] when the file cannot be written.
    pub(super) fn append(&mut self, rows: &[Row]) -> Result<(), Failure> {
        let mut csv = csv::WriterBuilder::new().has_headers(!self.has_header).from_writer(Vec::new());
        rows.iter().try_for_each(|row| csv.serialize(row))?;
        let bytes = csv.into_inner().map_err(|error| Failure::internal(format!("{error}")))?;
        self.file.write_all(&bytes).map_err(|error| WriteError::new(&self.path, error))?;
        self.has_header = true;
        Ok(())
    }
}

/// Compares the settings of an existing `table` with these, or writes them to `path` next to a new one.
///
/// # Errors
///
/// When the settings differ, or cannot be read or written.
fn check_settings(path: &Path, table: &Path, settings: &Value) -> Result<(), Failure> {
    if !table.exists() {
        let text = format!("{settings:#}\n");
        // Settings without a table are those of a study that ended before its first film.
        return write_file(path, text, Overwrite::ALLOWED);
    }
    let text = std::fs::read_to_string(path).map_err(|error| {
        UsageError(format!("{}: cannot read its settings ({}: {error}); {ADVICE}", table.display(), path.display()))
    })?;
    let before: Value = serde_json::from_str(&text)
        .map_err(|error| UsageError(format!("{}: not the settings of a study: {error}; {ADVICE}", path.display())))?;
    let keys = settings.as_object().into_iter().flatten().map(|(key, _)| key);
    match keys.into_iter().find(|key| before[key.as_str()] != settings[key.as_str()]) {
        None => Ok(()),
        Some(key) => Err(UsageError(format!(
            "{}: {key} is {} there, {} now; {ADVICE}",
            path.display(),
            before[key.as_str()],
            settings[key.as_str()]
        ))
        .into()),
    }
}

/// Reads the rows of the complete films at the beginning of a table, and returns them with their length in bytes.
///
/// # Errors
///
/// When a line is not a row of this study.
fn read_completed(path: &Path, bytes: &[u8], contents: &Contents<'_>) -> Result<(Vec<Row>, u64), Failure> {
    let foreign = |line: u64| {
        let reason = "is not a row of this study; delete the file to start again";
        UsageError(format!("{}: line {line} {reason}", path.display()))
    };
    // An incomplete last line was being written when the study ended.
    let written = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1);
    let mut reader = csv::Reader::from_reader(&bytes[..written]);
    let mut ends = Vec::new();
    let mut rows: Vec<Row> = Vec::new();
    let headers = reader.headers().map_err(|_| foreign(1))?.clone();
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(|_| foreign(rows.len() as u64 + 2))? {
        let row = record.deserialize(Some(&headers)).map_err(|_| foreign(rows.len() as u64 + 2))?;
        rows.push(row);
        ends.push(reader.position().byte());
    }
    let each = contents.rows();
    let films = rows.len() / each;
    for (number, rows) in rows.chunks(each).enumerate() {
        let is_known = contents.films.get(number).is_some_and(|film| contents.rows_belong_to(film, rows));
        if !is_known {
            return Err(foreign((number * each) as u64 + 2).into());
        }
    }
    rows.truncate(films * each);
    let whole = rows.len().checked_sub(1).map_or(0, |last| ends[last]);
    Ok((rows, whole))
}
