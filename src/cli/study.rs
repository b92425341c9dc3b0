//! The subcommands of `ricochet study`.

use clap::Subcommand;

use crate::console::Outcome;
use crate::failure::Failure;
use crate::study::speckle::SpeckleStudy;
use crate::study::{ConvergenceOptions, convergence};
use crate::study::{DesignOptions, design};
use crate::study::{SpeckleOptions, speckle};

/// The studies.
#[derive(Debug, Subcommand)]
pub enum Study {
    /// Study how the answers of spline-fft converge with the number of spline points between pixels.
    ///
    /// Tries 0 to 20 points, with and without a fit of the correlation peak. Without images it measures a rendered
    /// ball moved by known amounts off every spline grid, and reports the errors as well.
    #[command(after_help = "Example: ricochet study convergence before.bmp after.bmp --roi 40,40,120,120 -o settle")]
    Convergence(ConvergenceOptions),
    /// Speckle patterns in translation along one axis (Fig. 3 of the paper).
    #[command(after_help = "Example: ricochet study translation --patterns e-I,e-II -o studies")]
    Translation(SpeckleOptions),
    /// Speckle patterns in translation along both axes (Fig. 4).
    #[command(after_help = "Example: ricochet study translation2 --methods paper,rigid -o studies")]
    Translation2(SpeckleOptions),
    /// Speckle patterns in pure rotation (Fig. 5).
    #[command(after_help = "Example: ricochet study rotation -o studies")]
    Rotation(SpeckleOptions),
    /// Speckle patterns in translation and rotation together (Fig. 6).
    #[command(after_help = "Example: ricochet study general --speeds off-grid -o studies")]
    General(SpeckleOptions),
    /// Splined windows against splined peaks, from 0.1 to 2 px per frame, with their cost (Fig. 7).
    #[command(after_help = "Example: ricochet study peak -o studies")]
    Peak(SpeckleOptions),
    /// Every method over the camera noise, from 0 to 16 grey levels.
    #[command(after_help = "Example: ricochet study noise --patterns a-III,e-II -o studies")]
    Noise(SpeckleOptions),
    /// Every method over the lens blur, from 0.3 to 2 px.
    #[command(after_help = "Example: ricochet study blur -o studies")]
    Blur(SpeckleOptions),
    /// Every method over the frame rate: the same motion in up to 32 times smaller steps.
    #[command(after_help = "Example: ricochet study rate --methods ic-gn,rigid -o studies")]
    Rate(SpeckleOptions),
    /// Predict the uncertainty of a rig, and what to change first.
    ///
    /// A few frames are rendered as the rig would record them: its ball, scale, rate, exposure, noise and pattern. The
    /// noise bound of their texture is propagated through the rig's own fits of velocity, flight and contact. Changes
    /// are then tried one by one and ranked by the scatter that remains.
    #[command(after_help = "Example: ricochet study design --config rig.toml --scenario lacrosse --noise-dn 2.5")]
    Design(DesignOptions),
}

impl Study {
    /// Runs the study.
    ///
    /// # Errors
    ///
    /// Any error of the study.
    pub(super) fn run(&self) -> Result<Outcome, Failure> {
        let (study, options) = match self {
            Self::Convergence(options) => return convergence::run(options),
            Self::Design(options) => return design::run(options),
            Self::Translation(options) => (SpeckleStudy::Translation, options),
            Self::Translation2(options) => (SpeckleStudy::Translation2, options),
            Self::Rotation(options) => (SpeckleStudy::Rotation, options),
            Self::General(options) => (SpeckleStudy::General, options),
            Self::Peak(options) => (SpeckleStudy::Peak, options),
            Self::Noise(options) => (SpeckleStudy::Noise, options),
            Self::Blur(options) => (SpeckleStudy::Blur, options),
            Self::Rate(options) => (SpeckleStudy::Rate, options),
        };
        speckle::run(study, options)
    }
}
