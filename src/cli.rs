//! The command line. This is the only room that names clap.

use crate::command::analyze::{self, AnalyzeOptions};
use crate::command::bench::{self, LiveOptions, RecordOptions, WindowsOptions};
use crate::command::cameras::{self, CamerasOptions};
use crate::command::check::{self, CheckOptions};
use crate::command::demo::{self, DemoOptions};
use crate::command::export::{self, ExportOptions};
use crate::command::import::{self, ImportOptions};
use crate::command::info::{self, InfoOptions};
use crate::command::listen::{self, ListenOptions};
use crate::command::recover::{self, RecoverOptions};
use crate::command::report::{self, ReportOptions};
use crate::command::rig::{self, RoleOptions};
use crate::command::simulate::{self, SimulateOptions};
use crate::command::{self, Outcome, control, status};
use crate::message::{Command as Request, Role};
use crate::process::{Resume, Stop};
mod field;
mod replay;
mod study;

use clap::error::ErrorKind;
use clap::{Args, Parser, Subcommand};
use field::Field;
use replay::Replay;
use std::path::PathBuf;
use study::Study;

/// Measures an impact live with a high-speed camera.
#[derive(Debug, Parser)]
#[command(name = "ricochet", version, max_term_width = 100)]
struct Line {
    #[command(subcommand)]
    command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a simulated rig with all its processes and compare the measurement with the truth.
    #[command(after_help = "Example: ricochet demo lacrosse --output shots")]
    Demo(Demo),
    /// Run a rig: camera, workers, tracker and recorder, each in its own process.
    #[command(after_help = "Example: ricochet run config/genicam.toml")]
    Run {
        /// Rig file.
        config: PathBuf,
    },
    /// Run one process of a rig: the camera writes frames into the ring.
    #[command(after_help = "Example: ricochet acquire rig.toml")]
    Acquire(RoleLine),
    /// Run one process of a rig: a worker measures blocks of frames.
    #[command(after_help = "Example: ricochet correlate rig.toml --worker 1")]
    Correlate(RoleLine),
    /// Run one process of a rig: the tracker publishes tracks, velocities and impacts in frame order.
    #[command(after_help = "Example: ricochet track rig.toml")]
    Track(RoleLine),
    /// Run one process of a rig: the recorder writes recordings.
    #[command(after_help = "Example: ricochet record rig.toml")]
    Record(RoleLine),
    /// List the available cameras with their formats and frame rates.
    #[command(after_help = "Example: ricochet cameras --features 192.168.1.20")]
    Cameras(Cameras),
    /// Check whether a rig is ready: noise floor, light, speckle pattern, focus, lost frames.
    #[command(after_help = "Example: ricochet check rig.toml -o check.html")]
    Check(Check),
    /// Show the state of each process of a running rig.
    #[command(after_help = "Example: ricochet status --rig lacrosse")]
    Status(Rig),
    /// Arm a running rig so that it waits for a trigger.
    #[command(after_help = "Example: ricochet arm --rig lacrosse")]
    Arm(Rig),
    /// Disarm a running rig so that it ignores triggers.
    #[command(after_help = "Example: ricochet disarm --rig lacrosse")]
    Disarm(Rig),
    /// Trigger a running rig: record a shot around this moment.
    #[command(after_help = "Example: ricochet trigger --rig lacrosse")]
    Trigger(Rig),
    /// Print a live topic: field, track, velocity, impact, status or events.
    #[command(after_help = "Example: ricochet listen velocity --rig lacrosse --json")]
    Listen(Listen),
    /// Replay the frames of a recording through a rig and publish its live topics.
    #[command(after_help = "Example: ricochet replay recordings/lacrosse.mcap --rate max")]
    Replay(Replay),
    /// Measure a recording offline.
    #[command(after_help = "Example: ricochet analyze recordings/lacrosse.mcap -o results.mcap")]
    Analyze(Analyze),
    /// Measure the displacement field of two still images, or of a series against its first image.
    #[command(after_help = "Example: ricochet field before.bmp after.bmp -o field.csv --picture field.png")]
    Field(Box<Field>),
    /// Benchmark this machine: how fast it measures and records.
    #[command(after_help = "Example: ricochet bench windows --json")]
    Bench(Bench),
    /// Export a topic of a recording as a table, pictures, a film or a recording.
    #[command(after_help = "Example: ricochet export shot.mcap --topic velocity --format csv -o velocity.csv")]
    Export(Export),
    /// Write a report page of a recording (numbers, curves, pictures), or a repeatability page of several.
    #[command(after_help = "Example: ricochet report shot.mcap -o shot.html")]
    Report(Report),
    /// Show the contents of a recording and any damage.
    #[command(after_help = "Example: ricochet info shot.mcap --json")]
    Info(Info),
    /// Recover every complete frame of a recording that was cut off.
    #[command(after_help = "Example: ricochet recover shot.mcap.part -o shot.mcap")]
    Recover(Recover),
    /// Convert footage of other programs or cameras into a recording.
    #[command(after_help = "Example: ricochet import frame_*.tif --fps 10000 -o shot.mcap")]
    Import(Import),
    /// Render a simulated impact into a recording together with its ground truth.
    #[command(after_help = "Example: ricochet simulate lacrosse -o lacrosse.mcap")]
    Simulate(Simulate),
    /// Study how settings, speckle patterns and methods affect accuracy.
    #[command(after_help = "Example: ricochet study convergence --json")]
    Study(Study),
}

