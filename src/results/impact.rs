//! What a collision did.

use super::PointStatus;

/// A number with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its standard uncertainty, same unit.
    pub sigma: f64,
}

impl Estimate {
    /// The same where the true number may differ by a share of it.
    #[must_use]
    pub fn short_by(self, share: f64) -> Self {
        Self { sigma: self.sigma.hypot(share * self.value), ..self }
    }
}

/// The contact law that described the collision best.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum ForceLaw {
    /// No law was accepted; the times come from the motion alone.
    #[default]
    None = 0,
    /// Spring and dashpot, F = k y + c v.
    KelvinVoigt = 1,
    /// F = k y^1.5 (1 + c v).
    HuntCrossley = 2,
    /// F = k y^n (1 + c v), n free.
    PowerLaw = 3,
}

impl ForceLaw {
    /// Every law, in the order of its number.
    pub const ALL: [Self; 4] = [Self::None, Self::KelvinVoigt, Self::HuntCrossley, Self::PowerLaw];

    /// The word used in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::KelvinVoigt => "kelvin-voigt",
            Self::HuntCrossley => "hunt-crossley",
            Self::PowerLaw => "power-law",
        }
    }

    /// The law with this word, if there is one.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|law| law.word() == word)
    }

    /// The law with this number, if there is one.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|law| *law as u32 == number)
    }
}

/// How many numbers an [`Impact`] has.
pub const IMPACT_NUMBERS: usize = 23;

/// One collision of one body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impact {
    /// Index of the body in the configuration.
    pub body: u32,
    /// Counts the collisions of this body from 0.
    pub number: u32,
    /// Counts up each time the same collision is told again with better numbers.
    pub revision: u32,
    /// The moment the `_s` times below count from, ns since the Unix epoch: the stream's first frame.
    pub origin_ns: u64,
    /// The force begins.
    pub start_s: Option<Estimate>,
    /// The normal velocity crosses zero.
    pub deepest_s: Option<Estimate>,
    /// The force is back to zero.
    pub end_s: Option<Estimate>,
    /// Normal velocity at the start (negative: towards the surface).
    pub vn_before_m_s: Option<Estimate>,
    /// Normal velocity at the end.
    pub vn_after_m_s: Option<Estimate>,
    /// Tangential velocity at the start.
    pub vt_before_m_s: Option<Estimate>,
    /// Tangential velocity at the end.
    pub vt_after_m_s: Option<Estimate>,
    /// Spin before, counter-clockwise positive.
    pub omega_before_rad_s: Option<Estimate>,
    /// Spin after.
    pub omega_after_rad_s: Option<Estimate>,
    /// Normal speed after over normal speed before.
    pub restitution: Option<Estimate>,
    /// Change of sign and size of the contact point's tangential speed, -(s after)/(s before).
    pub restitution_tangential: Option<Estimate>,
    /// Tangential impulse over normal impulse.
    pub impulse_ratio: Option<Estimate>,
    /// End minus start.
    pub contact_time_s: Option<Estimate>,
    /// Deepest point of the centre below where contact started, mm.
    pub compression_max_mm: Option<Estimate>,
    /// Highest normal acceleration.
    pub acceleration_max_m_s2: Option<Estimate>,
    /// The contact point stops slipping.
    pub slip_end_s: Option<Estimate>,
    /// The force passes 2 % of its peak on its way up.
    pub force_start_s: Option<Estimate>,
    /// And on its way down.
    pub force_end_s: Option<Estimate>,
    /// Highest normal force, where the mass is known.
    pub force_max_n: Option<Estimate>,
    /// Kinetic energy that the centre's motion lost, where the mass is known; that of the spin is not in it.
    pub energy_lost_j: Option<Estimate>,
    /// Acceleration of the free flights on both sides along gravity: beside gravity itself, a check of the scale.
    pub gravity_m_s2: Option<Estimate>,
    /// By which share a second the body grew in the picture in the flight before: it came nearer to the camera, or went to
    /// where the lens draws it larger. The numbers above are those of a body at the distance it has at first touch.
    pub growth_before_per_s: Option<Estimate>,
    /// And after.
    pub growth_after_per_s: Option<Estimate>,
    /// The contact law behind the times.
    pub force_law: ForceLaw,
    /// How probable that law is among those that follow the motion, 0 to 1; `None` where none was fitted.
    pub force_law_probability: Option<f64>,
    /// What became of it.
    pub status: PointStatus,
}

impl Impact {
    /// A collision of which nothing is known yet.
    pub fn unknown(body: u32, number: u32, origin_ns: u64) -> Self {
        Self {
            body,
            number,
            revision: 0,
            origin_ns,
            start_s: None,
            deepest_s: None,
            end_s: None,
            vn_before_m_s: None,
            vn_after_m_s: None,
            vt_before_m_s: None,
            vt_after_m_s: None,
            omega_before_rad_s: None,
            omega_after_rad_s: None,
            restitution: None,
            restitution_tangential: None,
            impulse_ratio: None,
            contact_time_s: None,
            compression_max_mm: None,
            acceleration_max_m_s2: None,
            slip_end_s: None,
            force_start_s: None,
            force_end_s: None,
            force_max_n: None,
            energy_lost_j: None,
            gravity_m_s2: None,
            growth_before_per_s: None,
            growth_after_per_s: None,
            force_law: ForceLaw::None,
            force_law_probability: None,
            status: PointStatus::Lost,
        }
    }

    /// Whether a number of this name is a moment, which counts from [`Impact::origin_ns`], and no duration.
    pub fn is_moment(name: &str) -> bool {
        matches!(name, "start_s" | "deepest_s" | "end_s" | "slip_end_s" | "force_start_s" | "force_end_s")
    }

    /// Every measured number with its column name, in the order of the table.
    pub fn numbers(&self) -> [(&'static str, Option<Estimate>); IMPACT_NUMBERS] {
        [
            ("start_s", self.start_s),
            ("deepest_s", self.deepest_s),
            ("end_s", self.end_s),
            ("vn_before_m_s", self.vn_before_m_s),
            ("vn_after_m_s", self.vn_after_m_s),
            ("vt_before_m_s", self.vt_before_m_s),
            ("vt_after_m_s", self.vt_after_m_s),
            ("omega_before_rad_s", self.omega_before_rad_s),
            ("omega_after_rad_s", self.omega_after_rad_s),
            ("restitution", self.restitution),
            ("restitution_tangential", self.restitution_tangential),
            ("impulse_ratio", self.impulse_ratio),
            ("contact_time_s", self.contact_time_s),
            ("compression_max_mm", self.compression_max_mm),
            ("acceleration_max_m_s2", self.acceleration_max_m_s2),
            ("slip_end_s", self.slip_end_s),
            ("force_start_s", self.force_start_s),
            ("force_end_s", self.force_end_s),
            ("force_max_n", self.force_max_n),
            ("energy_lost_j", self.energy_lost_j),
            ("gravity_m_s2", self.gravity_m_s2),
            ("growth_before_per_s", self.growth_before_per_s),
            ("growth_after_per_s", self.growth_after_per_s),
        ]
    }
}
