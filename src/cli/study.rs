//! The arguments of `ricochet study`.

use clap::{Args, Subcommand};
use std::num::NonZeroUsize;
use std::path::PathBuf;

use super::field::Region;
use crate::command::Outcome;
use crate::command::study::convergence::{self, ConvergenceOptions, Files};
use crate::command::study::design::{self, DesignOptions};
use crate::command::study::speckle::{self, SpeckleOptions, SpeckleStudy};
use crate::process::Stop;

/// The arguments of `study`.
#[derive(Debug, Args)]
pub struct Study {
    #[command(subcommand)]
    name: Name,
}

/// The studies.
#[derive(Debug, Subcommand)]
enum Name {
    /// Study how the answers of spline-fft converge with the number of spline points between pixels.
    ///
    /// Tries 0 to 20 points, with and without a fit of the correlation peak. Without images it measures a rendered
    /// ball moved by known amounts off every spline grid, and reports the errors as well.
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
    /// Splined windows against splined peaks, from 0.1 to 2 px per frame, with their cost (Fig. 7).
    #[command(after_help = "Example: ricochet study peak -o studies")]
    Peak(Speckle),
    /// Every method over the camera noise, from 0 to 16 grey levels.
    #[command(after_help = "Example: ricochet study noise --patterns a-III,e-II -o studies")]
    Noise(Speckle),
    /// Every method over the lens blur, from 0.3 to 2 px.
    #[command(after_help = "Example: ricochet study blur -o studies")]
    Blur(Speckle),
    /// Every method over the frame rate: the same motion in up to 32 times smaller steps.
    #[command(after_help = "Example: ricochet study rate --methods ic-gn,rigid -o studies")]
    Rate(Speckle),
    /// Predict the uncertainty of a rig, and what to change first.
    ///
    /// A few frames are rendered as the rig would record them: its ball, scale, rate, exposure, noise and pattern.
    /// The noise bound of their texture is propagated through the rig's own fits of velocity, flight and contact.
    /// Changes are then tried one by one and ranked by the scatter that remains.
    #[command(after_help = "Example: ricochet study design --config rig.toml --scenario lacrosse --noise-dn 2.5")]
    Design(Design),
}

/// The arguments of `study design`.
#[derive(Debug, Args)]
struct Design {
    /// Rig file.
    #[arg(long, value_name = "RIG")]
    config: PathBuf,
    /// Scenario to film: a built-in name or a scenario file [default: the rig's own, else lacrosse].
    #[arg(long, value_name = "NAME|FILE")]
    scenario: Option<String>,
    /// Pixel noise at half of full scale, grey levels, as measured by `ricochet check` [default: the scenario's].
    #[arg(long, value_name = "DN")]
    noise_dn: Option<f64>,
    /// Only print the scatter, without advice.
    #[arg(long)]
    no_advice: bool,
    /// Directory for design.csv and design_advice.csv; created if missing.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Measures films of the paper's speckle patterns.
///
/// Films are rendered at the paper's speeds and at others that lie on no spline grid, and are measured by several
/// methods. With --output, repeating the command resumes a study that was stopped.
#[derive(Debug, Args)]
struct Speckle {
    /// Patterns, a-I to f-II [default: all 16; e-II where the study is not about patterns].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    patterns: Vec<String>,
    /// Methods: paper, paper-fit, peak-plain, peak-spline, ic-gn, ring, rigid [default: those of the study].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    methods: Vec<String>,
    /// Sets of speeds: paper, off-grid [default: both].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    speeds: Vec<String>,
    /// Frames per film, 2 to 12.
    #[arg(long, value_name = "COUNT", default_value_t = 3)]
    frames: u64,
    /// Subset size, odd, px.
    #[arg(long, value_name = "PX", default_value_t = 25)]
    subset: u32,
    /// Grid step between subsets, px.
    #[arg(long, value_name = "PX", default_value_t = 12)]
    step: u32,
    /// Standard deviation of the noise, grey levels of 255 [default: 2].
    #[arg(long, value_name = "DN")]
    noise_dn: Option<f64>,
    /// Seed of the speckles and the noise.
    #[arg(long, value_name = "NUMBER", default_value_t = 1)]
    seed: u64,
    /// Number of threads [default: all cores]; the results do not depend on it.
    #[arg(long, value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    /// Directory for the tables and the figure; created if missing.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The arguments of `study convergence`.
#[derive(Debug, Args)]
struct Convergence {
    /// Reference image [default: a rendered pattern].
    #[arg(requires = "target")]
    reference: Option<PathBuf>,
    /// Target image.
    target: Option<PathBuf>,
    /// Region of interest of the images: x,y,width,height in px.
    #[arg(long, value_name = "X,Y,W,H", requires = "reference")]
    roi: Option<Region>,
    /// Subset size, odd, px.
    #[arg(long, value_name = "PX", default_value_t = 31)]
    subset: u32,
    /// Grid step between subsets, px.
    #[arg(long, value_name = "PX", default_value_t = 20)]
    step: u32,
    /// Search range: maximum displacement, px.
    #[arg(long, value_name = "PX", default_value_t = 16)]
    search: u32,
    /// Converged when 99 % of the answers change by less than this, px; at most 1.
    #[arg(long, value_name = "PX", default_value_t = 0.001)]
    tolerance_px: f64,
    /// Directory for convergence.csv and convergence.svg; created if missing.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Study {
    /// Runs the chosen study.
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
