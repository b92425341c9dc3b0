//! The interval of a contact, the flights on both sides, and the conversion to physical quantities.

use crate::motion::SpeedBias;
use crate::numeric::Polynomial;
use crate::results::Estimate;

/// The uncertainty of the rotation per frame from which it is not known at all, rad.
pub(super) const MAX_SPIN_SIGMA_RAD: f64 = 1.5;

/// The conversion from frames and px to physical quantities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImpactContext {
    /// The scale, metres per px.
    pub metres_per_px: Estimate,
    /// The period of the nodes, s.
    pub period_s: f64,
    /// The frames between two nodes.
    pub stride: u32,
    /// Gravity along normal and tangent, px/node^2.
    pub gravity_px: [f64; 2],
    /// Radius of a ball, px.
    pub radius_px: Option<Estimate>,
    /// Mass of the body, kg, where it is known.
    pub mass_kg: Option<f64>,
    /// The standard uncertainty of the centre, px. For a rotating body it moves the point whose speed is reported.
    pub center_sigma_px: f64,
    /// The possible underestimate of the motion, as a share.
    pub speed_bias: SpeedBias,
    /// The share by which light may have held back the spin.
    pub light_fraction: f64,
    /// Whether the surface is fixed. Bodies do not fall by gravity alone relative to one that moves.
    pub is_surface_fixed: bool,
}

impl ImpactContext {
    /// Converts the context of every frame to that of every `stride`-th.
    pub fn with_stride(self, stride: u32) -> Self {
        let periods = f64::from(stride);
        let gravity_px = self.gravity_px.map(|gravity| gravity * periods.powi(2));
        Self { period_s: self.period_s * periods, stride, gravity_px, ..self }
    }

    /// Converts an acceleration from px/frame^2 to m/s^2.
    pub(super) fn acceleration(&self, a: Estimate) -> Estimate {
        let relative = self.metres_per_px.sigma / self.metres_per_px.value;
        scaled(a, self.metres_per_px.value / self.period_s.powi(2), relative)
    }
}

/// Flights on both sides of the contact interval.
pub(super) struct Flights {
    pub(super) before: [Polynomial; 3],
    pub(super) after: [Polynomial; 3],
    /// The standard uncertainty of their velocities from outlines whose error changes along the flight, px/frame.
    pub(super) shift_sigmas: [f64; 2],
}

/// The interval of contact as known so far, frames.
#[derive(Clone, Copy)]
pub(super) struct Interval {
    pub(super) start: Estimate,
    pub(super) deepest: Option<Estimate>,
    pub(super) end: Estimate,
    /// The latest moment of certain flight before.
    pub(super) before_to: f64,
    /// The latest moment of flight, however short it is.
    pub(super) before_last: f64,
    pub(super) after_from: f64,
}

impl Interval {
    /// Returns the interval with larger standard uncertainties of its moments.
    pub(super) fn widened(self, factor: f64) -> Self {
        let wide = |at: Estimate| Estimate { sigma: factor * at.sigma, ..at };
        Self { start: wide(self.start), deepest: self.deepest.map(wide), end: wide(self.end), ..self }
    }
}

/// Returns a product with a factor that has its own relative uncertainty.
pub(super) fn scaled(x: Estimate, factor: f64, relative_sigma: f64) -> Estimate {
    let value = x.value * factor;
    Estimate { value, sigma: (x.sigma * factor.abs()).hypot(value * relative_sigma) }
}