/// The arguments of `demo`.
#[derive(Debug, Args)]
pub struct Demo {
    /// Experiment: lacrosse, tennis or rod.
    #[arg(default_value = "lacrosse")]
    experiment: String,
    /// Directory for the recording.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Number of correlation workers.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    workers: Option<u32>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The arguments of the commands that run one process of a rig.
#[derive(Debug, Args)]
pub struct RoleLine {
    /// Rig file; `-` reads it from standard input.
    config: PathBuf,
    /// Camera to work for, by the name of its [view] [default: the first].
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Index of the correlation worker, from 0.
    #[arg(long, default_value_t = 0)]
    worker: u32,
    #[arg(long, hide = true)]
    origin: Option<String>,
    #[arg(long, hide = true)]
    resume: Option<Resume>,
    #[arg(long, hide = true)]
    supervised: bool,
}

/// The arguments of `cameras`.
#[derive(Debug, Args)]
pub struct Cameras {
    /// List the features of the camera with this address, name or device file.
    #[arg(long, value_name = "ID")]
    features: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The arguments of `check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Rig file.
    config: PathBuf,
    /// How long to film, s.
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
    /// HTML page to write.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The arguments of the commands that talk to a running rig.
#[derive(Debug, Args)]
pub struct Rig {
    /// Name of the rig.
    #[arg(long, default_value = "rig")]
    rig: String,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The arguments of `listen`.
#[derive(Debug, Args)]
pub struct Listen {
    /// Topic: field, track, velocity, impact, status or events.
    topic: String,
    /// Name of the rig.
    #[arg(long, default_value = "rig")]
    rig: String,
    /// Print one JSON object per line.
    #[arg(long)]
    json: bool,
    /// Stop after this many lines.
    #[arg(long)]
    count: Option<u64>,
    /// Wait at most this long for a rig that is not running yet, s.
    #[arg(long, default_value_t = 0.0, value_name = "SECONDS")]
    wait: f64,
}

/// The arguments of `analyze`.
#[derive(Debug, Args)]
pub struct Analyze {
    /// A recording, the parts of one stream, footage of another program, or the images of one sequence.
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Camera to measure, by the name of its view [default: the first].
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Rig file [default: the one attached to the recording].
    #[arg(long)]
    config: Option<PathBuf>,
    /// Frame rate, Hz; replaces the file's own, for files that record none or only a playback rate.
    #[arg(long)]
    fps: Option<f64>,
    /// Start at this time after the first frame, s.
    #[arg(long, value_name = "S")]
    from: Option<f64>,
    /// Stop before this time after the first frame, s.
    #[arg(long, value_name = "S")]
    to: Option<f64>,
    /// Results file [default: next to the recording].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Number of workers; the results do not depend on it.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    workers: Option<u32>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The arguments of `bench`.
#[derive(Debug, Args)]
pub struct Bench {
    /// windows: subsets per second for each method and number of threads; live: time per frame on one core; record:
    /// recording rate compared with a plain write of the same bytes.
    #[arg(default_value = "windows", value_parser = ["live", "windows", "record"])]
    part: String,
    /// windows: maximum number of threads [default: the number of cores].
    #[arg(long)]
    threads: Option<usize>,
    /// Measuring time per row, s.
    #[arg(long, default_value_t = 0.5)]
    seconds: f64,
    /// record: directory to write into; the files are removed afterwards.
    #[arg(long, default_value = ".")]
    directory: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The arguments of `export`.
#[derive(Debug, Args)]
pub struct Export {
    /// The recording.
    file: PathBuf,
    /// Tables: velocity, field, track, impact, truth or events. Pictures and films: frames, track or field. mcap:
    /// results. ros2: frames.
    #[arg(long)]
    topic: String,
    /// Tables: csv, parquet or npz (NumPy). Pictures: png (a directory of them). Films: mp4 or gif, with an installed
    /// ffmpeg. Recordings: mcap (everything but the frames) or ros2 (the frames as sensor_msgs/msg/Image).
    #[arg(long, default_value = "csv")]
    format: String,
    /// Camera to export, by the name of its view [default: the first].
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// File or directory to write [default for csv: standard output].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Playback rate of a film, frames per second.
    #[arg(long, default_value_t = 25.0, value_name = "HZ")]
    fps: f64,
}

/// The arguments of `report`.
#[derive(Debug, Args)]
pub struct Report {
    /// One recording, or several of the same experiment.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Camera to report on, by the name of its view [default: the first].
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Film that the results were measured from; the page shows its frames.
    #[arg(long)]
    film: Option<PathBuf>,
    /// HTML page to write [default: next to the first recording].
    #[arg(short, long)]
    output: Option<PathBuf>,
}

/// The arguments of `info`.
#[derive(Debug, Args)]
pub struct Info {
    /// The recording.
    file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The arguments of `recover`.
#[derive(Debug, Args)]
pub struct Recover {
    /// Recording that was cut off.
    file: PathBuf,
    /// Recording to write.
    #[arg(short, long)]
    output: PathBuf,
}

/// The arguments of `import`.
#[derive(Debug, Args)]
pub struct Import {
    /// A Photron, Phantom or NumPy (.npy) file, a film (AVI, MP4, MOV, MKV; needs ffmpeg), a multi-page TIFF, or the
    /// images of one sequence in order.
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Frame rate, Hz; replaces the file's own.
    #[arg(long)]
    fps: Option<f64>,
    /// Recording to write.
    #[arg(short, long)]
    output: PathBuf,
}

/// The arguments of `simulate`.
#[derive(Debug, Args)]
pub struct Simulate {
    /// A built-in scenario such as lacrosse, or the path of a scenario file.
    scenario: String,
    /// Recording to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The parsed command line.
#[derive(Debug)]
pub enum Parsed {
    /// A command to run.
    Run(Command),
    /// Help or an error was printed; the exit code.
    Told(u8),
}

/// Parses the command line and prints help and errors.
pub fn parse() -> Parsed {
    match Line::try_parse() {
        Ok(line) => Parsed::Run(line.command),
        Err(error) if error.use_stderr() && error.kind() != ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            eprintln!("ricochet: {}; see `ricochet --help`", one_line(&error.to_string()));
            Parsed::Told(2)
        }
        Err(error) => {
            let _ = error.print();
            Parsed::Told(if error.use_stderr() { 2 } else { 0 })
        }
    }
}

/// Joins clap's message into one line, without the usage that `--help` repeats.
fn one_line(text: &str) -> String {
    let told = text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let words = told.flat_map(str::split_whitespace).collect::<Vec<_>>().join(" ");
    words.strip_prefix("error: ").unwrap_or(&words).to_owned()
}

/// Whether this process was started by a supervisor and has to end with it.
pub fn is_supervised(command: &Command) -> bool {
    match command {
        Command::Acquire(line) | Command::Correlate(line) | Command::Track(line) | Command::Record(line) => {
            line.supervised
        }
        _ => false,
    }
}

/// Runs a command.
///
/// # Errors
///
/// Any error of the command.
pub fn run(command: Command, stop: &Stop) -> anyhow::Result<Outcome> {
    match command {
        Command::Run { config } => rig::run(&config, stop),
        Command::Acquire(line) => rig::role(Role::Acquire, &line.into(), stop),
        Command::Correlate(line) => rig::role(Role::Correlate, &line.into(), stop),
        Command::Track(line) => rig::role(Role::Track, &line.into(), stop),
        Command::Record(line) => rig::role(Role::Record, &line.into(), stop),
        Command::Check(Check { config, seconds, output, json }) => {
            check::run(&CheckOptions { config, seconds, output, json }, stop)
        }
        Command::Status(line) => status::run(&line.rig, line.json),
        Command::Arm(line) => control::run(&line.rig, Request::Arm, line.json),
        Command::Disarm(line) => control::run(&line.rig, Request::Disarm, line.json),
        Command::Trigger(line) => control::run(&line.rig, Request::Trigger, line.json),
        Command::Demo(Demo { experiment, output, workers, json }) => {
            demo::run(&DemoOptions { experiment, output, workers, json }, stop)
        }
        Command::Listen(Listen { topic, rig, json, count, wait }) => {
            listen::run(&ListenOptions { topic, rig, json, count, wait_s: wait }, stop)
        }
        Command::Replay(line) => command::replay::run(&line.into(), stop),
        Command::Analyze(Analyze { inputs, camera, config, fps, from: from_s, to: to_s, output, workers, json }) => {
            let options = AnalyzeOptions { inputs, camera, config, fps, from_s, to_s, output, workers, json };
            analyze::run(&options, stop)
        }
        Command::Simulate(Simulate { scenario, output, json }) => {
            simulate::run(&SimulateOptions { scenario, output, json })
        }
        Command::Field(line) => Ok(command::field::run(&line.options()?, stop)?),
        Command::Study(line) => line.run(stop),
        other => inspect(other),
    }
}

/// Runs the commands that read files or list cameras.
fn inspect(command: Command) -> anyhow::Result<Outcome> {
    match command {
        Command::Cameras(Cameras { features, json }) => {
            cameras::run(&CamerasOptions { json, features_of: features })?;
        }
        Command::Bench(Bench { part, threads, seconds, directory, json }) => match part.as_str() {
            "live" => bench::live(&LiveOptions { json, seconds })?,
            "record" => bench::record(&RecordOptions { json, seconds, directory })?,
            _ => bench::windows(&WindowsOptions { json, threads, seconds })?,
        },
        Command::Export(Export { file, topic, format, camera, output, fps: playback_hz }) => {
            let format = export::Format::from_word(&format)?;
            let options = ExportOptions { file: file.clone(), topic, format, camera, output, playback_hz };
            let exported = export::run(&options)?;
            return Ok(Outcome::of_file(0, &file, exported.truncated.as_deref()));
        }
        Command::Report(Report { files, camera, film, output }) => {
            return report::run(&ReportOptions { files, camera, film, output });
        }
        Command::Info(Info { file, json }) => {
            let info = info::run(&InfoOptions { file, json })?;
            let gone = info.frames.as_ref().and_then(|frames| frames.lost).unwrap_or(0);
            return Ok(Outcome::of_file(gone, &info.file, info.truncated.as_deref()));
        }
        Command::Recover(Recover { file, output }) => {
            let recovered = recover::run(&RecoverOptions { file, output })?;
            return Ok(Outcome::of_losses(recovered.skipped.len() as u64));
        }
        Command::Import(Import { inputs, fps, output }) => {
            for warning in import::run(&ImportOptions { inputs, fps, output })?.warnings {
                log::warn!("{warning}");
            }
        }
        _ => {}
    }
    Ok(Outcome::Clean)
}

impl From<RoleLine> for RoleOptions {
    fn from(line: RoleLine) -> Self {
        let RoleLine { config, camera, worker, origin, resume, .. } = line;
        Self { config, origin, camera, worker, resume }
    }
}
