//! `ricochet replay`: publishes the frames of recordings on the live topics.

mod release;
mod stream;

use super::frame_source::{rig_config, span};
use crate::camera::replay::TimeRange;
use crate::config::Config;
use crate::console::{Outcome, UsageError, print_line, progress};
use crate::failure::Failure;
use crate::message::Role;
use crate::process::{self, Child, Extras, RigLosses, Stop, Summary};
use crate::recording::Recording;
use std::path::PathBuf;
use stream::CameraStream;

/// The playback rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rate {
    /// The rate at which the rig takes the frames, without loss.
    Max,
    /// A multiple of real time; a slow reader loses frames, as with a camera.
    Times(f64),
}

impl std::str::FromStr for Rate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<f64>() {
            _ if text == "max" => Ok(Self::Max),
            Ok(times) if times.is_finite() && (0.001..=1000.0).contains(&times) => Ok(Self::Times(times)),
            _ => Err(format!("{text:?} is neither `max` nor a number from 0.001 to 1000")),
        }
    }
}

/// The condition that releases the next frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tempo {
    /// The playback rate.
    Rate(Rate),
    /// A line on standard input per frame.
    Step,
}

/// The options of `ricochet replay`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct ReplayOptions {
    /// Recordings. Parts of one stream are played as one; each further camera gets a rig of its own, merged by time.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Playback rate: `max`, or a multiple of real time.
    #[arg(long, default_value = "1")]
    pub rate: Rate,
    /// Play one frame per line on standard input (Enter); a number plays that many, `q` or end of input stops.
    #[arg(long, conflicts_with = "rate")]
    pub step: bool,
    /// Shift the time stamps to begin now, or at this time (ns since the Unix epoch).
    #[arg(long, value_name = "NS", num_args = 0..=1, require_equals = true)]
    pub shift_times: Option<Option<u64>>,
    /// Play this many times; without a number until stopped.
    #[arg(long = "loop", value_name = "N", require_equals = true, value_parser = clap::value_parser!(u32).range(1..))]
    pub passes: Option<Option<u32>>,
    /// Start at this time after the first frame, s.
    #[arg(long = "from", value_name = "S")]
    pub from_s: Option<f64>,
    /// Stop before this time after the first frame, s.
    #[arg(long = "to", value_name = "S")]
    pub to_s: Option<f64>,
    /// Rig file [default: the one attached to the recording].
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Directory to record the results into.
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Name of the rig [default: `replay-` and the recorded name].
    #[arg(long)]
    pub rig: Option<String>,
    /// Number of correlation workers.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub workers: Option<u32>,
}

impl ReplayOptions {
    /// Returns the condition that releases the next frame.
    fn tempo(&self) -> Tempo {
        if self.step { Tempo::Step } else { Tempo::Rate(self.rate) }
    }

    /// Whether this pass, counted from 1, is the last. Without `--loop` there is one; `--loop` without a number has no
    /// last.
    fn is_last(&self, pass: u32) -> bool {
        self.passes.unwrap_or(Some(1)).is_some_and(|passes| pass >= passes)
    }
}

/// A stream and the rig that plays it.
struct ReplayRig {
    recording: Recording,
    config: Config,
    span: TimeRange,
}

/// Plays each recording through a rig of its own until the end or a stop.
///
/// Recordings that continue each other form one stream. Streams of several cameras, and those that overlap in time,
/// get one rig each; the frames of all rigs are published in time order.
///
/// # Errors
///
/// When a recording cannot be read or a rig cannot run.
pub fn run(options: &ReplayOptions, stop: &Stop) -> Result<Outcome, Failure> {
    let whole = span(options.from_s, options.to_s)?;
    let streams = stream::restrict_streams(stream::join_streams(&options.files)?, whole)?;
    let mut losses = RigLosses::default();
    for pass in 1_u32.. {
        // Each pass is a separate run: stamps and sequence numbers restart, and nothing spans two passes.
        let rigs = plan_rigs(options, &streams)?;
        let (summaries, is_over) = match (options.tempo(), rigs.as_slice()) {
            (Tempo::Rate(_), [alone]) => (vec![play_alone(alone, stop)?], false),
            _ => release::play_in_order(&rigs, options.tempo(), stop)?,
        };
        for summary in &summaries {
            losses.add(&summary.by_kind);
            for path in &summary.recordings {
                print_line(&path.display().to_string());
            }
        }
        if is_over || stop.requested() || options.is_last(pass) {
            break;
        }
    }
    let cut = streams.iter().find(|one| one.recording.truncated().is_some());
    let cause = cut.and_then(|one| Some(format!("{}: {}", one.recording.path().display(), one.recording.truncated()?)));
    let is_clean = losses.largest() == 0 && cause.is_none();
    Ok(if is_clean { Outcome::Clean } else { Outcome::RigLost { losses, cause } })
}

