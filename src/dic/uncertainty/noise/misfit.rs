//! The part of a residual that is no noise.

use super::{LAGS, NoisePool, REACH, lag_index};

impl NoisePool {
    /// Returns the fraction of the residual's variance that is no noise, 0 to 1: its mean autocorrelation two pixels apart.
    ///
    /// The noise of two pixels is independent, and interpolation correlates neighbours alone. Light, and whatever else a
    /// match does not describe, extends over several pixels.
    pub(in crate::dic) fn misfit_fraction(&self) -> f64 {
        let zero = lag_index(0, 0);
        let mean = |lag: usize| self.residual[lag] / self.pairs[lag].max(1.0);
        let far = (0..LAGS).filter(|lag| (lag / (2 * REACH + 1)).max((lag % (2 * REACH + 1)).abs_diff(REACH)) == REACH);
        let far = far.filter(|lag| *lag >= zero);
        let (sum, count) = far.fold((0.0, 0.0), |(sum, count), lag| (sum + mean(lag), count + 1.0));
        let fraction = sum / (count * mean(zero));
        if fraction > 0.0 { fraction.min(1.0) } else { 0.0 }
    }
}
