//! The moment at which positions begin to leave a curve.

use super::departure::residual;
use crate::numeric::{Polynomial, Sample};

/// The exponents of the hinge: contact laws leave the parabola like t^2 (a dashpot) to t^3.5 (Hunt-Crossley).
const EXPONENTS: [f64; 2] = [2.0, 2.75];
/// The finest step of the search, frames.
const STEP_FRAMES: f64 = 0.25;
/// The range of the search before the first departed sample, frames.
const BACK_FRAMES: f64 = 10.0;

/// A gradual onset compared with a jump.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Onset {
    /// The best start of a hinge a (t - t0)^p, p = 2 or 2.75, frames.
    pub start_frames: f64,
    /// Whether the hinge fits better than a jump in position, which one wrong step would cause.
    pub gradual: bool,
}

/// Returns the samples with time reversed, so that an end becomes an onset.
pub fn time_reversed(samples: &[Sample]) -> Vec<Sample> {
    samples.iter().rev().map(|s| Sample { time_frames: -s.time_frames, ..*s }).collect()
}

/// Fits a hinge and a jump to the distances of the samples from `curve`.
///
/// `departed_frames` is the time of the first departed sample. `None` if no sample can be compared with the curve.
pub fn fit_onset(curve: &Polynomial, since: &[Sample], departed_frames: f64) -> Option<Onset> {
    let residuals: Vec<(f64, f64, f64)> = since
        .iter()
        .filter_map(|s| {
            let r = residual(curve, &[], s)?;
            Some((s.time_frames, r.value, s.sigma.powi(-2)))
        })
        .collect();
    let last = residuals.last()?.0;
    let chi2 = |shape: &dyn Fn(f64) -> f64| {
        let (mut bb, mut br) = (0.0, 0.0);
        for (t, r, w) in &residuals {
            bb += w * shape(*t).powi(2);
            br += w * shape(*t) * r;
        }
        let amplitude = if bb > 0.0 { (br / bb).max(0.0) } else { 0.0 };
        residuals.iter().map(|(t, r, w)| w * (r - amplitude * shape(*t)).powi(2)).sum::<f64>()
    };
    let mut best = (f64::INFINITY, departed_frames);
    let mut t0 = departed_frames - BACK_FRAMES;
    while t0 < last {
        for p in EXPONENTS {
            let cost = chi2(&|t| (t - t0).max(0.0).powf(p));
            if cost < best.0 {
                best = (cost, t0);
            }
        }
        t0 += STEP_FRAMES;
    }
    let jump =
        residuals.iter().map(|(from, ..)| chi2(&|t| f64::from(u8::from(t >= *from)))).fold(f64::INFINITY, f64::min);
    Some(Onset { start_frames: best.1, gradual: best.0 < jump })
}
