//! The command line: the list of commands. Each command declares its options in its own file.

use super::console::Outcome;
use crate::command;
use crate::command::analyze::{self, AnalyzeOptions};
use crate::command::batch;
use crate::command::bench::{self, BenchOptions};
use crate::command::bindings::{self, Language};
#[cfg(feature = "zenoh")]
use crate::command::bridge::{self, BridgeOptions};
use crate::command::cameras::{self, CamerasOptions};
use crate::command::check::{self, CheckOptions};
use crate::command::config::{self, ConfigCommand};
use crate::command::control::{self, RigOptions, TriggerOptions};
use crate::command::demo::{self, DemoOptions};
use crate::command::diagnose::{self, DiagnoseOptions};
use crate::command::doctor::{self, DoctorOptions};
use crate::command::export::{self, ExportOptions};
use crate::command::import::{self, ImportOptions};
use crate::command::info::{self, InfoOptions};
use crate::command::init::{self, InitOptions};
use crate::command::listen::{self, ListenOptions};
use crate::command::merge::{self, MergeOptions};
use crate::command::recover::{self, RecoverOptions};
use crate::command::replay::{self, ReplayOptions};
use crate::command::report::{self, ReportOptions};
use crate::command::rig::{self, RoleOptions};
use crate::command::serve::{self, ServeOptions};
use crate::command::setup::{self, SetupOptions};
use crate::command::shell;
use crate::command::simulate::{self, SimulateOptions};
use crate::command::status;
use crate::command::status::StatusOptions;
use crate::failure::Failure;
use crate::message::{Command as Request, Role};
use crate::process::Stop;
mod field;
mod study;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use field::Field;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use study::Study;

/// The exit codes, as `--help` shows them.
const EXIT_CODES: &str = "\
Exit codes:
  0  Done
  1  Internal error
  2  Wrong usage or configuration
  3  A camera cannot be used
  4  The shared memory cannot be used, or no such rig runs
  5  A recording or another file cannot be read or written
  6  Finished, but data were lost
  7  Finished, but no body was measured in any frame
130  Interrupted by Ctrl-C (143: by SIGTERM); nothing unfinished is left";

