//! `ricochet bench live --rate`: the processes of a whole rig at the rate of a camera.

mod memory;
mod output;
mod rig;
mod scene;
mod search;
mod trial;
mod usage;

use super::BenchOptions;
use crate::config::WorkerMode;
use crate::console::{Outcome, UsageError, print_line, print_note};
use crate::failure::Failure;
use crate::interrupt::Interrupted;
use crate::process::Stop;
use rig::Folder;
use scene::{Scene, SubsetGrid};
use trial::Trial;

pub use scene::BenchBody;

/// Image size by default, px.
const SIDE_PX: [u32; 2] = [512, 512];
/// Numbers of subsets by default, at a given rate and in a search.
const SUBSETS: [usize; 1] = [64];
const SUBSETS_SEARCHED: [usize; 3] = [16, 64, 256];
/// Filming time by default, at a given rate and for each rate of a search, s.
const SECONDS: f64 = 5.0;
const SECONDS_SEARCHED: f64 = 2.0;
/// Frames of the ring if memory allows, at a given rate and in a search. A long ring hides for longer that a rig falls
/// behind, and takes longer to set up.
const RING_FRAMES: u64 = 20_000;
const RING_FRAMES_SEARCHED: u64 = 2000;

/// The frame rate of a benchmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BenchRate {
    /// The highest that the machine keeps up with.
    Max,
    /// This one, Hz.
    Hz(f64),
}

impl std::str::FromStr for BenchRate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<f64>() {
            _ if text == "max" => Ok(Self::Max),
            Ok(rate_hz) if (10.0..=500_000.0).contains(&rate_hz) => Ok(Self::Hz(rate_hz)),
            _ => Err(format!("{text:?} is neither `max` nor a number from 10 to 500000")),
        }
    }
}

/// An image size, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageSize([u32; 2]);

impl std::str::FromStr for ImageSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (width, height) = text.split_once('x').unwrap_or((text, text));
        let side = |text: &str| text.parse::<u32>().ok().filter(|side| (64..=4096).contains(side));
        match (side(width), side(height)) {
            (Some(width), Some(height)) => Ok(Self([width, height])),
            _ => Err(format!("{text:?} is neither SIDE nor WIDTHxHEIGHT, each from 64 to 4096 px")),
        }
    }
}

/// One run of the rig.
#[derive(Debug, Clone)]
struct Plan {
    rate_hz: f64,
    seconds: f64,
    side_px: [u32; 2],
    scene: Scene,
    /// The number of subsets on the body, and their distance, px.
    subsets: usize,
    step_px: u32,
    workers: Option<u32>,
    block_frames: Option<u32>,
    /// The frames that a velocity waits for; `None`: the default of the rig file.
    lag_frames: Option<u32>,
    mode: WorkerMode,
    ring_frames: u64,
}

/// Runs the rig at the rate of the options, or searches for the highest one, and prints the figures.
///
/// # Errors
///
/// When the rig cannot run.
pub(super) fn run(options: &BenchOptions, rate: BenchRate, stop: &Stop) -> Result<Outcome, Failure> {
    let folder = Folder::create()?;
    let trials = match rate {
        BenchRate::Hz(rate_hz) => {
            let plans = plans(options, rate_hz, &SUBSETS, (SECONDS, RING_FRAMES))?;
            plans.iter().map_while(|plan| trial::run(plan, &folder, stop).transpose()).collect::<Result<Vec<_>, _>>()?
        }
        BenchRate::Max => {
            let plans = plans(options, f64::NAN, &SUBSETS_SEARCHED, (SECONDS_SEARCHED, RING_FRAMES_SEARCHED))?;
            let found = plans.iter().map(|plan| search::highest_rate(plan, &folder, stop, print_try));
            found.filter_map(Result::transpose).collect::<Result<Vec<_>, _>>()?
        }
    };
    if stop.requested() {
        return Err(Interrupted.into());
    }
    if options.json {
        print_line(&serde_json::to_string_pretty(&output::as_json(&trials))?);
    } else if rate == BenchRate::Max {
        output::print_rates(&trials);
    } else {
        trials.iter().for_each(output::print_trial);
    }
    let mut outcomes = trials.iter().map(|trial| Outcome::from_rig(&trial.summary));
    Ok(outcomes.find(|outcome| *outcome != Outcome::Clean).unwrap_or(Outcome::Clean))
}

/// Returns a run for each number of subsets. `defaults` are the filming time, s, and the frames of the ring.
///
/// # Errors
///
/// [`UsageError`] for an option out of its range.
fn plans(
    options: &BenchOptions,
    rate_hz: f64,
    subsets: &[usize],
    defaults: (f64, u64),
) -> Result<Vec<Plan>, UsageError> {
    let seconds = options.seconds.unwrap_or(defaults.0);
    if !(0.1..=3600.0).contains(&seconds) {
        return Err(UsageError(format!("--seconds {seconds}: must be from 0.1 to 3600")));
    }
    let side_px = options.size.map_or(SIDE_PX, |size| size.0);
    let scene = Scene::new(options.body.unwrap_or_default(), side_px)?;
    let wanted = if options.subsets.is_empty() { subsets } else { &options.subsets };
    let plan = |wanted: &usize| {
        let SubsetGrid { step_px, subsets } = scene.closest_grid(*wanted);
        let ring_frames = options.ring.unwrap_or_else(|| rig::default_ring_frames(scene.frame_bytes(), defaults.1));
        let BenchOptions { workers, block_frames, lag_frames, .. } = *options;
        let mode = if options.latency { WorkerMode::Latency } else { WorkerMode::Throughput };
        Plan {
            rate_hz,
            seconds,
            side_px,
            scene,
            subsets,
            step_px,
            workers,
            block_frames,
            lag_frames,
            mode,
            ring_frames,
        }
    };
    Ok(wanted.iter().map(plan).collect())
}

/// Prints the outcome of one rate of a search to standard error.
fn print_try(trial: &Trial) {
    let verdict = if trial.shortfalls().is_empty() { "kept up with".into() } else { trial.shortfalls().join("; ") };
    print_note(&format!("{} subsets, {:.0} frames/s: {verdict}", trial.plan.subsets, trial.plan.rate_hz));
}
