//! Numbers with their standard uncertainty.

/// A number with its standard uncertainty.
///
/// # Examples
///
/// ```
/// use ricochet::results::Estimate;
///
/// let restitution = Estimate { value: 0.80, sigma: 0.01 };
/// // A true value lies within two standard uncertainties in 95 % of all cases.
/// let [low, high] = [-2.0, 2.0].map(|factor| restitution.value + factor * restitution.sigma);
/// assert!(low < 0.79 && 0.81 < high);
/// ```
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
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    #[must_use]
    pub fn with_relative_error(self, share: f64) -> Self {
        Self { sigma: self.sigma.hypot(share * self.value), ..self }
    }
}
