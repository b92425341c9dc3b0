//! `ricochet study design`: what a rig is going to be off by, before it is built, and what to change first.

mod advice;
mod course;
mod noise;
mod renewal;
mod rig;
mod spread;
mod subsets;
mod tell;

use std::path::PathBuf;

use self::rig::Rig;
use self::spread::Foreseen;
use crate::command::field::folder;
use crate::command::{Outcome, UsageError, progress};
use crate::config::Config;
use crate::process::Stop;

pub use self::spread::{Expected, spread};

/// Films that a scatter is taken from.
const FILMS: u64 = 200;

/// Films that a change is tried with: the same noise with it and without, so fewer do.
const FILMS_OF_A_CHANGE: u64 = 48;

/// What `ricochet study design` was asked to do.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignOptions {
    /// The rig file.
    pub config: PathBuf,
    /// What is going to be filmed: a built-in scenario or the path of one; the rig's own when it simulates, else
    /// `lacrosse`.
    pub scenario: Option<String>,
    /// Noise of a pixel at half of full scale, grey levels; the scenario's when left out.
    pub noise_dn: Option<f64>,
    /// Whether changes are left out.
    pub without_advice: bool,
    /// A directory for the tables, made when it is not there.
    pub output: Option<PathBuf>,
    /// Print one JSON object.
    pub json: bool,
}

/// What is foreseen of a rig, for callers that judge it.
///
/// # Errors
///
/// One line when the rig cannot film or follow what it is meant to.
pub fn foresee(config: &Config, stop: &Stop) -> anyhow::Result<Vec<Expected>> {
    let rig = Rig::new(config.clone(), None, None)?;
    Ok(Foreseen::of(&rig, FILMS, stop)?.map_or_else(Vec::new, |foreseen| foreseen.rows))
}

/// Foresees a rig and prints what it found.
///
/// # Errors
///
/// One line when the rig file is wrong, or the rig cannot film or follow what it is meant to.
pub fn run(options: &DesignOptions, stop: &Stop) -> anyhow::Result<Outcome> {
    if let Some(noise_dn) = options.noise_dn.filter(|noise_dn| !(0.0..=16384.0).contains(noise_dn)) {
        return Err(UsageError(format!("--noise-dn {noise_dn}: 0 to a quarter of full scale")).into());
    }
    let config = Config::load(&options.config)?;
    if let Some(directory) = &options.output {
        folder::make("--output", directory)?;
    }
    let rig = Rig::new(config, options.scenario.as_deref(), options.noise_dn)?;
    let stopped = || Outcome::Lost { count: 1, cause: Some("stopped before everything was foreseen".into()) };
    let bar = progress::parts(if options.without_advice { 1 } else { 1 + advice::count(&rig) }, "design");
    let Some(foreseen) = Foreseen::of(&rig, FILMS, stop)? else { return Ok(stopped()) };
    bar.inc(1);
    let advice = match options.without_advice {
        true => Some(Vec::new()),
        false => advice::advice(&rig, FILMS_OF_A_CHANGE, stop, || bar.inc(1))?,
    };
    bar.finish_and_clear();
    let Some(advice) = advice else { return Ok(stopped()) };
    let told = tell::Told { rig: &rig, foreseen: &foreseen, advice: &advice };
    if let Some(directory) = &options.output {
        told.write(directory)?;
    }
    if options.json {
        told.json()
    } else {
        told.table()
    }
    Ok(Outcome::Clean)
}
