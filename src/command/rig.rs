//! `ricochet run` and the roles it starts.

use super::Outcome;
use crate::config::Config;
use crate::message::Role;
use crate::process::{self, Resume, Stop, Summary};
use std::io::BufRead;
use std::path::{Path, PathBuf};

/// What one process of a rig is started with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RoleOptions {
    /// The rig file; `-` reads it from standard input.
    pub config: PathBuf,
    /// What errors call a file from standard input.
    pub origin: Option<String>,
    /// The camera that it works for; the first when absent.
    pub camera: Option<String>,
    /// Which worker, from 0.
    pub worker: u32,
    /// What a dead predecessor told of.
    pub resume: Option<Resume>,
}

/// Runs one process of a rig until its stream ends or it is stopped.
///
/// # Errors
///
/// What the process meets.
pub fn role(role: Role, options: &RoleOptions, stop: &Stop) -> anyhow::Result<Outcome> {
    let config = load(&options.config, options.origin.as_deref())?;
    let config = match &options.camera {
        Some(_) if role == Role::Record => {
            return Err(super::UsageError("--camera: the recorder is that of all cameras".into()).into());
        }
        camera => super::view_config(config, camera.as_deref())?,
    };
    let config = &config;
    let is_measuring = matches!(role, Role::Correlate | Role::Track);
    if is_measuring && config.workers.count == 0 {
        let origin = &config.origin;
        return Err(
            super::UsageError(format!("{origin}: nothing is measured: there are 0 workers, or no bodies")).into()
        );
    }
    if role == Role::Correlate && options.worker >= config.workers.count {
        let (worker, count) = (options.worker, config.workers.count);
        let most = count - 1;
        return Err(super::UsageError(format!("--worker {worker}: the rig has {count} workers, 0 to {most}")).into());
    }
    if role == Role::Record && config.record.is_none() {
        let origin = &config.origin;
        return Err(super::UsageError(format!("{origin}: there is no [record] table, so nothing is recorded")).into());
    }
    let resumed = options.resume.is_some();
    let summary = match role {
        Role::Acquire => process::acquire(config, options.resume, stop)?,
        Role::Correlate => process::correlate(config, options.worker, resumed, stop)?,
        Role::Track => process::track(config, options.resume, stop)?,
        Role::Record => process::record(config, resumed, stop)?,
        Role::Supervise => process::supervise(config, stop, |_| ())?,
    };
    Ok(outcome(&summary))
}

/// Runs a whole rig until its stream ends or it is stopped; tells where the recordings lie.
///
/// # Errors
///
/// When a process cannot be started, or cannot go on.
pub fn run(config: &Path, stop: &Stop) -> anyhow::Result<Outcome> {
    let config = load(config, None)?;
    let summary = process::supervise(&config, stop, |_| ())?;
    // Those that had to make room for newer ones are no longer there.
    for path in summary.recordings.iter().filter(|path| path.exists()) {
        super::say(&path.display().to_string());
    }
    Ok(outcome(&summary))
}

fn outcome(summary: &Summary) -> Outcome {
    Outcome::of_rig(summary)
}

fn load(path: &Path, origin: Option<&str>) -> anyhow::Result<Config> {
    if path != Path::new("-") {
        return Ok(Config::load(path)?);
    }
    let mut bytes = Vec::new();
    std::io::stdin().lock().read_until(process::END_OF_CONFIG, &mut bytes)?;
    bytes.pop_if(|last| *last == process::END_OF_CONFIG);
    let text = String::from_utf8(bytes)?;
    Ok(Config::parse(&text, origin.unwrap_or("standard input"))?)
}
