//! The command line of `ricochet replay`.

use crate::command::replay::{Rate, ReplayOptions, Tempo, Times};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `ricochet replay`.
#[derive(Debug, Args)]
pub struct Replay {
    /// The recordings; parts of one stream are played as one, each further camera on a rig of its own, merged by time.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// `max`, or how many times real time.
    #[arg(long, default_value = "1")]
    rate: Rate,
    /// Play a frame for each line on standard input (Enter); a number plays so many, `q` or its end ends.
    #[arg(long, conflicts_with = "rate")]
    step: bool,
    /// Let the frames' times begin now, or at this time (ns since the Unix epoch), in place of their own.
    #[arg(long, value_name = "NS", num_args = 0..=1, require_equals = true)]
    shift_times: Option<Option<u64>>,
    /// Play it this many times; without a number until stopped.
    #[arg(long = "loop", value_name = "N", require_equals = true, value_parser = clap::value_parser!(u32).range(1..))]
    looped: Option<Option<u32>>,
    /// Begin here, seconds from the first frame.
    #[arg(long, value_name = "S")]
    from: Option<f64>,
    /// End before this, seconds from the first frame.
    #[arg(long, value_name = "S")]
    to: Option<f64>,
    /// The rig file; the attached one when absent.
    #[arg(long)]
    config: Option<PathBuf>,
    /// Directory to record the results into.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Name of the rig; `replay-` and the recording's own when absent.
    #[arg(long)]
    rig: Option<String>,
    /// Number of correlation workers.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    workers: Option<u32>,
}

impl From<Replay> for ReplayOptions {
    fn from(line: Replay) -> Self {
        let Replay { files, rate, step, shift_times, looped, from: from_s, to: to_s, config, output, rig, workers } =
            line;
        let passes = looped.unwrap_or(Some(1));
        let tempo = if step { Tempo::Step } else { rate.into() };
        let times = match shift_times {
            None => Times::Recorded,
            Some(None) => Times::Present,
            Some(Some(ns)) => Times::From(ns),
        };
        Self { files, config, tempo, times, passes, from_s, to_s, output, rig, workers }
    }
}
