//! The line of `ricochet study`.

use clap::{Args, Subcommand};
use std::num::NonZeroUsize;
use std::path::PathBuf;

use super::field::Region;
use crate::command::Outcome;
use crate::command::study::convergence::{self, ConvergenceOptions, Files};
use crate::command::study::design::{self, DesignOptions};
use crate::command::study::speckle::{self, SpeckleOptions, SpeckleStudy};
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
    /// Speckle patterns in translation along one axis (Fig. 3 of the paper).
    #[command(after_help = "Example: ricochet study translation --patterns e-I,e-II -o studies")]
    Translation(Speckle),
    /// Speckle patterns in translation along both axes (Fig. 4).
    #[command(after_help = "Example: ricochet study translation2 --methods paper,rigid -o studies")]
    Translation2(Speckle),
    /// Speckle patterns in pure rotation (Fig. 5).
    #[command(after_help = "Example: ricochet study rotation -o studies")]
    Rotation(Speckle),
    /// Speckle patterns in translation and rotation together (Fig. 6).
    #[command(after_help = "Example: ricochet study general --speeds off-grid -o studies")]
    General(Speckle),
    /// Splined windows against splined peaks, from 0.1 to 2 px a frame, and what each costs (Fig. 7).
    #[command(after_help = "Example: ricochet study peak -o studies")]
    Peak(Speckle),
    /// Every method over the noise of the camera, from none to 16 grey levels.
    #[command(after_help = "Example: ricochet study noise --patterns a-III,e-II -o studies")]
    Noise(Speckle),
    /// Every method over the blur of the lens, from 0.3 to 2 px.
    #[command(after_help = "Example: ricochet study blur -o studies")]
    Blur(Speckle),
    /// Every method over the frame rate: the same motion in up to 32 times smaller steps.
    #[command(after_help = "Example: ricochet study rate --methods ic-gn,rigid -o studies")]
    Rate(Speckle),
    /// What a rig is going to be off by, and what to change first.
    ///
    /// A few pictures are drawn as the rig would take them: its ball, scale, rate, exposure, noise and pattern. The
    /// noise bound of their texture goes through the rig's own fits of velocities, flights and contact. Changes are
    /// then tried one by one, and told by what they leave of the scatter.
    #[command(after_help = "Example: ricochet study design --config rig.toml --scenario lacrosse --noise-dn 2.5")]
    Design(Design),
}

/// Arguments of a design.
#[derive(Debug, Args)]
struct Design {
    /// The rig file.
    #[arg(long, value_name = "RIG")]
    config: PathBuf,
    /// What is going to be filmed: a built-in scenario or a scenario file; the rig's own, or lacrosse, when left out.
    #[arg(long, value_name = "NAME|FILE")]
    scenario: Option<String>,
    /// Noise of a pixel at half of full scale, grey levels; the scenario's when left out (`ricochet check` measures it).
    #[arg(long, value_name = "DN")]
    noise_dn: Option<f64>,
    /// Tell the scatter only.
    #[arg(long)]
    no_advice: bool,
    /// A directory for design.csv and design_advice.csv; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Arguments of a speckle study.
///
/// Films of the paper's patterns are drawn at its speeds, and at others that lie on no grid of spline points, and
/// measured by several methods. With a directory, a study that was stopped is gone on with by the same command.
#[derive(Debug, Args)]
struct Speckle {
    /// Patterns, a-I to f-II; all 16 when left out (e-II where a study is not about patterns).
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    patterns: Vec<String>,
    /// Methods: paper, paper-fit, peak-plain, peak-spline, ic-gn, rigid; the study's own when left out.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    methods: Vec<String>,
    /// Sets of speeds: paper, off-grid; both when left out.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    speeds: Vec<String>,
    /// Frames a film, 2 to 12.
    #[arg(long, value_name = "COUNT", default_value_t = 3)]
    frames: u64,
    /// Size of the windows, odd, px.
    #[arg(long, value_name = "PX", default_value_t = 25)]
    subset: u32,
    /// From one window to the next, px.
    #[arg(long, value_name = "PX", default_value_t = 12)]
    step: u32,
    /// Standard deviation of the noise, grey levels of 255; 2 when left out.
    #[arg(long, value_name = "DN")]
    noise_dn: Option<f64>,
    /// Seed of speckles and noise.
    #[arg(long, value_name = "NUMBER", default_value_t = 1)]
    seed: u64,
    /// Threads; all cores when left out. The results do not depend on it.
    #[arg(long, value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    /// A directory for the tables and the figure; made when it is not there.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
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
            Name::Translation(line) => line.run(SpeckleStudy::Translation, stop),
            Name::Translation2(line) => line.run(SpeckleStudy::Translation2, stop),
            Name::Rotation(line) => line.run(SpeckleStudy::Rotation, stop),
            Name::General(line) => line.run(SpeckleStudy::General, stop),
            Name::Peak(line) => line.run(SpeckleStudy::Peak, stop),
            Name::Noise(line) => line.run(SpeckleStudy::Noise, stop),
            Name::Blur(line) => line.run(SpeckleStudy::Blur, stop),
            Name::Rate(line) => line.run(SpeckleStudy::Rate, stop),
            Name::Design(line) => design::run(&line.options(), stop),
        }
    }
}

impl Design {
    fn options(self) -> DesignOptions {
        DesignOptions {
            config: self.config,
            scenario: self.scenario,
            noise_dn: self.noise_dn,
            without_advice: self.no_advice,
            output: self.output,
            json: self.json,
        }
    }
}

impl Speckle {
    fn run(self, study: SpeckleStudy, stop: &Stop) -> anyhow::Result<Outcome> {
        let options = SpeckleOptions {
            study,
            patterns: self.patterns,
            methods: self.methods,
            speeds: self.speeds,
            frames: self.frames,
            subset_size_px: self.subset,
            step_px: self.step,
            noise_dn: self.noise_dn,
            seed: self.seed,
            threads: self.threads,
            output: self.output,
            json: self.json,
        };
        speckle::run(&options, stop)
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
