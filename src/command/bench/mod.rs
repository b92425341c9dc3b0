//! `ricochet bench`: the measuring and recording speed of this machine.

mod live;
mod record;
mod windows;

use crate::console::Outcome;
use crate::failure::Failure;
use crate::numeric::median;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The options of `ricochet bench`.
#[derive(Debug, Clone, clap::Args)]
pub struct BenchOptions {
    /// Part to measure.
    #[arg(default_value = "windows")]
    pub part: Part,
    /// windows: maximum number of threads [default: the number of cores].
    #[arg(long)]
    pub threads: Option<usize>,
    /// Measuring time per row, s.
    #[arg(long, default_value_t = 0.5)]
    pub seconds: f64,
    /// record: directory to write into; the files are removed afterwards.
    #[arg(long, default_value = ".")]
    pub directory: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// A part of the work that can be measured by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// Time per frame on one core.
    Live,
    /// Subsets per second for each method and number of threads.
    Windows,
    /// Recording rate, compared with a plain write of the same bytes.
    Record,
}

/// Measures a part and prints the result.
///
/// # Errors
///
/// When the part cannot be measured or the result cannot be printed.
pub fn run(options: &BenchOptions) -> Result<Outcome, Failure> {
    match options.part {
        Part::Live => live::run(options)?,
        Part::Windows => windows::run(options)?,
        Part::Record => record::run(options)?,
    }
    Ok(Outcome::Clean)
}

/// Returns the median; NaN of nothing.
fn median_of(figures: impl Iterator<Item = f64>) -> f64 {
    median(&mut figures.collect::<Vec<_>>()).unwrap_or(f64::NAN)
}

/// Returns the sum of the results of `round` per second, called again and again over a duration.
#[expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
fn rate_per_s(duration: Duration, mut round: impl FnMut() -> usize) -> f64 {
    let (start, mut points) = (Instant::now(), 0);
    while start.elapsed() < duration {
        points += round();
    }
    points as f64 / start.elapsed().as_secs_f64()
}

/// Calls a function once and returns its result and its duration, s.
#[expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
fn time_call<T>(call: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = call();
    (result, start.elapsed().as_secs_f64())
}
