//! Forces between the ball and the flat.

use crate::results::ForceLaw;
use serde::{Deserialize, Serialize};

/// Normal force as a function of compression and its rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum NormalLaw {
    /// Spring and dashpot side by side, F = k y + c v.
    KelvinVoigt {
        /// Stiffness k, N/m.
        stiffness_n_m: f64,
        /// Damping c, N s/m.
        damping_n_s_m: f64,
    },
    /// F = k y^1.5 (1 + c v).
    ///
    /// K. H. Hunt and F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440,
    /// <https://doi.org/10.1115/1.3423596>.
    HuntCrossley {
        /// Stiffness k, N/m^1.5.
        stiffness_n_m15: f64,
        /// Damping c, s/m.
        damping_s_m: f64,
    },
}

impl NormalLaw {
    /// Force at a compression (m) that grows at a rate (m/s), N; negative where the flat would have to pull.
    pub fn force_n(self, compression_m: f64, rate_m_s: f64) -> f64 {
        match self {
            Self::KelvinVoigt { stiffness_n_m, damping_n_s_m } => {
                stiffness_n_m * compression_m + damping_n_s_m * rate_m_s
            }
            Self::HuntCrossley { stiffness_n_m15, damping_s_m } => {
                let compression = compression_m.max(0.0);
                stiffness_n_m15 * compression * compression.sqrt() * (1.0 + damping_s_m * rate_m_s)
            }
        }
    }

    /// Elastic energy at a compression (m), J.
    pub fn stored_j(self, compression_m: f64) -> f64 {
        match self {
            Self::KelvinVoigt { stiffness_n_m, .. } => 0.5 * stiffness_n_m * compression_m * compression_m,
            Self::HuntCrossley { stiffness_n_m15, .. } => 0.4 * stiffness_n_m15 * compression_m.max(0.0).powf(2.5),
        }
    }

    /// The name used in results.
    pub fn force_law(self) -> ForceLaw {
        match self {
            Self::KelvinVoigt { .. } => ForceLaw::KelvinVoigt,
            Self::HuntCrossley { .. } => ForceLaw::HuntCrossley,
        }
    }
}

/// Tangential force: a spring and a damper in the contact patch, in series with a sliding surface.
///
/// The surface holds until friction can no longer hold it, then slides while the
/// patch goes on relaxing. Springs, dampers and friction only take energy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// Spring of the patch, N/m.
    pub stiffness_n_m: f64,
    /// Damper of the patch, N s/m.
    pub damping_n_s_m: f64,
    /// Coefficient of friction, dimensionless.
    pub coefficient: f64,
}

/// Whether the surfaces hold together or slide.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hold {
    /// The patch deforms as the ball's lowest point moves.
    Grip,
    /// The surface slides along the positive tangent.
    SlipForward,
    /// The surface slides along the negative tangent.
    SlipBackward,
}

impl Friction {
    /// Force of a gripping patch, stretched by `stretch_m`, on the flat, N.
    fn grip_n(&self, stretch_m: f64, slide_m_s: f64) -> f64 {
        self.stiffness_n_m * stretch_m + self.damping_n_s_m * slide_m_s
    }

    /// Whether friction can hold what the patch pulls with.
    pub(super) fn hold(&self, stretch_m: f64, slide_m_s: f64, normal_n: f64) -> Hold {
        let pull_n = self.grip_n(stretch_m, slide_m_s);
        match pull_n {
            _ if pull_n.abs() <= self.coefficient * normal_n => Hold::Grip,
            _ if pull_n > 0.0 => Hold::SlipForward,
            _ => Hold::SlipBackward,
        }
    }

    /// Force on the ball (N) and growth of the stretch (m/s).
    pub(super) fn force(&self, hold: Hold, stretch_m: f64, slide_m_s: f64, normal_n: f64) -> (f64, f64) {
        let limit_n = self.coefficient * normal_n;
        let slipping = |pull_n: f64| (-pull_n, (pull_n - self.stiffness_n_m * stretch_m) / self.damping_n_s_m);
        match hold {
            Hold::Grip => (-self.grip_n(stretch_m, slide_m_s), slide_m_s),
            Hold::SlipForward => slipping(limit_n),
            Hold::SlipBackward => slipping(-limit_n),
        }
    }
}
