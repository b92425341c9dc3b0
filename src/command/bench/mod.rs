//! `ricochet bench`: the measuring and recording speed of this machine.

mod arithmetic;
mod live;
mod pipeline;
mod record;
mod windows;

use crate::console::{Outcome, UsageError};
use crate::failure::Failure;
use crate::numeric::median;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use crate::process::Stop;
use pipeline::{BenchBody, BenchRate, ImageSize};

/// The options of `ricochet bench`.
#[derive(Debug, Clone, clap::Args)]
pub struct BenchOptions {
    /// Part to measure.
    #[arg(default_value = "windows")]
    pub part: Part,
    /// windows: maximum number of threads [default: the number of cores].
    #[arg(long)]
    pub threads: Option<usize>,
    /// Measuring time per row, s; with --rate the filming time [default: 0.5; 5; 2 for each rate of --rate max].
    #[arg(long)]
    pub seconds: Option<f64>,
    /// live: run all processes of a rig at this frame rate, Hz, or search for the highest: `max`.
    #[arg(long, value_name = "HZ|max")]
    pub rate: Option<BenchRate>,
    /// live --rate: body that is filmed [default: ball].
    #[arg(long, requires = "rate")]
    pub body: Option<BenchBody>,
    /// live --rate: number of subsets, or several separated by commas [default: 64; 16,64,256 for --rate max].
    #[arg(long, value_delimiter = ',', requires = "rate")]
    pub subsets: Vec<usize>,
    /// live --rate: image size, px: SIDE or WIDTHxHEIGHT [default: 512].
    #[arg(long, requires = "rate")]
    pub size: Option<ImageSize>,
    /// live --rate: number of correlation workers [default: that of a rig file without one].
    #[arg(long, requires = "rate", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub workers: Option<u32>,
    /// live --rate: frames that a worker measures together [default: that of a rig file without it].
    #[arg(long, requires = "rate", value_parser = clap::value_parser!(u32).range(4..=256))]
    pub block_frames: Option<u32>,
    /// live --rate: set up for the shortest delay, as `workers.mode = "latency"` in a rig file.
    #[arg(long, requires = "rate")]
    pub latency: bool,
    /// live --rate: frames that a velocity waits for, as `velocity.lag_frames` [default: that of a rig file without it].
    #[arg(long, requires = "rate", value_parser = clap::value_parser!(u32).range(0..=2))]
    pub lag_frames: Option<u32>,
    /// live --rate: frames in the ring [default: 20000, or 2000 for --rate max, in at most a quarter of the memory].
    #[arg(long, requires = "rate")]
    pub ring: Option<u64>,
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
    /// Time per frame on one core; with --rate, all processes of a rig.
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
pub fn run(options: &BenchOptions, stop: &Stop) -> Result<Outcome, Failure> {
    match (options.part, options.rate) {
        (Part::Live, Some(rate)) => return pipeline::run(options, rate, stop),
        (_, Some(_)) => return Err(UsageError("--rate: for `bench live` only".into()).into()),
        (part, None) => run_part(part, options)?,
    }
    Ok(Outcome::Clean)
}

/// Measures a part of the work alone.
fn run_part(part: Part, options: &BenchOptions) -> Result<(), Failure> {
    match part {
        Part::Live => live::run(options),
        Part::Windows => windows::run(options),
        Part::Record => record::run(options),
    }
}

impl BenchOptions {
    /// Returns the measuring time per row.
    fn duration(&self) -> Duration {
        Duration::from_secs_f64(self.seconds.unwrap_or(0.5).clamp(0.01, 60.0))
    }
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
