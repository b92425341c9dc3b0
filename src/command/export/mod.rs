//! `ricochet export`: the tables of a recording, its frames as pictures or a film, and parts of it as recordings.

mod npz;
mod parquet;
mod picture;
mod rows;
mod sink;
mod video;

use crate::recording::{self, Recording, RecordingError};
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
    /// The same as a film in H.264.
    Mp4,
    /// The same as an animation that any page shows.
    Gif,
    /// Everything but the frames, as a recording.
    Mcap,
    /// The frames as a ROS 2 recording.
    Ros2,
}

/// Every format and its name.
const FORMATS: [(&str, Format); 8] = [
    ("csv", Format::Csv),
    ("parquet", Format::Parquet),
    ("npz", Format::Npz),
    ("png", Format::Png),
    ("mp4", Format::Mp4),
    ("gif", Format::Gif),
    ("mcap", Format::Mcap),
    ("ros2", Format::Ros2),
];

impl Format {
    /// The format of this name.
    ///
    /// # Errors
    ///
    /// [`ExportError::Usage`] listing the formats there are.
    pub fn from_word(word: &str) -> Result<Self, ExportError> {
        let found = FORMATS.iter().find(|(name, _)| *name == word).map(|(_, format)| *format);
        let names: Vec<&str> = FORMATS.iter().map(|(name, _)| *name).collect();
        found.ok_or_else(|| ExportError::Usage(format!("--format {word}: not one of {}", names.join(", "))))
    }

    fn word(self) -> &'static str {
        FORMATS.iter().find(|(_, format)| *format == self).map_or("", |(name, _)| name)
    }

    /// What can be exported so.
    fn topics(self) -> &'static [&'static str] {
        match self {
            Self::Csv | Self::Parquet | Self::Npz => &TABLES,
            Self::Png | Self::Mp4 | Self::Gif => &PICTURES,
            Self::Mcap => &["results"],
            Self::Ros2 => &["frames"],
        }
    }
}

/// What to export, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportOptions {
    /// The recording.
    pub file: PathBuf,
    /// Which table: one of [`TABLES`]; of pictures and films, one of [`PICTURES`]; `results` or `frames` of recordings.
    pub topic: String,
    /// As what.
    pub format: Format,
    /// Which of several cameras, by its name; the first when absent.
    pub camera: Option<String>,
    /// Where to; standard output when there is none, which only CSV takes.
    pub output: Option<PathBuf>,
    /// Frames of the recording that a film shows in a second, above 0 and at most 1000.
    pub playback_hz: f64,
}

impl ExportOptions {
    /// The recording, of the camera that is asked for.
    fn recording(&self) -> Result<Recording, RecordingError> {
        Recording::open(&self.file)?.of_camera(self.camera.as_deref())
    }
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
    /// Rows of the table, pictures, or messages.
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
pub(crate) fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Writes the table or the pictures; returns their number.
fn write(options: &ExportOptions) -> Result<u64, ExportError> {
    let topic = options.topic.as_str();
    let known = options.format.topics();
    if !known.contains(&topic) {
        return Err(ExportError::Usage(format!("--topic {topic}: not one of {}", known.join(", "))));
    }
    if !(options.playback_hz > 0.0 && options.playback_hz <= 1000.0) {
        let playback_hz = options.playback_hz;
        return Err(ExportError::Usage(format!("--fps {playback_hz}: not a number above 0 and at most 1000")));
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
        Format::Mp4 | Format::Gif => video::write(options, output()?),
        Format::Mcap if options.camera.is_some() => {
            Err(ExportError::Usage("--camera: --format mcap keeps what was measured of all cameras".into()))
        }
        Format::Mcap => Ok(recording::copy_results(&options.file, output()?)?),
        Format::Ros2 => Ok(recording::copy_as_ros2(&options.recording()?, output()?)?),
        Format::Parquet => {
            let path = output()?;
            let recording = options.recording()?;
            parquet::write(&recording, topic, create(path)?, &path.display().to_string())
        }
        Format::Npz => {
            let path = output()?;
            let recording = options.recording()?;
            npz::write(&recording, topic, create(path)?, &path.display().to_string())
        }
        Format::Csv => {
            let recording = options.recording()?;
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
