//! The prior of a drift that is not significant.

use crate::results::Estimate;

/// The share of balls that rotate about an axis in the image plane about as fast as they move, where nothing is known
/// of them.
pub const ROTATING_SHARE: f64 = 0.1;
/// The ratio between successive slower classes of rotation, each equally probable as the one before.
const CLASS_RATIO: f64 = 0.3;
/// The number of slower classes.
const SLOWNESSES: i32 = 6;
/// The uncertainty, as a share of the likely drift, below which a drift is taken as none.
const RESOLVED_SHARE: f64 = 0.1;
/// An exponent beyond which a probability is negligible.
const MAX_EXPONENT: f64 = 50.0;

/// The source of the rates of a drift.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Outlines alone.
    Outlines,
    /// Steps over subsets.
    Subsets,
}

/// Returns the standard deviation of the drift along x and y where it is taken as zero, px per frame.
///
/// It is that of the posterior over balls that do not rotate out of the plane, balls with a drift of the order of
/// `likely_px`, and balls that rotate more slowly.
///
/// The slow ones count only where the rates come from outlines, since subsets would detect them.
pub fn possible_drift(rates: [Estimate; 2], likely_px: f64, source: Source) -> [f64; 2] {
    let slow = |slowness: i32| (ROTATING_SHARE / f64::from(SLOWNESSES), likely_px * CLASS_RATIO.powi(slowness));
    let slow = (1..=SLOWNESSES).filter(|_| source == Source::Outlines).map(slow);
    let (mut all, mut squares) = (1.0, [0.0; 2]);
    for (share, px) in std::iter::once((ROTATING_SHARE, likely_px)).chain(slow) {
        let likely = px * px;
        // The Bayes factor of these rates for a rotating ball over one that does not rotate (normal priors).
        let factor = rates.iter().fold(1.0, |factor, rate| {
            let own = rate.sigma * rate.sigma;
            let fits = 0.5 * rate.value * rate.value / own * likely / (own + likely);
            factor * (own / (own + likely)).sqrt() * fits.min(MAX_EXPONENT).exp()
        });
        all += share * (factor - 1.0);
        for (square, rate) in squares.iter_mut().zip(rates) {
            let own = rate.sigma * rate.sigma;
            let gain = likely / (own + likely);
            let undetected = own / (own + RESOLVED_SHARE * RESOLVED_SHARE * likely);
            *square += share * factor * undetected * (gain * own + (gain * rate.value).powi(2));
        }
    }
    squares.map(|square| (square / all).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_less_is_seen_the_more_may_be_hidden() {
        let of = |value: f64, sigma: f64, source: Source| {
            possible_drift([Estimate { value, sigma }, Estimate { value: 0.0, sigma }], 1.0, source)[0]
        };
        // A precise zero leaves nothing; an imprecise one leaves what some balls do.
        assert!(of(0.0, 1e-3, Source::Subsets) < 1e-4 && (0.2..0.4).contains(&of(0.0, 10.0, Source::Subsets)));
        // Slow rotations lie below the resolution of outlines.
        let [outlines, subsets] = [Source::Outlines, Source::Subsets].map(|source| of(0.0, 5e-3, source));
        assert!((3e-4..2e-3).contains(&outlines) && subsets < 0.3 * outlines, "{outlines} {subsets}");
        // Three sigmas are probably none, six sigmas probably some.
        assert!(of(0.015, 5e-3, Source::Outlines) < of(0.03, 5e-3, Source::Outlines));
    }
}
