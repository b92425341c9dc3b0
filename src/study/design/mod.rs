//! `ricochet study design`: the predicted uncertainty of a rig, and what to change first.

mod advice;
mod films;
mod monte_carlo;
mod output;
mod pose_noise;
mod reference_renewal;
mod rig;
mod scatter;
mod subset_noise;

use crate::failure::Failure;
use std::path::PathBuf;

use self::rig::Rig;
use self::scatter::Prediction;
use crate::config::Config;
use crate::console::{Outcome, Overwrite, UsageError, progress};
use crate::study::output_files;

pub use self::scatter::{Expected, spread};

/// Number of films for a scatter.
const FILMS: u64 = 200;

/// Number of films for a change; fewer suffice, since the noise is the same with and without it.
const FILMS_PER_CHANGE: u64 = 48;

/// The options of `ricochet study design`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct DesignOptions {
    /// Rig file.
    #[arg(long, value_name = "RIG")]
    pub config: PathBuf,
    /// Scenario to film: a built-in name or a scenario file [default: the rig's own, else lacrosse].
    #[arg(long, value_name = "NAME|FILE")]
    pub scenario: Option<String>,
    /// Pixel noise at half of full scale, grey levels, as measured by `ricochet check` [default: the scenario's].
    #[arg(long, value_name = "DN")]
    pub noise_dn: Option<f64>,
    /// Only print the scatter, without advice.
    #[arg(long)]
    pub no_advice: bool,
    /// Directory for design.csv and design_advice.csv; created if missing.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Predicts the uncertainty of a rig with its own scenario.
///
/// # Errors
///
/// When the rig cannot film or track its scenario.
pub fn predict(config: &Config) -> Result<Vec<Expected>, Failure> {
    let rig = Rig::new(config.clone(), None, None)?;
    Ok(Prediction::compute(&rig, FILMS)?.rows)
}

/// Predicts the uncertainty of a rig, tries changes and prints the results.
///
/// # Errors
///
/// When the rig file is invalid, or the rig cannot film or track its scenario.
pub fn run(options: &DesignOptions) -> Result<Outcome, Failure> {
    if let Some(noise_dn) = options.noise_dn.filter(|noise_dn| !(0.0..=16384.0).contains(noise_dn)) {
        return Err(UsageError(format!("--noise-dn {noise_dn}: must be 0 to a quarter of full scale")).into());
    }
    let config = Config::load(&options.config)?;
    if let Some(directory) = &options.output {
        output_files::prepare(
            directory,
            &[output::TABLE, output::ADVICE_TABLE],
            &[&options.config],
            options.overwrite,
        )?;
    }
    let rig = Rig::new(config, options.scenario.as_deref(), options.noise_dn)?;
    let bar = progress::bar(if options.no_advice { 1 } else { 1 + advice::change_count(&rig) }, "design");
    let prediction = Prediction::compute(&rig, FILMS)?;
    bar.inc(1);
    let advice = match options.no_advice {
        true => Vec::new(),
        false => advice::try_changes(&rig, FILMS_PER_CHANGE, || bar.inc(1))?,
    };
    bar.finish_and_clear();
    let study = output::Study { options, rig: &rig, prediction: &prediction, advice: &advice };
    study.report()?.publish(options.output.as_deref(), options.overwrite)?;
    Ok(Outcome::Clean)
}
