//! `ricochet replay`: the frames of recordings on the live topics.

mod lead;
mod stream;

use super::film::span;
use super::{Outcome, UsageError, progress, say, view_config};
use crate::camera::recording::TimeRange;
use crate::config::Config;
use crate::message::Role;
use crate::process::{self, Child, Stop, Summary};
use crate::recording::Recording;
use std::path::{Path, PathBuf};
use stream::Streamed;

/// How fast to play.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rate {
    /// As fast as the rig takes the frames; nothing is lost.
    Max,
    /// This many times real time; who is too slow loses frames, as with a camera.
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

/// What lets the frames go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tempo {
    /// Their own times, or who takes them.
    Rate(Rate),
    /// A line on standard input for each.
    Step,
}

impl From<Rate> for Tempo {
    fn from(rate: Rate) -> Self {
        Self::Rate(rate)
    }
}

/// The times that replayed frames carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Times {
    /// Those recorded.
    Recorded,
    /// The same distances, from this moment on.
    Present,
    /// The same distances, from here on, ns since the Unix epoch.
    From(u64),
}

/// What to play, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayOptions {
    /// The recordings.
    pub files: Vec<PathBuf>,
    /// The rig to play them on; the attached one when absent.
    pub config: Option<PathBuf>,
    /// How fast.
    pub tempo: Tempo,
    /// Which times the frames carry.
    pub times: Times,
    /// How many times; `None` until stopped.
    pub passes: Option<u32>,
    /// Where to begin, seconds from the first frame.
    pub from_s: Option<f64>,
    /// Where to end, seconds from the first frame.
    pub to_s: Option<f64>,
    /// Directory to record the results into.
    pub output: Option<PathBuf>,
    /// Name of the rig, so that it does not meet the one that made the recording.
    pub rig: Option<String>,
    /// Number of workers.
    pub workers: Option<u32>,
}

/// A stream and the rig that it is played on.
struct Played {
    recording: Recording,
    config: Config,
    span: TimeRange,
}

/// Plays recordings through a rig each until they end or are stopped.
///
/// Recordings that go on one from the other are one stream. Streams of several cameras, and those that overlap in
/// time, have a rig each; frames of all are published in the order of their times.
///
/// # Errors
///
/// When a recording cannot be read, or a rig cannot be run.
pub fn run(options: &ReplayOptions, stop: &Stop) -> anyhow::Result<Outcome> {
    let whole = span(options.from_s, options.to_s)?;
    let streams = stream::within(stream::streams(&options.files)?, whole)?;
    let mut lost = 0;
    for pass in 1_u32.. {
        // Each pass is a run of its own: stamps and sequence numbers begin again, and nothing spans two passes.
        let played = rigs(options, &streams)?;
        let (summaries, is_over) = match (options.tempo, played.as_slice()) {
            (Tempo::Rate(_), [alone]) => (vec![play(alone, stop)?], false),
            _ => lead::play(&played, options.tempo, stop)?,
        };
        for summary in &summaries {
            lost += summary.losses();
            for path in &summary.recordings {
                say(&path.display().to_string());
            }
        }
        if is_over || stop.requested() || options.passes.is_some_and(|passes| pass >= passes) {
            break;
        }
    }
    let cut = streams.iter().find(|one| one.recording.truncated().is_some()).or(streams.first());
    let Some(Streamed { recording, .. }) = cut else { return Ok(Outcome::of_losses(lost)) };
    Ok(Outcome::of_file(lost, recording.path(), recording.truncated()))
}

/// One stream, at the pace of its camera.
fn play(played: &Played, stop: &Stop) -> anyhow::Result<Summary> {
    let total = played.recording.frame_count();
    let bar = progress::frames(total, "replay");
    let tracker = Child::first(Role::Track);
    let summary = process::supervise(&played.config, stop, |told| {
        if let Some(status) = told.get(&tracker) {
            bar.set_position(status.given.min(total));
        }
    })?;
    bar.finish_and_clear();
    Ok(summary)
}

/// A rig for each stream, all names different.
fn rigs(options: &ReplayOptions, streams: &[Streamed]) -> anyhow::Result<Vec<Played>> {
    let is_led = streams.len() > 1 || options.tempo == Tempo::Step;
    let first_ns = stream::first_ns(streams)?;
    let begin_ns = match options.times {
        Times::Recorded => first_ns,
        Times::Present => process::host_ns(),
        Times::From(ns) => ns,
    };
    let shift_ns = i64::try_from(i128::from(begin_ns) - i128::from(first_ns))
        .map_err(|_| UsageError(format!("--shift-times={begin_ns}: too far from the recorded times")))?;
    let mut names = Vec::<String>::new();
    let mut played = Vec::new();
    for Streamed { recording, camera, span } in streams {
        let base = rig_config(recording, camera.as_deref(), options.config.as_deref())?;
        let name = free_name(&options.rig.clone().unwrap_or_else(|| replay_name(&base.rig.name)), &names);
        let mut changes = changes(options, is_led);
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
        let config = base.fed_from(recording.path(), &changes)?;
        names.push(name);
        played.push(Played { recording: recording.clone(), config, span: *span });
    }
    Ok(played)
}

fn changes(options: &ReplayOptions, is_led: bool) -> Vec<(&'static str, toml_edit::Value)> {
    let paced = !is_led && options.tempo != Tempo::Rate(Rate::Max);
    let mut changes: Vec<(&str, toml_edit::Value)> = vec![("camera.paced", paced.into())];
    if is_led {
        changes.push(("camera.stepped", true.into()));
    } else if let Tempo::Rate(Rate::Times(times)) = options.tempo {
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

/// This name, numbered when another rig has it.
fn free_name(name: &str, taken: &[String]) -> String {
    let numbered = |number: usize| {
        let ending = format!("-{number}");
        name.chars().take(32 - ending.len()).collect::<String>() + &ending
    };
    let mut names = std::iter::once(name.to_owned()).chain((2..).map(numbered));
    names.find(|name| !taken.contains(name)).unwrap_or_else(|| name.to_owned())
}

fn replay_name(rig: &str) -> String {
    if rig.starts_with("replay-") { rig.to_owned() } else { format!("replay-{rig}").chars().take(32).collect() }
}

/// The rig that a recording is measured with, or that of one of its cameras: the one given, else the one attached.
///
/// # Errors
///
/// When none is given and none attached, or it is wrong.
pub fn rig_config(recording: &Recording, camera: Option<&str>, given: Option<&Path>) -> anyhow::Result<Config> {
    if let Some(path) = given {
        let config = Config::load(path)?;
        // One that knows several cameras says how each is measured; any other is meant for the one at hand.
        return Ok(if config.views.is_empty() { config } else { view_config(config, camera)? });
    }
    let path = recording.path().display();
    match recording.config_toml() {
        Some(text) => Ok(Config::parse(text, &format!("config.toml in {path}"))?),
        None => Err(UsageError(format!("{path}: no config.toml is attached; give one with --config")).into()),
    }
}
