//! The command line; the only room that names clap.

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

/// Films an impact with a high-speed camera and measures it while it happens.
#[derive(Debug, Parser)]
#[command(name = "ricochet", version, max_term_width = 100)]
struct Line {
    #[command(subcommand)]
    command: Command,
}

/// What was asked for.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a simulated rig with all its processes and compare what it measures with the truth.
    #[command(after_help = "Example: ricochet demo lacrosse --output shots")]
    Demo(Demo),
    /// Run a rig: camera, workers, tracker and recorder, each a process of its own.
    #[command(after_help = "Example: ricochet run config/genicam.toml")]
    Run {
        /// The rig file.
        config: PathBuf,
    },
    /// One process of a rig: the camera fills the ring.
    #[command(after_help = "Example: ricochet acquire rig.toml")]
    Acquire(RoleLine),
    /// One process of a rig: measures blocks of frames.
    #[command(after_help = "Example: ricochet correlate rig.toml --worker 1")]
    Correlate(RoleLine),
    /// One process of a rig: tracks, velocities and impacts, in frame order.
    #[command(after_help = "Example: ricochet track rig.toml")]
    Track(RoleLine),
    /// One process of a rig: writes recordings.
    #[command(after_help = "Example: ricochet record rig.toml")]
    Record(RoleLine),
    /// List the cameras in reach, their formats and rates.
    #[command(after_help = "Example: ricochet cameras --features 192.168.1.20")]
    Cameras(Cameras),
    /// Tell whether a rig is ready for a drop: noise floor, light, pattern, focus, lost frames.
    #[command(after_help = "Example: ricochet check rig.toml -o check.html")]
    Check(Check),
    /// Tell how the processes of a running rig are doing.
    #[command(after_help = "Example: ricochet status --rig lacrosse")]
    Status(Rig),
    /// Make a running rig wait for a trigger.
    #[command(after_help = "Example: ricochet arm --rig lacrosse")]
    Arm(Rig),
    /// Make a running rig ignore triggers.
    #[command(after_help = "Example: ricochet disarm --rig lacrosse")]
    Disarm(Rig),
    /// Record a shot around this moment.
    #[command(after_help = "Example: ricochet trigger --rig lacrosse")]
    Trigger(Rig),
    /// Print a live topic: field, track, velocity, impact, status or events.
    #[command(after_help = "Example: ricochet listen velocity --rig lacrosse --json")]
    Listen(Listen),
    /// Play a recording's frames on the live topics, through a rig.
    #[command(after_help = "Example: ricochet replay recordings/lacrosse.mcap --rate max")]
    Replay(Replay),
    /// Measure a recording offline.
    #[command(after_help = "Example: ricochet analyze recordings/lacrosse.mcap -o results.mcap")]
    Analyze(Analyze),
    /// Displacement field of two still images, or of a series against its first.
    #[command(after_help = "Example: ricochet field before.bmp after.bmp -o field.csv --picture field.png")]
    Field(Box<Field>),
    /// Tell how fast this machine measures, part by part.
    #[command(after_help = "Example: ricochet bench windows --json")]
    Bench(Bench),
    /// Write a topic of a recording as a table.
    #[command(after_help = "Example: ricochet export shot.mcap --topic velocity --format csv -o velocity.csv")]
    Export(Export),
    /// Tell a recording on one page: numbers, curves, pictures; several recordings: how well they repeat.
    #[command(after_help = "Example: ricochet report shot.mcap -o shot.html")]
    Report(Report),
    /// Tell what is in a recording, and what is wrong with it.
    #[command(after_help = "Example: ricochet info shot.mcap --json")]
    Info(Info),
    /// Bring back every whole frame of a recording that was cut off.
    #[command(after_help = "Example: ricochet recover shot.mcap.part -o shot.mcap")]
    Recover(Recover),
    /// Turn other people's footage into a recording.
    #[command(after_help = "Example: ricochet import frame_*.tif --fps 10000 -o shot.mcap")]
    Import(Import),
    /// Draw a simulated impact into a recording, with the truth beside it.
    #[command(after_help = "Example: ricochet simulate lacrosse -o lacrosse.mcap")]
    Simulate(Simulate),
    /// Study what settings, speckle patterns and methods do to the answers.
    #[command(after_help = "Example: ricochet study convergence --json")]
    Study(Study),
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Demo {
    /// The experiment: lacrosse, tennis or rod.
    #[arg(default_value = "lacrosse")]
    experiment: String,
    /// Directory of the recording.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Number of correlation workers.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    workers: Option<u32>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct RoleLine {
    /// The rig file; `-` reads it from standard input.
    config: PathBuf,
    /// The camera that it works for, by the name of its [view]; the first when absent.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Which correlation worker, from 0.
    #[arg(long, default_value_t = 0)]
    worker: u32,
    #[arg(long, hide = true)]
    origin: Option<String>,
    #[arg(long, hide = true)]
    resume: Option<Resume>,
    #[arg(long, hide = true)]
    supervised: bool,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Cameras {
    /// Print what the camera of this address, name or device file can be set to.
    #[arg(long, value_name = "ID")]
    features: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Check {
    /// The rig file.
    config: PathBuf,
    /// How long the camera is watched, s.
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
    /// The HTML page to write.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Rig {
    /// Name of the rig.
    #[arg(long, default_value = "rig")]
    rig: String,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Listen {
    /// field, track, velocity, impact, status or events.
    topic: String,
    /// Name of the rig.
    #[arg(long, default_value = "rig")]
    rig: String,
    /// Print one JSON object a line.
    #[arg(long)]
    json: bool,
    /// Stop after this many lines.
    #[arg(long)]
    count: Option<u64>,
    /// Wait this long for a rig that does not run yet, s.
    #[arg(long, default_value_t = 0.0, value_name = "SECONDS")]
    wait: f64,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Analyze {
    /// A recording, the parts of one stream, other people's footage, or the images of one sequence.
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Which of several cameras, by the name of its view; the first when absent.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// The rig file; the attached one when absent.
    #[arg(long)]
    config: Option<PathBuf>,
    /// Frame rate, Hz; takes the place of the file's own, for those that tell none or that of their playback.
    #[arg(long)]
    fps: Option<f64>,
    /// Begin here, seconds from the first frame.
    #[arg(long, value_name = "S")]
    from: Option<f64>,
    /// End before this, seconds from the first frame.
    #[arg(long, value_name = "S")]
    to: Option<f64>,
    /// The results file; beside the recording when absent.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Number of workers; the results do not depend on it.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    workers: Option<u32>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Bench {
    /// windows: subsets a second, by method and number of threads; live: what a frame takes on one core; record: how
    /// fast recordings are written, beside a plain write of the same bytes.
    #[arg(default_value = "windows", value_parser = ["live", "windows", "record"])]
    part: String,
    /// windows: largest number of threads; as many as this machine runs at once when absent.
    #[arg(long)]
    threads: Option<usize>,
    /// How long each row is measured, s.
    #[arg(long, default_value_t = 0.5)]
    seconds: f64,
    /// record: the folder to write into; the files are removed again.
    #[arg(long, default_value = ".")]
    directory: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of a command.
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
    /// Which of several cameras, by the name of its view; the first when absent.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// The file or the directory to write; of csv, standard output when absent.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Frames that a film shows in a second.
    #[arg(long, default_value_t = 25.0, value_name = "HZ")]
    fps: f64,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Report {
    /// One recording, or several of the same experiment.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Which of several cameras, by the name of its view; the first when absent.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// The film that results alone were measured from: the page shows its frames.
    #[arg(long)]
    film: Option<PathBuf>,
    /// The HTML page to write; beside the first recording when absent.
    #[arg(short, long)]
    output: Option<PathBuf>,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Info {
    /// The recording.
    file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Recover {
    /// The recording that was cut off.
    file: PathBuf,
    /// The recording to write.
    #[arg(short, long)]
    output: PathBuf,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Import {
    /// One Photron, Phantom or NumPy (.npy) file, film (AVI, MP4, MOV, MKV, with an installed ffmpeg) or TIFF of several
    /// pages, or the images of one sequence, in order.
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Frame rate, Hz; takes the place of the file's own.
    #[arg(long)]
    fps: Option<f64>,
    /// The recording to write.
    #[arg(short, long)]
    output: PathBuf,
}

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Simulate {
    /// lacrosse, or the path of a scenario file.
    scenario: String,
    /// The recording to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What came of the command line.
#[derive(Debug)]
pub enum Parsed {
    /// Something to run.
    Run(Command),
    /// Help or an error was printed; the exit code to end with.
    Told(u8),
}

/// Reads the command line; prints help and errors itself.
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

/// What clap says over several lines, without the usage that `--help` repeats.
fn one_line(text: &str) -> String {
    let told = text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let words = told.flat_map(str::split_whitespace).collect::<Vec<_>>().join(" ");
    words.strip_prefix("error: ").unwrap_or(&words).to_owned()
}

/// Whether this process belongs to a supervisor and shall end with it.
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
/// What the command meets.
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

/// The commands that look at files and cameras.
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