/// Measures an impact live with a high-speed camera.
#[derive(Debug, Parser)]
#[command(name = "ricochet", version, max_term_width = 100, after_help = EXIT_CODES)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a simulated rig with all its processes and compare the measurement with the truth.
    #[command(after_help = "Example: ricochet demo lacrosse --output shots")]
    Demo(DemoOptions),
    /// Run a rig: camera, workers, tracker and recorder, each in its own process.
    #[command(after_help = "Example: ricochet run config/genicam.toml")]
    Run {
        /// Rig file.
        config: PathBuf,
    },
    /// Run one process of a rig: the camera writes frames into the ring.
    #[command(after_help = "Example: ricochet acquire rig.toml")]
    Acquire(RoleOptions),
    /// Run one process of a rig: a worker measures blocks of frames.
    #[command(after_help = "Example: ricochet correlate rig.toml --worker 1")]
    Correlate(RoleOptions),
    /// Run one process of a rig: the tracker publishes tracks, velocities and impacts in frame order.
    #[command(after_help = "Example: ricochet track rig.toml")]
    Track(RoleOptions),
    /// Run one process of a rig: the recorder writes recordings.
    #[command(after_help = "Example: ricochet record rig.toml")]
    Record(RoleOptions),
    /// Serve the operator's page of a rig, and its topics as streams for other programs.
    #[command(after_help = "Example: ricochet serve rig.toml")]
    Serve(ServeOptions),
    /// Publish the topics of a rig for other hosts by Zenoh, and take their commands.
    #[cfg(feature = "zenoh")]
    #[command(after_help = "Example: ricochet bridge rig.toml")]
    Bridge(BridgeOptions),
    /// List the available cameras with their formats and frame rates.
    #[command(after_help = "Example: ricochet cameras --features 192.168.1.20")]
    Cameras(CamerasOptions),
    /// Check whether a rig is ready: noise floor, light, speckle pattern, focus, lost frames.
    #[command(after_help = "Example: ricochet check rig.toml -o check.html")]
    Check(CheckOptions),
    /// Examine this machine: memory, disk, network, cameras, tools; with a command for what is wrong.
    #[command(after_help = "Example: ricochet doctor rig.toml")]
    Doctor(DoctorOptions),
    /// Explain the keys of the rig file, check a file, or print the schema for editors.
    #[command(subcommand, after_help = "Example: ricochet config explain body.diameter_mm")]
    Config(ConfigCommand),
    /// Show the state of each process of a running rig.
    #[command(after_help = "Example: ricochet status --rig lacrosse")]
    Status(StatusOptions),
    /// Arm a running rig so that it waits for a trigger.
    #[command(after_help = "Example: ricochet arm --rig lacrosse")]
    Arm(RigOptions),
    /// Disarm a running rig so that it ignores triggers.
    #[command(after_help = "Example: ricochet disarm --rig lacrosse")]
    Disarm(RigOptions),
    /// Trigger a running rig: record a shot around this moment.
    #[command(after_help = "Example: ricochet trigger --rig lacrosse")]
    Trigger(TriggerOptions),
    /// Print a live topic: field, track, velocity, impact, status or events.
    #[command(after_help = "Example: ricochet listen velocity --rig lacrosse --json")]
    Listen(ListenOptions),
    /// Replay the frames of a recording through a rig and publish its live topics.
    #[command(after_help = "Example: ricochet replay recordings/lacrosse.mcap --rate max")]
    Replay(ReplayOptions),
    /// Measure a recording offline.
    #[command(after_help = "Example: ricochet analyze recordings/lacrosse.mcap -o results.mcap")]
    Analyze(AnalyzeOptions),
    /// Merge the results of many films into one table.
    #[command(after_help = "Example: ricochet merge results --topic impact -o impacts.csv")]
    Merge(MergeOptions),
    /// Ask what camera, body, scale and surface there are, and write a commented rig file.
    #[command(after_help = "Example: ricochet init -o rig.toml")]
    Init(InitOptions),
    /// Propose a rig file for a film: find what moves, its radius, the scale, the surface and gravity.
    #[command(after_help = "Example: ricochet setup drop.mp4 --fps 240 --diameter-mm 63.25 -o rig.toml")]
    Setup(SetupOptions),
    /// Show in pictures what was searched in a film, what was found, and why it was refused.
    #[command(after_help = "Example: ricochet diagnose drop.mp4 --fps 240 --config rig.toml -o drop.html")]
    Diagnose(DiagnoseOptions),
    /// Measure the displacement field of two still images, or of a series against its first image.
    #[command(after_help = "Example: ricochet field before.bmp after.bmp -o field.csv --picture field.png")]
    Field(Box<Field>),
    /// Benchmark this machine: how fast it measures and records.
    #[command(after_help = "Example: ricochet bench windows --json")]
    Bench(BenchOptions),
    /// Export a topic of a recording as a table, pictures, a film or a recording.
    #[command(after_help = "Example: ricochet export shot.mcap --topic velocity --format csv -o velocity.csv")]
    Export(ExportOptions),
    /// Write a report page of a recording (numbers, curves, pictures), or a repeatability page of several.
    #[command(after_help = "Example: ricochet report shot.mcap -o shot.html")]
    Report(ReportOptions),
    /// Show the contents of a recording and any damage.
    #[command(after_help = "Example: ricochet info shot.mcap --json")]
    Info(InfoOptions),
    /// Recover every complete frame of a recording that was cut off.
    #[command(after_help = "Example: ricochet recover shot.mcap.part -o shot.mcap")]
    Recover(RecoverOptions),
    /// Convert footage of other programs or cameras into a recording.
    #[command(after_help = "Example: ricochet import frame_*.tif --fps 10000 -o shot.mcap")]
    Import(ImportOptions),
    /// Render a simulated impact into a recording together with its ground truth.
    #[command(after_help = "Example: ricochet simulate lacrosse -o lacrosse.mcap")]
    Simulate(SimulateOptions),
    /// Study how settings, speckle patterns and methods affect accuracy.
    #[command(subcommand, after_help = "Example: ricochet study convergence --json")]
    Study(Study),
    /// Print the messages in shared memory as declarations of another language: python or c.
    #[command(after_help = "Example: ricochet bindings c > ricochet.h")]
    Bindings {
        /// Language.
        language: Language,
    },
    /// Print the completions of a shell: bash, zsh, fish, elvish or powershell.
    #[command(after_help = "Example: ricochet completions bash > /usr/share/bash-completion/completions/ricochet")]
    Completions {
        /// Shell.
        shell: clap_complete::Shell,
    },
    /// Print the manual page of the program or of a command, or write all of them.
    #[command(after_help = "Example: ricochet man analyze | man -l -")]
    Man {
        /// Command [default: the program].
        command: Option<String>,
        /// Folder to write the pages of all commands into.
        #[arg(short, long, conflicts_with = "command")]
        output: Option<PathBuf>,
    },
}

