//! `ricochet replay`: a recording's frames on the live topics.

use super::film::{check_span, span};
use super::{Outcome, UsageError, progress, say};
use crate::config::Config;
use crate::message::Role;
use crate::process::{self, Child, Stop};
use crate::recording::Recording;
use std::path::{Path, PathBuf};

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

/// What to play, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayOptions {
    /// The recording.
    pub file: PathBuf,
    /// The rig to play it on; the attached one when absent.
    pub config: Option<PathBuf>,
    /// How fast.
    pub rate: Rate,
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

/// Plays a recording through a rig until it ends or is stopped.
///
/// # Errors
///
/// When the recording cannot be read, or the rig cannot be run.
pub fn run(options: &ReplayOptions, stop: &Stop) -> anyhow::Result<Outcome> {
    let recording = Recording::open(&options.file)?;
    check_span(&recording, span(options.from_s, options.to_s)?)?;
    let base = rig_config(&recording, options.config.as_deref())?;
    let config = base.fed_from(&options.file, &changes(options, &base))?;
    let total = recording.frame_count();
    let bar = progress::frames(total, "replay");
    let tracker = Child { role: Role::Track, index: 0 };
    let mut lost = 0;
    for pass in 1_u32.. {
        // Each pass is a run of its own: stamps and sequence numbers begin again, and nothing spans two passes.
        let summary = process::supervise(&config, stop, |told| {
            if let Some(status) = told.get(&tracker) {
                bar.set_position(status.given.min(total));
            }
        })?;
        lost += summary.losses();
        for path in &summary.recordings {
            say(&path.display().to_string());
        }
        if stop.requested() || options.passes.is_some_and(|passes| pass >= passes) {
            break;
        }
    }
    bar.finish_and_clear();
    Ok(Outcome::of_file(lost, &options.file, recording.truncated()))
}

fn changes<'a>(options: &ReplayOptions, base: &Config) -> Vec<(&'a str, toml_edit::Value)> {
    let mut changes: Vec<(&str, toml_edit::Value)> = vec![("camera.paced", (options.rate != Rate::Max).into())];
    if let Rate::Times(times) = options.rate {
        changes.push(("camera.playback_rate", times.into()));
    }
    let ends = [("camera.from_s", options.from_s), ("camera.to_s", options.to_s)];
    changes.extend(ends.into_iter().filter_map(|(key, given)| Some((key, given?.into()))));
    let name = options.rig.clone().unwrap_or_else(|| replay_name(&base.rig.name));
    changes.push(("rig.name", name.into()));
    if let Some(workers) = options.workers {
        changes.push(("workers.count", i64::from(workers).into()));
    }
    if let Some(directory) = &options.output {
        changes.push(("record.directory", directory.display().to_string().into()));
    }
    changes
}

fn replay_name(rig: &str) -> String {
    if rig.starts_with("replay-") { rig.to_owned() } else { format!("replay-{rig}").chars().take(32).collect() }
}

/// The rig that a recording is measured with: the one given, else the one attached to it.
///
/// # Errors
///
/// When none is given and none attached, or it is wrong.
pub fn rig_config(recording: &Recording, given: Option<&Path>) -> anyhow::Result<Config> {
    if let Some(path) = given {
        return Ok(Config::load(path)?);
    }
    let path = recording.path().display();
    match recording.config_toml() {
        Some(text) => Ok(Config::parse(text, &format!("config.toml in {path}"))?),
        None => Err(UsageError(format!("{path}: no config.toml is attached; give one with --config")).into()),
    }
}
