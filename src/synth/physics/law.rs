//! Forces between the ball and the surface.

use crate::results::ForceLaw;
use serde::{Deserialize, Serialize};

/// The normal force as a function of compression and its rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum NormalLaw {
    /// Spring and dashpot in parallel, F = k y + c v.
    KelvinVoigt {
        /// The stiffness k, N/m.
        stiffness_n_m: f64,
        /// The damping c, N s/m.
        damping_n_s_m: f64,
    },
    /// F = k y^1.5 (1 + c v).
    ///
    /// K. H. Hunt and F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440,
    /// <https://doi.org/10.1115/1.3423596>.
    HuntCrossley {
        /// The stiffness k, N/m^1.5.
        stiffness_n_m15: f64,
        /// The damping c, s/m.
        damping_s_m: f64,
    },
}

impl NormalLaw {
    /// Returns the force at a compression (m) and its rate (m/s), N; negative if the surface would have to pull.
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

    /// The law named in results.
    pub fn force_law(self) -> ForceLaw {
        match self {
            Self::KelvinVoigt { .. } => ForceLaw::KelvinVoigt,
            Self::HuntCrossley { .. } => ForceLaw::HuntCrossley,
        }
    }
}

/// The tangential force: a spring and a damper in the contact patch, in series with a sliding surface.
///
/// The surface grips up to the friction limit, then slides while the patch continues to relax. Springs, dampers and
/// friction only dissipate energy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// The stiffness of the patch, N/m.
    pub stiffness_n_m: f64,
    /// The damping of the patch, N s/m.
    pub damping_n_s_m: f64,
    /// The coefficient of friction, dimensionless.
    pub coefficient: f64,
}

/// The state of the contact patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PatchState {
    /// The patch deforms as the contact point moves.
    Grip,
    /// The surface slides along the positive tangent.
    SlipForward,
    /// The surface slides along the negative tangent.
    SlipBackward,
}

impl Friction {
    /// Returns the force of a gripping patch on the surface, N, positive along the tangent.
    ///
    /// The patch is stretched by `stretch_m`, and its contact point moves at `slide_m_s`.
    fn grip_force_n(&self, stretch_m: f64, slide_m_s: f64) -> f64 {
        self.stiffness_n_m * stretch_m + self.damping_n_s_m * slide_m_s
    }

    /// Returns the state of a patch: gripping up to the friction limit, otherwise sliding.
    pub(super) fn patch_state(&self, stretch_m: f64, slide_m_s: f64, normal_n: f64) -> PatchState {
        let patch_force_n = self.grip_force_n(stretch_m, slide_m_s);
        match patch_force_n {
            _ if patch_force_n.abs() <= self.coefficient * normal_n => PatchState::Grip,
            _ if patch_force_n > 0.0 => PatchState::SlipForward,
            _ => PatchState::SlipBackward,
        }
    }

    /// Returns the tangential force on the ball (N) and the rate at which the patch stretches (m/s).
    ///
    /// A sliding patch transmits the friction limit and relaxes through its damper.
    pub(super) fn force_and_stretch_rate(
        &self,
        state: PatchState,
        stretch_m: f64,
        slide_m_s: f64,
        normal_n: f64,
    ) -> (f64, f64) {
        let limit_n = self.coefficient * normal_n;
        let slipping = |patch_force_n: f64| {
            (-patch_force_n, (patch_force_n - self.stiffness_n_m * stretch_m) / self.damping_n_s_m)
        };
        match state {
            PatchState::Grip => (-self.grip_force_n(stretch_m, slide_m_s), slide_m_s),
            PatchState::SlipForward => slipping(limit_n),
            PatchState::SlipBackward => slipping(-limit_n),
        }
    }
}
