//! The line of `ricochet study`.

use clap::{Args, Subcommand};
use std::path::PathBuf;

use super::field::Region;
use crate::command::Outcome;
use crate::command::study::convergence::{self, ConvergenceOptions, Files};
use crate::process::Stop;

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Study {
    #[command(subcommand)]
    name: Name,
}

/// Which study.
#[derive(Debug, Subcommand)]
enum Name {
    /// How the answers of spline-fft settle with more spline points between the pixels.
    ///
    /// Numbers of points from 0 to 20, with the fit of the correlation peak and without it. Without images, on a
    /// drawn ball moved by known amounts that lie on none of the grids; then errors are told as well.
    #[command(after_help = "Example: ricochet study convergence before.bmp after.bmp --roi 40,40,120,120 -o settle")]
    Convergence(Convergence),
}

/// Arguments of a study.
#[derive(Debug, Args)]
struct Convergence {
    /// The image before; a drawn pattern when absent.
    #[arg(requires = "target")]
    reference: Option<PathBuf>,
    /// The image after.
    target: Option<PathBuf>,
    /// Region of interest of the images: x,y,width,height in px.
    #[arg(long, value_name = "X,Y,W,H", requires = "reference")]
    roi: Option<Region>,
    /// Subset size, odd, px.
    #[arg(long, value_name = "PX", default_value_t = 31)]
    subset: u32,
    /// From one subset to the next, px.
    #[arg(long, value_name = "PX", default_value_t = 20)]
    step: u32,
    /// Largest displacement looked for, px.
    #[arg(long, value_name = "PX", default_value_t = 16)]
    search: u32,
    /// Settled is where 99 % of the answers change by less, px; at most 1.
    #[arg(long, value_name = "PX", default_value_t = 0.001)]
    tolerance_px: f64,
    /// A directory for convergence.csv and convergence.svg; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Study {
    /// Runs the study that was named.
    pub(super) fn run(self, stop: &Stop) -> anyhow::Result<Outcome> {
        match self.name {
            Name::Convergence(line) => convergence::run(&line.options(), stop),
        }
    }
}

impl Convergence {
    fn options(self) -> ConvergenceOptions {
        let roi_px = self.roi.map(|roi| roi.0);
        let files = self.reference.zip(self.target);
        ConvergenceOptions {
            files: files.map(|(reference, target)| Files { reference, target, roi_px }),
            subset_size_px: self.subset,
            step_px: self.step,
            search_px: self.search,
            tolerance_px: self.tolerance_px,
            output: self.output,
            json: self.json,
        }
    }
}
