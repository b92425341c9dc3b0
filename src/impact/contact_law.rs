//! Contact laws.

use multiversion::multiversion;

use crate::numeric::{exp, ln};
use crate::results::Estimate;

/// A family of contact laws, from stiff to free.
///
/// All are cases of F/m = A (s(y) (y/y0)^n + c r(y) (v/v0) (y/y0)^m) with the depth y, its rate v, fixed units y0 and
/// v0, and a stiffness factor s = 1 + b1 T1 + ... + bd Td (Chebyshev) of 2 y/y0 - 1. The damping is either proportional
/// to the spring's force, r = s, or an independent dashpot, r = 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// n = 1, m = 0.
    KelvinVoigt,
    /// n = m = 3/2 (Hunt & Crossley 1975, doi:10.1115/1.3423596).
    HuntCrossley,
    /// m = n, n free.
    Power,
    /// n and m free.
    TwoExponents,
    /// n, m and s free.
    Stiffness {
        /// Degree of s, at most 7.
        degree: usize,
        /// Whether the damping is an independent dashpot, m = 0.
        dashpot: bool,
    },
}

/// The maximum number of parameters of a law: start, speed, ln A, c, n, m, b1 to b7.
pub const MAX_PARAMETERS: usize = 13;

/// Parameters in the order of `MAX_PARAMETERS`; the first [`Family::parameter_count`] are free, the rest follow.
pub type Parameters = [f64; MAX_PARAMETERS];

impl Family {
    /// Returns the number of free parameters.
    pub fn parameter_count(self) -> usize {
        match self {
            Self::KelvinVoigt | Self::HuntCrossley => 4,
            Self::Power => 5,
            Self::TwoExponents => 6,
            Self::Stiffness { degree, .. } => 6 + degree.min(MAX_PARAMETERS - 6),
        }
    }

    /// Fills in the parameters that are not free.
    pub fn complete(self, p: &Parameters) -> Parameters {
        let mut p = *p;
        match self {
            Self::KelvinVoigt => (p[4], p[5]) = (1.0, 0.0),
            Self::HuntCrossley => (p[4], p[5]) = (1.5, 1.5),
            Self::Power => p[5] = p[4],
            Self::Stiffness { dashpot: true, .. } => p[5] = 0.0,
            Self::TwoExponents | Self::Stiffness { .. } => {}
        }
        p[self.parameter_count().max(6)..].fill(0.0);
        p
    }
}

/// The units of the parameters, and the free fall along the depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// Depth, px.
    pub depth: f64,
    /// Speed, px/frame.
    pub speed: f64,
    /// Acceleration into the surface, px/frame^2.
    pub gravity: f64,
}

/// The quantities that a law predicts for a contact: start, deepest, end, 2 % start, 2 % end (frames), speed before and
/// after (px/frame, inwards positive), maximum depth (px), peak outward acceleration (px/frame^2), duration (frames).
///
/// The duration is separate because the errors of start and end are not independent.
pub type Findings = [f64; 10];

/// The quantities of a contact: times in frames, lengths in px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactEstimates {
    /// The first contact.
    pub start: Estimate,
    /// The deepest moment.
    pub deepest: Estimate,
    /// The end of the contact.
    pub end: Estimate,
    /// The moment from which the force exceeds 2 % of its maximum.
    pub force_start: Estimate,
    /// The moment up to which it does.
    pub force_end: Estimate,
    /// The maximum depth, px.
    pub depth_max: Estimate,
    /// The maximum acceleration away from the surface, px/frame^2.
    pub acceleration_max: Estimate,
    /// The duration. The errors of start and end are not independent.
    pub duration: Estimate,
}

