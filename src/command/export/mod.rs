//! `ricochet export`: the tables of a recording, its frames as images or a video, and parts of it as recordings.

mod npz;
mod parquet;
mod picture;
mod rows;
mod sink;
mod video;

use crate::command::result_film::{self, Frames};
use crate::console::{OutputFile, Overwrite, check_no_input, print_note, progress};
use crate::failure::{ExitCode, Failure, Fatal};
use crate::recording::{self, Recording, RecordingError};
use crate::results::named_enum;
pub(super) use picture::grey_levels;
use sink::{Csv, Merged};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

named_enum! {
    /// The file formats of an export.
    #[derive(Default)]
    Format: "format" {
        /// Comma-separated values, one header line.
        #[default]
        Csv = 0 "csv",
        /// Apache Parquet, the same columns with their types.
        Parquet = 1 "parquet",
        /// A NumPy archive with an array per column.
        Npz = 2 "npz",
        /// A directory of PNG images: the frames as they are, or with the results drawn over them.
        Png = 3 "png",
        /// The same as a video in H.264.
        Mp4 = 4 "mp4",
        /// The same as an animation that any page shows.
        Gif = 5 "gif",
        /// Everything but the frames, as a recording.
        Mcap = 6 "mcap",
        /// The frames as a ROS 2 recording.
        Ros2 = 7 "ros2",
    }
}

impl Format {
    /// Returns the topics that can be exported in this format.
    fn topics(self) -> &'static [&'static str] {
        match self {
            Self::Csv | Self::Parquet | Self::Npz => &TABLES,
            Self::Png | Self::Mp4 | Self::Gif => &PICTURES,
            Self::Mcap => &["results"],
            Self::Ros2 => &["frames"],
        }
    }
}

/// The options of an export.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct ExportOptions {
    /// The recording.
    pub file: PathBuf,
    /// Tables: velocity, field, track, impact, truth or events. Pictures and films: frames, track or field. mcap:
    /// results. ros2: frames.
    #[arg(long)]
    pub topic: String,
    /// Tables: csv, parquet or npz (NumPy). Pictures: png (a directory of them). Films: mp4 or gif, with an installed
    /// ffmpeg. Recordings: mcap (everything but the frames) or ros2 (the frames as sensor_msgs/msg/Image).
    #[arg(long, default_value = "csv")]
    pub format: Format,
    /// Camera to export, by the name of its view [default: the first].
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// File or directory to write [default for csv: standard output].
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Film that the results were measured in, for pictures and films; several files are one sequence.
    #[arg(long, num_args = 1..)]
    pub film: Vec<PathBuf>,
    /// Playback rate of a film, frames per second.
    #[arg(long = "fps", default_value_t = 25.0, value_name = "HZ")]
    pub playback_hz: f64,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
}

/// Endings that promise a format; no other one is written under such a name.
const OTHER_ENDINGS: [&str; 14] =
    ["avi", "csv", "gif", "jpg", "mcap", "mkv", "mov", "mp4", "npz", "ods", "parquet", "png", "webm", "xlsx"];

impl ExportOptions {
    /// Checks that the topic, the film, the playback rate and the name of the output suit the format.
    ///
    /// # Errors
    ///
    /// [`ExportError::Usage`] naming the option.
    fn check(&self) -> Result<(), ExportError> {
        let (topic, known) = (self.topic.as_str(), self.format.topics());
        if !known.contains(&topic) {
            return Err(ExportError::Usage(format!("--topic {topic}: not one of {}", known.join(", "))));
        }
        if !self.film.is_empty() && !matches!(self.format, Format::Png | Format::Mp4 | Format::Gif) {
            let format = self.format.as_str();
            return Err(ExportError::Usage(format!("--film: --format {format} shows no frames; png, mp4 and gif do")));
        }
        if !(self.playback_hz > 0.0 && self.playback_hz <= 1000.0) {
            let playback_hz = self.playback_hz;
            return Err(ExportError::Usage(format!("--fps {playback_hz}: not a number above 0 and at most 1000")));
        }
        self.check_ending()
    }

    /// Checks that the name of the output does not promise another format.
    ///
    /// # Errors
    ///
    /// [`ExportError::Usage`] with the ending.
    fn check_ending(&self) -> Result<(), ExportError> {
        let Some(path) = &self.output else { return Ok(()) };
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let format = self.format.as_str();
        let is_other = OTHER_ENDINGS.contains(&ending.as_str()) && ending != format;
        let is_recording = ending == "mcap" && self.format == Format::Ros2;
        match is_other && !is_recording {
            true => Err(ExportError::Usage(format!(
                "{}: --format {format} writes no .{ending} file; change the name, or the format",
                path.display()
            ))),
            false => Ok(()),
        }
    }

    /// Opens the recording and selects the chosen camera.
    fn open_recording(&self) -> Result<Recording, RecordingError> {
        Recording::open(&self.file)?.select_view(self.camera.as_deref())
    }

    /// Opens the frames of the film that the options name, or of the recording itself.
    fn open_frames(&self, results: &Recording) -> Result<Frames, ExportError> {
        result_film::open_frames(results, &self.film, self.camera.as_deref(), "export").map_err(ExportError::Film)
    }
}

/// The tables that a recording can hold.
pub const TABLES: [&str; 7] = ["velocity", "field", "track", "impact", "truth", "truth_impact", "events"];

/// The contents of images: the frame alone, with the outline, with outline and displacements.
pub const PICTURES: [&str; 3] = ["frames", "track", "field"];

