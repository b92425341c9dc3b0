//! The test whether a position lies on the parabola of the flight before it.

use crate::numeric::{Polynomial, Sample};
use crate::results::Estimate;

/// The maximum difference between a measured and a known acceleration that are taken as equal, sigmas.
const SAME_ACCELERATION: f64 = 4.0;

/// The number of standard uncertainties that an error of the centre may reach, relative to the number that a departure
/// needs. It is one error, not one of many, as noise is.
const DRIFT_SHARE: f64 = 2.5 / 6.0;

/// A new position compared with the flight before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Departure {
    /// Distance from the nearest plausible curve in units of its standard uncertainty, positive along the outward
    /// normal.
    pub sigmas: f64,
    /// The same, with the drift of the centre of a body that turns.
    pub certain_sigmas: f64,
    /// Normal velocity at the end of the flight, the most uncertain of the plausible ones, px/frame.
    pub rate: Estimate,
}

/// Returns the curves that a flight may follow.
///
/// They are the parabola of `gravity` (px/frame^2) and the straight line of a body that is held or rolls on a level.
/// Where neither agrees with the measured acceleration, the curve with the measured one is returned. Empty for too
/// few samples.
pub fn plausible_curves(flight: &[Sample], gravity: Option<f64>) -> Vec<Polynomial> {
    let (Some(first), Some(last)) = (flight.first(), flight.last()) else { return Vec::new() };
    let middle = 0.5 * (first.time_frames + last.time_frames);
    let free = Polynomial::fit(flight, middle, 2, 0.0);
    let agrees = |known: f64| {
        free.as_ref().is_none_or(|fit| {
            let a = fit.curvature();
            (a.value - known).abs() <= SAME_ACCELERATION * a.sigma * fit.excess()
        })
    };
    let known = gravity.into_iter().chain(std::iter::once(0.0)).filter(|a| agrees(*a));
    let curves: Vec<_> = known.filter_map(|a| Polynomial::fit(flight, middle, 1, a)).collect();
    if curves.is_empty() { free.into_iter().collect() } else { curves }
}

/// Returns sample minus curve, with the uncertainty of both.
///
/// In a component without an offset in the fit of the curve, it is measured from the first sample of the component in
/// `since`. `None` without such a sample.
pub fn residual(curve: &Polynomial, since: &[Sample], sample: &Sample) -> Option<Estimate> {
    let excess = curve.excess();
    if let Some(predicted) = curve.predict(sample.time_frames, sample.component) {
        return Some(Estimate {
            value: sample.value - predicted.value,
            sigma: excess * predicted.sigma.hypot(sample.sigma),
        });
    }
    let first = since.iter().find(|s| s.component == sample.component && s.time_frames < sample.time_frames)?;
    let advance = curve.advance(first.time_frames, sample.time_frames);
    let noise = first.sigma.hypot(sample.sigma);
    Some(Estimate { value: sample.value - first.value - advance.value, sigma: excess * advance.sigma.hypot(noise) })
}

/// Returns the smaller of two distances from a curve; 0 if they lie on both sides.
fn nearer(one: f64, other: f64) -> f64 {
    if one * other <= 0.0 {
        0.0
    } else if other.abs() < one.abs() {
        other
    } else {
        one
    }
}

/// Returns what the uncertainty of a distance contains, px, if the velocities on both sides of some frames have
/// independent errors of `turning_sigma`, px/frame.
pub fn drift(turning_sigma: f64, frames: f64) -> f64 {
    DRIFT_SHARE * std::f64::consts::SQRT_2 * turning_sigma * frames.abs()
}

/// Compares the last of `since` with the `flight` before it; `None` where they have no component in common.
///
/// `gravity` is along the normal, px/frame^2. `turning_sigma` is the uncertainty of the velocity from the centre of a
/// body that turns, px/frame, which may differ between the flight and the sample. If the plausible curves lie on both
/// sides of the sample, its distance is 0.
pub fn test_departure(
    flight: &[Sample],
    since: &[Sample],
    gravity: Option<f64>,
    turning_sigma: f64,
) -> Option<Departure> {
    let (end, sample) = (flight.last()?, since.last()?);
    let drift = drift(turning_sigma, sample.time_frames - end.time_frames);
    let mut nearest: Option<Departure> = None;
    for curve in plausible_curves(flight, gravity) {
        let distance = residual(&curve, since, sample)?;
        let rate = curve.rate(end.time_frames);
        let rate = Estimate { value: rate.value, sigma: rate.sigma * curve.excess() };
        let (sigmas, certainty) = (distance.value / distance.sigma, rate.value / rate.sigma);
        let certain_sigmas = distance.value / distance.sigma.hypot(drift);
        nearest = Some(match nearest {
            None => Departure { sigmas, certain_sigmas, rate },
            Some(o) => Departure {
                sigmas: nearer(o.sigmas, sigmas),
                certain_sigmas: nearer(o.certain_sigmas, certain_sigmas),
                // An approach is negative: the larger ratio is the less certain approach.
                rate: if certainty > o.rate.value / o.rate.sigma { rate } else { o.rate },
            },
        });
    }
    nearest
}