impl ContactEstimates {
    pub(super) fn new(findings: &Findings, sigmas: &Findings) -> Self {
        let both = std::array::from_fn(|k| Estimate { value: findings[k], sigma: sigmas[k] });
        let [start, deepest, end, force_start, force_end, _, _, depth_max, acceleration_max, duration]: [Estimate; 10] =
            both;
        Self { start, deepest, end, force_start, force_end, depth_max, acceleration_max, duration }
    }

    /// Returns the quantities with standard uncertainties multiplied by `factor`.
    pub(super) fn widened(self, factor: f64) -> Self {
        let wide = |x: Estimate| Estimate { sigma: factor * x.sigma, ..x };
        Self {
            start: wide(self.start),
            deepest: wide(self.deepest),
            end: wide(self.end),
            force_start: wide(self.force_start),
            force_end: wide(self.force_end),
            depth_max: wide(self.depth_max),
            acceleration_max: wide(self.acceleration_max),
            duration: wide(self.duration),
        }
    }
}

/// The number of parameter sets integrated in parallel: as many as the numbers of the longest vector.
pub(super) const SETS: usize = 8;

/// One number for each of several sets of parameters that are integrated in parallel.
pub(super) type Row = [f64; SETS];

/// The states of bodies in their contacts: frames since its start, px, px/frame and px/frame^2.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct States {
    pub(super) time: Row,
    pub(super) depth: Row,
    pub(super) speed: Row,
    pub(super) force: Row,
}

/// A law with several sets of parameters that differ little.
#[derive(Debug, Clone)]
pub(super) struct Law {
    form: u8,
    /// A in place of its logarithm.
    p: [Row; MAX_PARAMETERS],
    pub(super) units: Units,
}

/// The form in which the force is computed.
const LINEAR: u8 = 0;
const HERTZ: u8 = 1;
const POWER: u8 = 2;
const EXPONENTS: u8 = 3;
const STIFFNESS: u8 = 4;
const DASHPOT: u8 = 5;

/// The minimum depth, as a share of the unit of depth, whose logarithm is taken.
const MIN_DEPTH: f64 = 1e-300;

impl Law {
    /// Creates the law for these sets; the last set also fills the unused lanes.
    ///
    /// # Panics
    ///
    /// If `sets` is empty.
    pub(super) fn new(family: Family, sets: &[Parameters], units: &Units) -> Self {
        let mut p = [[0.0; SETS]; MAX_PARAMETERS];
        for (set, own) in (0..SETS).map(|set| (set, &sets[set.min(sets.len() - 1)])) {
            p.iter_mut().zip(own).for_each(|(row, value)| row[set] = *value);
            p[2][set] = own[2].exp();
        }
        let form = match family {
            Family::KelvinVoigt => LINEAR,
            Family::HuntCrossley => HERTZ,
            Family::Power => POWER,
            Family::TwoExponents => EXPONENTS,
            Family::Stiffness { dashpot: false, .. } => STIFFNESS,
            Family::Stiffness { dashpot: true, .. } => DASHPOT,
        };
        Self { form, p, units: *units }
    }

    /// Returns the states at first contact.
    pub(super) fn initial_states(&self) -> States {
        let zero = [0.0; SETS];
        let touch = States { time: zero, depth: zero, speed: self.p[1], force: zero };
        // A step of zero length computes the force.
        let mut start = touch;
        self.advance(&touch, &zero, &mut start);
        start
    }

    /// Advances each set from one state by a fourth-order Runge-Kutta step of its own length, frames.
    pub(super) fn advance(&self, from: &States, step: &Row, to: &mut States) {
        advance(self, from, step, to);
    }