/// The reason why an export failed.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The options are wrong.
    #[error("{0}")]
    Usage(String),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The film cannot be opened.
    #[error("{0}")]
    Film(Failure),
    /// The output exists or cannot be created.
    #[error("{0}")]
    Output(Failure),
    /// The table cannot be written.
    #[error("cannot write {to}: {source}")]
    Write {
        /// The target.
        to: String,
        /// The error of the system.
        source: io::Error,
    },
}

impl Fatal for ExportError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Usage(_) => ExitCode::Usage,
            Self::Film(failure) | Self::Output(failure) => failure.exit_code(),
            Self::Recording(_) | Self::Write { .. } => ExitCode::Recording,
        }
    }
}

/// The outcome of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// The number of rows, images or messages.
    pub rows: u64,
    /// The reason why the recording is truncated and rows are missing, if it is.
    pub truncated: Option<String>,
}

/// Exports one table, or the frames.
///
/// # Errors
///
/// [`ExportError`] naming the option or the file.
pub fn run(options: &ExportOptions) -> Result<Exported, ExportError> {
    if let Some(path) = &options.output {
        check_no_input(path, options.film.iter().chain([&options.file]))
            .map_err(|error| ExportError::Usage(error.0))?;
    }
    let rows = write_topic(options)?;
    let is_measured = ["velocity", "field", "track", "impact"].contains(&options.topic.as_str());
    if rows == 0 && is_measured {
        let (topic, file) = (&options.topic, options.file.display());
        print_note(&format!("{file} has no {topic}; `ricochet analyze` measures a film"));
    }
    Ok(Exported { rows, truncated: Recording::open(&options.file)?.truncated().map(str::to_owned) })
}

/// Writes the table, the images or the recording, and returns their number of rows or frames.
///
/// The options are checked before a recording is read or a file is created.
fn write_topic(options: &ExportOptions) -> Result<u64, ExportError> {
    options.check()?;
    let topic = options.topic.as_str();
    let output = || {
        let path = options.output.as_deref();
        path.ok_or_else(|| {
            ExportError::Usage(format!("--format {}: needs a target, give it with -o", options.format.as_str()))
        })
    };
    match options.format {
        Format::Png => picture::write_all(options, output()?),
        Format::Mp4 | Format::Gif => write_whole(options, output()?, |file| video::write(options, file.part())),
        Format::Mcap if options.camera.is_some() => {
            Err(ExportError::Usage("--camera: --format mcap keeps the results of all cameras".into()))
        }
        Format::Mcap => Ok(recording::copy_results(&options.file, output()?)?),
        Format::Ros2 => Ok(recording::copy_as_ros2(&options.open_recording()?, output()?)?),
        Format::Parquet => {
            let path = output()?;
            let recording = options.open_recording()?;
            write_whole(options, path, |file| parquet::write(&recording, topic, file, &path.display().to_string()))
        }
        Format::Npz => {
            let path = output()?;
            let recording = options.open_recording()?;
            write_whole(options, path, |file| npz::write(&recording, topic, file, &path.display().to_string()))
        }
        Format::Csv => {
            let recording = options.open_recording()?;
            match &options.output {
                None => {
                    let bar = progress::bar_of_output(rows::progress_steps(&recording, topic), "export");
                    write_csv(&recording, topic, Csv::new(io::stdout().lock(), "standard output"), &bar)
                }
                Some(path) => write_whole(options, path, |file| {
                    let bar = progress::bar(rows::progress_steps(&recording, topic), "export");
                    write_csv(&recording, topic, Csv::new(BufWriter::new(file), &path.display().to_string()), &bar)
                }),
            }
        }
    }
}

/// Calls `write` with a new output file, which gets its name once it is complete; returns the number of rows or frames.
fn write_whole(
    options: &ExportOptions,
    path: &Path,
    write: impl FnOnce(&mut OutputFile) -> Result<u64, ExportError>,
) -> Result<u64, ExportError> {
    let mut file = OutputFile::create(path, options.overwrite).map_err(ExportError::Output)?;
    let count = write(&mut file)?;
    file.finish().map_err(ExportError::Output)?;
    Ok(count)
}

/// Writes one of [`TABLES`] of several recordings as one CSV table, and returns the number of its rows.
///
/// The first column names the recording, by its file without the ending. Errors call the target `name`, and `bar` counts the
/// recordings.
///
/// # Errors
///
/// [`ExportError`] as [`run`], or when the tables of two recordings have different columns.
pub(super) fn write_merged(
    recordings: &[PathBuf],
    topic: &str,
    to: impl Write,
    name: &str,
    bar: &progress::Bar,
) -> Result<u64, ExportError> {
    let mut table = Csv::new(to, name);
    let mut first = None;
    for path in recordings {
        let recording = Recording::open(path)?;
        let stem = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let mut part = Merged { table: &mut table, columns: &mut first, recording: &stem };
        rows::send_table(&recording, topic, &mut part, &progress::hidden())?;
        bar.inc(1);
    }
    table.finish()
}

/// Writes one of [`TABLES`] as CSV and returns the number of its rows. Errors call the target `name`.
///
/// # Errors
///
/// [`ExportError`] as [`run`].
pub fn write_table(recording: &Recording, topic: &str, to: impl Write, name: &str) -> Result<u64, ExportError> {
    write_csv(recording, topic, Csv::new(to, name), &progress::hidden())
}

/// Writes one of [`TABLES`] as CSV, with its progress, and returns the number of its rows.
fn write_csv(
    recording: &Recording,
    topic: &str,
    mut table: Csv<impl Write>,
    bar: &progress::Bar,
) -> Result<u64, ExportError> {
    rows::send_table(recording, topic, &mut table, bar)?;
    table.finish()
}
