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
    /// Adds the uncertainty of a true number that may differ by a share of this one.
    #[must_use]
    pub fn short_by(self, share: f64) -> Self {
        Self { sigma: self.sigma.hypot(share * self.value), ..self }
    }
}