    /// Returns the force on the body of one set over its mass, px/frame^2, outwards positive; the formula is that of
    /// [`Family`].
    ///
    /// `depth` in px and `speed` in px/frame are inwards positive.
    #[inline(always)]
    fn force<const FORM: u8>(&self, set: usize, depth: f64, speed: f64) -> f64 {
        let [_, _, amplitude, damping, n, m, stiffness @ ..] = &self.p;
        let y = depth / self.units.depth;
        let y = if y > 0.0 { y } else { 0.0 };
        let (spring, dash) = match FORM {
            LINEAR => (y, 1.0),
            HERTZ => (y * y.sqrt(), y * y.sqrt()),
            _ => {
                let log = ln(if y > MIN_DEPTH { y } else { MIN_DEPTH });
                let spring = exp(n[set] * log);
                (spring, if FORM == POWER || FORM == DASHPOT { spring } else { exp(m[set] * log) })
            }
        };
        let dash = if FORM == DASHPOT { 1.0 } else { dash };
        let factor = if FORM >= STIFFNESS { chebyshev_factor(stiffness, set, 2.0 * y - 1.0) } else { 1.0 };
        let damped = if FORM == DASHPOT { 1.0 } else { factor };
        amplitude[set] * (factor * spring + damped * damping[set] * dash * speed / self.units.speed)
    }

    /// Advances each set by the classical Runge-Kutta method of fourth order, for one form of the law.
    #[inline(always)]
    fn runge_kutta_step<const FORM: u8>(&self, from: &States, step: &Row, to: &mut States) {
        let gravity = self.units.gravity;
        let States { depth, speed, force, .. } = from;
        let mut speeds = [[0.0; SETS]; 3];
        let mut accelerations = [[0.0; SETS]; 3];
        for i in 0..SETS {
            speeds[0][i] = speed[i] + 0.5 * step[i] * (gravity - force[i]);
            accelerations[0][i] = gravity - self.force::<FORM>(i, depth[i] + 0.5 * step[i] * speed[i], speeds[0][i]);
        }
        for i in 0..SETS {
            speeds[1][i] = speed[i] + 0.5 * step[i] * accelerations[0][i];
            accelerations[1][i] =
                gravity - self.force::<FORM>(i, depth[i] + 0.5 * step[i] * speeds[0][i], speeds[1][i]);
        }
        for i in 0..SETS {
            speeds[2][i] = speed[i] + step[i] * accelerations[1][i];
            accelerations[2][i] = gravity - self.force::<FORM>(i, depth[i] + step[i] * speeds[1][i], speeds[2][i]);
        }
        for i in 0..SETS {
            let sixth = step[i] / 6.0;
            to.time[i] = from.time[i] + step[i];
            to.depth[i] = depth[i] + sixth * (speed[i] + 2.0 * (speeds[0][i] + speeds[1][i]) + speeds[2][i]);
            to.speed[i] = speed[i]
                + sixth
                    * ((gravity - force[i]) + 2.0 * (accelerations[0][i] + accelerations[1][i]) + accelerations[2][i]);
            to.force[i] = self.force::<FORM>(i, to.depth[i], to.speed[i]);
        }
    }
}

/// Advances each set by one step, with the widest vectors of the processor.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn advance(law: &Law, from: &States, step: &Row, to: &mut States) {
    match law.form {
        LINEAR => law.runge_kutta_step::<LINEAR>(from, step, to),
        HERTZ => law.runge_kutta_step::<HERTZ>(from, step, to),
        POWER => law.runge_kutta_step::<POWER>(from, step, to),
        EXPONENTS => law.runge_kutta_step::<EXPONENTS>(from, step, to),
        STIFFNESS => law.runge_kutta_step::<STIFFNESS>(from, step, to),
        _ => law.runge_kutta_step::<DASHPOT>(from, step, to),
    }
}

/// Returns the stiffness factor 1 + b1 T1 + ... + b7 T7 of one set at `x`, -1 to 1.
#[inline(always)]
fn chebyshev_factor(b: &[Row; MAX_PARAMETERS - 6], set: usize, x: f64) -> f64 {
    let (mut sum, mut lower, mut here) = (1.0, 1.0, x);
    for row in b {
        sum += row[set] * here;
        (lower, here) = (here, 2.0 * x * here - lower);
    }
    sum
}
