//! What a drift may be that is not surely seen.

use crate::results::Estimate;

/// Of balls so many turn about an axis in the picture's plane, if nothing is known of them, about as fast as they move.
pub const TURNS: f64 = 0.1;
/// As many turn more slowly, each of so many times as slow as the one before alike likely.
const SLOWER: f64 = 0.3;
const SLOWNESSES: i32 = 6;
/// What is seen to such a share of what is likely is believed to be none.
const TOLD: f64 = 0.1;
/// An exponent from which on nothing is left to weigh.
const MOST_FIT: f64 = 50.0;

/// What the drift may be, along x and y, where it is taken for none: of balls some turn, each as likely by less as by more
/// than `likely_px`, and some more slowly.
///
/// Subsets would see these: they count only where `by_subsets` is false.
pub fn unseen(rates: [Estimate; 2], likely_px: f64, by_subsets: bool) -> [f64; 2] {
    let slow = |slowness: i32| (TURNS / f64::from(SLOWNESSES), likely_px * SLOWER.powi(slowness));
    let slow = (1..=SLOWNESSES).filter(|_| !by_subsets).map(slow);
    let (mut all, mut squares) = (1.0, [0.0; 2]);
    for (share, px) in std::iter::once((TURNS, likely_px)).chain(slow) {
        let likely = px * px;
        // How much likelier they are to show this than those that do not turn (Bayes' factor of normal priors).
        let factor = rates.iter().fold(1.0, |factor, rate| {
            let own = rate.sigma * rate.sigma;
            let fits = 0.5 * rate.value * rate.value / own * likely / (own + likely);
            factor * (own / (own + likely)).sqrt() * fits.min(MOST_FIT).exp()
        });
        all += share * (factor - 1.0);
        for (square, rate) in squares.iter_mut().zip(rates) {
            let own = rate.sigma * rate.sigma;
            let gain = likely / (own + likely);
            let is_unseen = own / (own + TOLD * TOLD * likely);
            *square += share * factor * is_unseen * (gain * own + (gain * rate.value).powi(2));
        }
    }
    squares.map(|square| (square / all).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_less_is_seen_the_more_may_be_hidden() {
        let of = |value: f64, sigma: f64, by_subsets: bool| {
            unseen([Estimate { value, sigma }, Estimate { value: 0.0, sigma }], 1.0, by_subsets)[0]
        };
        // What is seen well is none; what is hardly seen is anything that some balls do.
        assert!(of(0.0, 1e-3, true) < 1e-4 && (0.2..0.4).contains(&of(0.0, 10.0, true)));
        // Slow turns lie below what outlines see.
        let [outlines, subsets] = [false, true].map(|by_subsets| of(0.0, 5e-3, by_subsets));
        assert!((3e-4..2e-3).contains(&outlines) && subsets < 0.3 * outlines, "{outlines} {subsets}");
        // What is likely none at three sigmas is likely some at six.
        assert!(of(0.015, 5e-3, false) < of(0.03, 5e-3, false));
    }
}
