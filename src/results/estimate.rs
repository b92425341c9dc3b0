//! Numbers with their standard uncertainty.

/// A number with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its standard uncertainty, in the same unit.
    pub sigma: f64,
}

impl Estimate {
    /// Adds `share * value` to the standard uncertainty in quadrature, for a number that may be wrong by this share.
    ///
    /// `share` (no unit) counts as one standard uncertainty relative to the value, which stays as it is.
    #[must_use]
    pub fn short_by(self, share: f64) -> Self {
        Self { sigma: self.sigma.hypot(share * self.value), ..self }
    }
}
