//! `ricochet export`: the tables of a recording, and its frames as pictures.

mod npz;
mod parquet;
mod picture;
mod rows;
mod sink;

use crate::recording::{Recording, RecordingError};
use sink::Csv;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// File formats tables can be exported as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Format {
    /// Comma-separated values, one header line.
    #[default]
    Csv,
    /// Apache Parquet, the same columns with their types.
    Parquet,
    /// A NumPy archive, an array a column.
    Npz,
    /// A directory of PNG pictures, what was measured drawn over them.
    Png,
}

impl Format {
    /// The format of this name.
    ///
    /// # Errors
    ///
    /// [`ExportError::Usage`] listing the formats there are.
    pub fn from_word(word: &str) -> Result<Self, ExportError> {
        match word {
            "csv" => Ok(Self::Csv),
            "parquet" => Ok(Self::Parquet),
            "npz" => Ok(Self::Npz),
            "png" => Ok(Self::Png),
            other => Err(ExportError::Usage(format!("--format {other}: not one of csv, parquet, npz, png"))),
        }
    }

    fn word(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Parquet => "parquet",
            Self::Npz => "npz",
            Self::Png => "png",
        }
    }
}

/// What to export, and where to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportOptions {
    /// The recording.
    pub file: PathBuf,
    /// Which table: one of [`TABLES`]; of pictures, one of [`PICTURES`].
    pub topic: String,
    /// As what.
    pub format: Format,
    /// Where to; standard output when there is none, which only CSV takes.
    pub output: Option<PathBuf>,
}

/// The tables a recording can hold.
pub const TABLES: [&str; 7] = ["velocity", "field", "track", "impact", "truth", "truth_impact", "events"];

/// What pictures can show: the frame alone, with the outline, with outline and displacements.
pub const PICTURES: [&str; 3] = ["frames", "track", "field"];

/// Why a table could not be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The options are wrong.
    #[error("{0}")]
    Usage(String),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The table cannot be written.
    #[error("write {to}: {source}")]
    Write {
        /// Where to.
        to: String,
        /// The system's answer.
        source: io::Error,
    },
}

/// What was exported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Rows of the table, or pictures.
    pub rows: u64,
    /// Why the recording ends too early, when it does: rows are missing then.
    pub truncated: Option<String>,
}

/// Exports one table, or the frames as pictures.
///
/// # Errors
///
/// [`ExportError`] naming the option or the file.
pub fn run(options: &ExportOptions) -> Result<Exported, ExportError> {
    if let Some(path) = options.output.as_deref().filter(|path| is_same_file(path, &options.file)) {
        return Err(ExportError::Usage(format!("--output {}: is the recording itself", path.display())));
    }
    let rows = write(options)?;
    Ok(Exported { rows, truncated: Recording::open(&options.file)?.truncated().map(str::to_owned) })
}

/// Whether both paths lead to one file that exists.
pub(super) fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Writes the table or the pictures; returns their number.
fn write(options: &ExportOptions) -> Result<u64, ExportError> {
    let topic = options.topic.as_str();
    let known: &[&str] = if options.format == Format::Png { &PICTURES } else { &TABLES };
    if !known.contains(&topic) {
        return Err(ExportError::Usage(format!("--topic {topic}: not one of {}", known.join(", "))));
    }
    let output = || {
        let path = options.output.as_deref();
        path.ok_or_else(|| ExportError::Usage(format!("--format {}: say where to with -o", options.format.word())))
    };
    let create = |path: &Path| {
        File::create(path).map_err(|source| ExportError::Write { to: path.display().to_string(), source })
    };
    // What is missing on the command line is told before a recording is read or a file is made.
    match options.format {
        Format::Png => picture::write_all(options, output()?),
        Format::Parquet => {
            let path = output()?;
            let recording = Recording::open(&options.file)?;
            parquet::write(&recording, topic, create(path)?, &path.display().to_string())
        }
        Format::Npz => {
            let path = output()?;
            let recording = Recording::open(&options.file)?;
            npz::write(&recording, topic, create(path)?, &path.display().to_string())
        }
        Format::Csv => {
            let recording = Recording::open(&options.file)?;
            match &options.output {
                None => write_table(&recording, topic, io::stdout().lock(), "standard output"),
                Some(path) => {
                    write_table(&recording, topic, BufWriter::new(create(path)?), &path.display().to_string())
                }
            }
        }
    }
}

/// Writes one of [`TABLES`] as CSV; returns its rows. `name` names the target in errors.
///
/// # Errors
///
/// [`ExportError`] as [`run`].
pub fn write_table(recording: &Recording, topic: &str, to: impl Write, name: &str) -> Result<u64, ExportError> {
    let mut table = Csv::new(to, name);
    rows::send(recording, topic, &mut table)?;
    table.finish()
}
