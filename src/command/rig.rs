//! `ricochet run` and the commands that run one process of a rig.

use crate::bus::{self, Domain};
use crate::config::Config;
use crate::console::Outcome;
use crate::failure::Failure;
use crate::message::Role;
use crate::process::{self, Extras, Launch, Page, Stop, Summary};
use std::path::{Path, PathBuf};

/// The options of one process of a rig.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct RoleOptions {
    /// Rig file; `-` reads it from standard input.
    pub config: PathBuf,
    /// Camera to work for, by the name of its view [default: the first].
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Index of the correlation worker, from 0.
    #[arg(long, default_value_t = 0)]
    pub worker: u32,
    /// The options of a process with a supervisor.
    #[command(flatten)]
    pub supervised: SupervisedOptions,
}

/// The options that a supervisor gives to the processes that it starts.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct SupervisedOptions {
    /// The name that error messages use for a file read from standard input.
    #[arg(long, hide = true)]
    pub origin: Option<String>,
    /// The folder of the supervisor's domain. The process ends with its supervisor, which controls it by its standard
    /// input.
    #[arg(long, hide = true)]
    pub domain: Option<PathBuf>,
    /// Whether the process replaces one that died.
    #[arg(long, hide = true)]
    pub restarted: bool,
}

impl SupervisedOptions {
    /// Returns the circumstances of the start of this process. From now on it ends with its supervisor, if it has one.
    pub(super) fn launch(&self, stop: &Stop) -> Launch {
        Launch {
            domain: self.domain.as_deref().map(Domain::in_folder),
            is_restart: self.restarted,
            steps: self.domain.as_ref().map(|_| process::follow_supervisor(stop)),
        }
    }
}

/// Runs one process of a rig until its stream ends or a stop is requested.
///
/// # Errors
///
/// Any error of the process.
pub fn role(role: Role, options: &RoleOptions, stop: &Stop) -> Result<Outcome, Failure> {
    let config = load(&options.config, options.supervised.origin.as_deref())?;
    let launch = options.supervised.launch(stop);
    let config = match &options.camera {
        Some(_) if role == Role::Record => {
            return Err(crate::console::UsageError(
                "--camera: not available for record, one recorder serves all cameras".into(),
            )
            .into());
        }
        camera => super::view_config(config, camera.as_deref())?,
    };
    let config = &config;
    let is_measuring = matches!(role, Role::Correlate | Role::Track);
    if is_measuring && config.workers.count == 0 {
        let origin = &config.origin;
        return Err(crate::console::UsageError(format!(
            "{origin}: nothing to measure: 0 workers or no bodies configured"
        ))
        .into());
    }
    if role == Role::Correlate && options.worker >= config.workers.count {
        let (worker, count) = (options.worker, config.workers.count);
        let last = count - 1;
        return Err(crate::console::UsageError(format!(
            "--worker {worker}: the rig has {count} workers, allowed are 0 to {last}"
        ))
        .into());
    }
    if role == Role::Record && config.record.is_none() {
        let origin = &config.origin;
        return Err(crate::console::UsageError(format!("{origin}: nothing to record: add a [record] table")).into());
    }
    bus::lock_if_unlimited();
    let summary = match role {
        Role::Acquire => process::acquire(config, launch, stop)?,
        Role::Correlate => process::correlate(config, options.worker, &launch, stop)?,
        Role::Track => process::track(config, &launch, stop)?,
        Role::Record => process::record(config, &launch, stop)?,
        Role::Supervise | Role::Serve => return Err(Failure::internal("no process of frames")),
    };
    Ok(outcome(&summary))
}

/// Runs a whole rig until its stream ends or a stop is requested, and prints why it stopped and the paths of the
/// recordings.
///
/// # Errors
///
/// When a process cannot be started or cannot continue.
pub fn run(config: &Path, stop: &Stop) -> Result<Outcome, Failure> {
    let config = load(config, None)?;
    let extras = Extras { page: Page::Served, print: Some(crate::console::print_note), ..Extras::default() };
    let summary = process::supervise(&config, stop, extras, |_| ())?;
    let reason = if stop.requested() { "on request" } else { "since the camera delivers no more frames" };
    crate::console::print_note(&format!("stopped: rig {}, {reason}", config.rig.name));
    // Older recordings may have been deleted to make room.
    for path in summary.recordings.iter().filter(|path| path.exists()) {
        crate::console::print_line(&path.display().to_string());
    }
    Ok(outcome(&summary))
}

/// Returns the outcome of a rig with the causes of its losses.
fn outcome(summary: &Summary) -> Outcome {
    Outcome::from_rig(summary)
}

/// Loads the rig file of a rig that runs, and checks that its cameras have sources.
///
/// The file `-` is standard input, which errors call `origin`. The supervisor that writes it has checked its sources.
pub(super) fn load(path: &Path, origin: Option<&str>) -> Result<Config, Failure> {
    if path != Path::new("-") {
        let config = Config::load(path)?;
        config.check_sources()?;
        return Ok(config);
    }
    let text = process::read_config()?;
    Ok(Config::parse(&text, origin.unwrap_or("standard input"))?)
}