/// The parsed command line.
#[derive(Debug)]
pub enum Parsed {
    /// A command to run.
    Run(Command),
    /// Help or an error was printed; the exit code.
    Printed(u8),
}

/// Parses the command line and prints help and errors.
pub fn parse() -> Parsed {
    parse_from(std::env::args_os())
}

/// Parses these arguments as a command line that begins with the program's name, like [`parse`].
pub fn parse_from(args: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Parsed {
    let words: Vec<OsString> = args.into_iter().map(Into::into).collect();
    match parse_words(&words) {
        Ok(line) => Parsed::Run(line.command),
        Err(error) if error.use_stderr() && error.kind() != ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let message = file_without_command(&error, &words).unwrap_or_else(|| one_line(&error.to_string()));
            let _ = writeln!(std::io::stderr(), "ricochet: {message}; see `ricochet --help`");
            Parsed::Printed(2)
        }
        Err(error) => {
            let _ = error.print();
            Parsed::Printed(if error.use_stderr() { 2 } else { 0 })
        }
    }
}

/// Parses the words of a command line. A number after an option may be negative, so that its range is what refuses it.
fn parse_words(words: &[OsString]) -> Result<Args, clap::Error> {
    let command = with_negative_numbers(Args::command());
    Args::from_arg_matches(&command.try_get_matches_from(words)?)
}

/// Lets a command and its subcommands take negative numbers as values.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command.allow_negative_numbers(true).mut_subcommands(with_negative_numbers)
}

/// Returns the command to use for a file that stands where a command is expected; `None` for any other error.
fn file_without_command(error: &clap::Error, words: &[OsString]) -> Option<String> {
    let file =
        words.get(1).map(Path::new).filter(|file| error.kind() == ErrorKind::InvalidSubcommand && file.exists())?;
    let command = if file.extension().is_some_and(|ending| ending == "toml") { "run" } else { "analyze" };
    let file = file.display();
    Some(format!("{file} is a file, and a command is missing: `ricochet {command} {file}`"))
}

/// Joins clap's message into one line, without its `error:` prefix and the usage that `--help` repeats.
fn one_line(text: &str) -> String {
    let message = text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let words = message.flat_map(str::split_whitespace).collect::<Vec<_>>().join(" ");
    let words = words.strip_prefix("error: ").unwrap_or(&words);
    words.replace("invalid float literal", "not a number; decimals follow a point, as in 63.25")
}

/// The end of a command at Ctrl-C or a termination signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// A supervisor decides, since others depend on this process.
    Supervised,
    /// The command stops a rig, a camera or a stream in order, and then ends by itself.
    InOrder,
    /// The command ends at once and leaves nothing unfinished.
    AtOnce,
}

impl Ending {
    /// Returns the end of a command.
    pub fn of(command: &Command) -> Self {
        let supervised = match command {
            Command::Acquire(role) | Command::Correlate(role) | Command::Track(role) | Command::Record(role) => {
                &role.supervised
            }
            Command::Serve(options) => &options.supervised,
            Command::Run { .. }
            | Command::Demo(_)
            | Command::Replay(_)
            | Command::Check(_)
            | Command::Trigger(_)
            | Command::Listen(_) => return Self::InOrder,
            #[cfg(feature = "zenoh")]
            Command::Bridge(_) => return Self::InOrder,
            // At a rate it measures a whole rig.
            Command::Bench(options) if options.rate.is_some() => return Self::InOrder,
            _ => return Self::AtOnce,
        };
        if supervised.domain.is_some() { Self::Supervised } else { Self::InOrder }
    }
}