/// Plays one stream, paced by its camera source.
fn play_alone(rig: &ReplayRig, stop: &Stop) -> Result<Summary, Failure> {
    let total = rig.recording.frame_count();
    let bar = progress::bar(total, "replay");
    let tracker = Child::first(Role::Track);
    let summary = process::supervise(&rig.config, stop, Extras::default(), |latest| {
        if let Some(status) = latest.get(&tracker) {
            bar.set_position(status.given.min(total));
        }
    })?;
    bar.finish_and_clear();
    Ok(summary)
}

/// Returns a rig per stream, with distinct names and the time stamps shifted as the options request.
///
/// # Errors
///
/// When a rig file is missing or refused, or the shift exceeds 64 bits.
fn plan_rigs(options: &ReplayOptions, streams: &[CameraStream]) -> Result<Vec<ReplayRig>, Failure> {
    let waits_for_release = streams.len() > 1 || options.step;
    let first_ns = stream::first_ns(streams)?;
    let begin_ns = match options.shift_times {
        None => first_ns,
        Some(None) => process::host_ns(),
        Some(Some(ns)) => ns,
    };
    let shift_ns = i64::try_from(i128::from(begin_ns) - i128::from(first_ns))
        .map_err(|_| UsageError(format!("--shift-times={begin_ns}: too far from the recorded times")))?;
    let mut names = Vec::<String>::new();
    let mut rigs = Vec::new();
    for CameraStream { recording, camera, span } in streams {
        let base = rig_config(recording, camera.as_deref(), options.config.as_deref())?;
        let name = free_name(&options.rig.clone().unwrap_or_else(|| replay_name(&base.rig.name)), &names);
        let mut changes = rig_changes(options, waits_for_release);
        changes.push(("rig.name", name.as_str().into()));
        changes.push(("camera.from_s", span.from_s.into()));
        if span.to_s.is_finite() {
            changes.push(("camera.to_s", span.to_s.into()));
        }
        if let Some(camera) = camera {
            changes.push(("camera.view", camera.as_str().into()));
        }
        if shift_ns != 0 {
            changes.push(("camera.shift_ns", shift_ns.into()));
        }
        let parts: Vec<String> = recording.files().skip(1).map(|path| path.display().to_string()).collect();
        if !parts.is_empty() {
            changes.push(("camera.parts", parts.into_iter().collect::<toml_edit::Array>().into()));
        }
        let config = base.with_recording(recording.path(), &changes)?;
        names.push(name);
        rigs.push(ReplayRig { recording: recording.clone(), config, span: *span });
    }
    Ok(rigs)
}

/// Returns the changes of the rig file that the options request. A rig that waits for the release of each frame is
/// stepped.
fn rig_changes(options: &ReplayOptions, waits_for_release: bool) -> Vec<(&'static str, toml_edit::Value)> {
    let paced = !waits_for_release && options.tempo() != Tempo::Rate(Rate::Max);
    let mut changes: Vec<(&str, toml_edit::Value)> = vec![("camera.paced", paced.into())];
    if waits_for_release {
        changes.push(("camera.stepped", true.into()));
    } else if let Tempo::Rate(Rate::Times(times)) = options.tempo() {
        changes.push(("camera.playback_rate", times.into()));
    }
    if let Some(workers) = options.workers {
        changes.push(("workers.count", i64::from(workers).into()));
    }
    if let Some(directory) = &options.output {
        changes.push(("record.directory", directory.display().to_string().into()));
    }
    changes
}

/// Returns this name, with a number appended if it is taken, at most 32 characters.
fn free_name(name: &str, taken: &[String]) -> String {
    let numbered = |number: usize| {
        let ending = format!("-{number}");
        name.chars().take(32 - ending.len()).collect::<String>() + &ending
    };
    let mut names = std::iter::once(name.to_owned()).chain((2..).map(numbered));
    names.find(|name| !taken.contains(name)).unwrap_or_else(|| name.to_owned())
}

/// Returns the name of the rig that replays a rig, at most 32 characters.
fn replay_name(rig: &str) -> String {
    if rig.starts_with("replay-") { rig.to_owned() } else { format!("replay-{rig}").chars().take(32).collect() }
}