/// Runs a command with the rig of another host; `None` if it is for one of this host.
#[cfg(feature = "zenoh")]
fn run_elsewhere(command: &Command, stop: &Stop) -> Option<Result<Outcome, Failure>> {
    match command {
        Command::Listen(options) => options.remote.via.as_ref().map(|via| bridge::listen(options, via, stop)),
        Command::Status(options) => options.remote.via.as_ref().map(|via| bridge::status(options, via)),
        Command::Arm(options) => options.remote.via.as_ref().map(|via| bridge::command(options, Request::Arm, via)),
        Command::Disarm(options) => {
            options.remote.via.as_ref().map(|via| bridge::command(options, Request::Disarm, via))
        }
        Command::Trigger(options) => options.rig.remote.via.as_ref().map(|via| bridge::trigger(options, via)),
        _ => None,
    }
}

/// Runs a command.
///
/// # Errors
///
/// Any error of the command.
pub fn run(command: Command, stop: &Stop) -> Result<Outcome, Failure> {
    #[cfg(feature = "zenoh")]
    if let Some(outcome) = run_elsewhere(&command, stop) {
        return outcome;
    }
    match command {
        Command::Demo(options) => demo::run(&options, stop),
        Command::Run { config } => rig::run(&config, stop),
        Command::Acquire(options) => rig::role(Role::Acquire, &options, stop),
        Command::Correlate(options) => rig::role(Role::Correlate, &options, stop),
        Command::Track(options) => rig::role(Role::Track, &options, stop),
        Command::Record(options) => rig::role(Role::Record, &options, stop),
        Command::Serve(options) => serve::run(&options, stop),
        #[cfg(feature = "zenoh")]
        Command::Bridge(options) => bridge::run(&options, stop),
        Command::Cameras(options) => cameras::run(&options),
        Command::Check(options) => check::run(&options, stop),
        Command::Status(options) => status::run(&options),
        Command::Arm(options) => control::run(&options, Request::Arm, stop),
        Command::Disarm(options) => control::run(&options, Request::Disarm, stop),
        Command::Trigger(options) => control::trigger(&options, stop),
        Command::Listen(options) => listen::run(&options, stop),
        Command::Replay(options) => replay::run(&options, stop),
        Command::Analyze(options) => match options.shard {
            None => analyze::run(&options),
            Some(shard) => batch::run(&options, shard),
        },
        Command::Doctor(options) => doctor::run(&options),
        Command::Merge(options) => merge::run(&options),
        Command::Config(command) => config::run(&command),
        Command::Bindings { language } => bindings::run(language),
        Command::Completions { shell } => shell::completions(shell, Args::command()),
        Command::Man { command, output } => shell::manual(command.as_deref(), output.as_deref(), Args::command()),
        Command::Init(options) => init::run(&options),
        Command::Setup(options) => setup::run(&options),
        Command::Diagnose(options) => diagnose::run(&options),
        Command::Field(arguments) => Ok(command::field::run(&arguments.options()?)?),
        Command::Bench(options) => bench::run(&options, stop),
        Command::Export(options) => {
            let exported = export::run(&options)?;
            Ok(Outcome::from_file(0, &options.file, exported.truncated.as_deref()))
        }
        Command::Report(options) => report::run(&options),
        Command::Info(options) => {
            let info = info::run(&options)?;
            let lost = info.frames.as_ref().and_then(|frames| frames.lost).unwrap_or(0);
            Ok(Outcome::from_file(lost, &info.file, info.truncated.as_deref()))
        }
        Command::Recover(options) => Ok(Outcome::from_losses(recover::run(&options)?.skipped.len() as u64)),
        Command::Import(options) => {
            import::run(&options)?;
            Ok(Outcome::Clean)
        }
        Command::Simulate(options) => simulate::run(&options),
        Command::Study(study) => study.run(),
    }
}
