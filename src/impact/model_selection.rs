//! Which law, and what all of them together say.

use std::f64::consts::SQRT_2;

use super::contact_law::{Family, Findings, Parameters, Units};
use super::law_fit::{Expected, LawFit, fit_law};
use crate::numeric::Sample;
use crate::results::ForceLaw;

/// The freest law may still tell times if its residuals are not larger than so many sigmas.
const CLOSE_SIGMAS: f64 = 3.0;

/// Share of the greatest depth at which the force of a y^1.5 contact passes 2 % of its peak: 0.02^(2/3).
const UNSEEN: f64 = 0.074;

/// Share of a normal distribution within one sigma.
const ONE_SIGMA: f64 = 0.682_7;

/// Exponents or a stiffness left free know start and end to about this share of the time that the force is too small to
/// be seen (simulated ripples of 25 % over the stroke, of any length and phase; so are the shares that follow).
const FREE_END: f64 = 0.75;

/// And the moments of 2 % force to about this share of how well they know start and end.
const FREE_FAINT: f64 = 0.4;

/// What the noise hides of how the force begins it hides from the free stiffness, too: start and moment of 2 % force are
/// off by so many of their own sigmas on top.
const HIDDEN: [f64; 2] = [1.0, 2.0];

/// And the peak of the force to about this share.
const FREE_PEAK: f64 = 0.02;

/// With a dashpot of its own, start and end are known to about these shares of the contact.
const DASHPOT: [f64; 2] = [0.0025, 0.007];

/// Displacements are off by about so much that no fit of theirs shows, px: what interpolation and uneven light leave.
const UNTOLD_PX: f64 = 0.0004;

/// And each step by about this share of what it leaves for good in the same sense as its neighbours: seen at the turn of
/// rendered balls, the only moment that is told to a thousandth of a frame.
const DRIFT: f64 = 0.25;

/// Exponents that any contact may have: those of a spring, of smooth bodies (3/2) and of cones (2) are in it.
const ANY: [Expected; 2] = [[1.25, 0.25], [0.75, 0.75]];

/// How far exponents may be from those of the nearest simple law, where the stiffness takes up what they do not.
const NEAR: [f64; 2] = [0.05, 0.2];

/// How much likelier a law without free exponents is than any other before the motion is looked at.
const KNOWN_ODDS: f64 = 10.0;

/// Degrees of a free stiffness.
const DEGREES: [usize; 3] = [3, 5, 7];

/// Positions that scatter about a law by less than their sigmas were surer than these, down to this share of the variance:
/// some 200 of them know it to a tenth.
const LEAST_SCATTER: f64 = 0.8;

/// What two straight flights say of a contact: where the fits of the laws begin. Frames, px, inwards positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstGuess {
    /// The deepest moment.
    pub deepest: f64,
    /// How far the flight before would have gone beyond the deepest point.
    pub shortfall: f64,
    /// Speed before.
    pub speed: f64,
    /// Restitution.
    pub restitution: f64,
    /// Free fall into the surface, px/frame^2.
    pub gravity: f64,
}

/// What the laws that passed say together.
#[derive(Debug, Clone)]
pub struct Verdict {
    /// The most probable law.
    pub best: Family,
    /// How probable each of those that passed is, their sum 1.
    pub probabilities: Vec<(Family, f64)>,
    /// Means over the laws with these weights.
    pub findings: Findings,
    /// Their standard uncertainties: the laws' own, the spread between them, the laws' misfit, and for exponents or a
    /// stiffness left free how little start and end are then known.
    pub sigmas: Findings,
}

impl Verdict {
    /// What results call the most probable law.
    pub fn law(&self) -> ForceLaw {
        word(self.best)
    }

    /// How probable what is called so is, 0 to 1.
    pub fn probability(&self) -> f64 {
        let same = self.probabilities.iter().filter(|(family, _)| word(*family) == self.law());
        same.map(|(_, probability)| probability).sum::<f64>().min(1.0)
    }
}

fn word(family: Family) -> ForceLaw {
    match family {
        Family::KelvinVoigt => ForceLaw::KelvinVoigt,
        Family::HuntCrossley => ForceLaw::HuntCrossley,
        Family::Power | Family::TwoExponents => ForceLaw::PowerLaw,
        Family::Stiffness { .. } => ForceLaw::None,
    }
}

impl FirstGuess {
    /// Parameters of a law with exponent `n` and units to count them in; `ratio` = time to the deepest point over
    /// depth/speed (1.57 for a spring, 1.47 for n = 3/2).
    fn parameters(&self, n: f64, m: f64, ratio: f64) -> (Parameters, Units) {
        let depth = self.shortfall / (ratio - 1.0);
        let units = Units { depth, speed: self.speed, gravity: self.gravity };
        let e = self.restitution.clamp(0.05, 1.0);
        let root_e = e.sqrt();
        // Energy at the deepest point is about v^2 e / 2; the damper takes the rest.
        let size = 0.5 * (n + 1.0) * self.speed.powi(2) * root_e / depth;
        let damping = 1.5 * (1.0 - e) * if m > 0.5 { 1.0 } else { 0.4 };
        let start = self.deepest - ratio * depth / self.speed;
        ([start, self.speed, size.ln(), damping, n, m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], units)
    }
}

/// Fits every family and weighs them by their evidence in Laplace's approximation (Kass & Raftery 1995,
/// doi:10.1080/01621459.1995.10476572): chi2, and what the positions narrow down of each law's free parameters.
///
/// A law passes with chi2/freedom up to `excess^2` (1 + 4 sqrt(2/freedom)), `excess` being by how much the flights
/// scatter more than their sigmas; among those that pass the criterion decides. If none does, the law with free
/// stiffness is taken if it comes within three sigmas, its misfit in the uncertainties; else `None`.
pub fn judge(guess: &FirstGuess, samples: &[Sample], excess: f64) -> Option<Verdict> {
    let fits = fit_all(guess, samples);
    let mut passed: Vec<&LawFit> = fits.iter().filter(|f| passes(f, excess)).collect();
    if passed.is_empty() {
        // No law holds, but one with its stiffness free may follow the motion closely enough to tell times by.
        let close = |f: &&LawFit| f.chi2 / f.freedom <= (CLOSE_SIGMAS * excess).powi(2);
        passed.extend(fits.iter().filter(|f| matches!(f.family, Family::Stiffness { .. })).filter(close));
    }
    let least = fits.iter().filter(|f| matches!(f.family, Family::Stiffness { .. })).map(|f| f.narrowing);
    let least = least.fold(f64::INFINITY, f64::min);
    let criterion = |f: &LawFit| f.chi2 / excess.powi(2) + cost(f, least);
    let best = passed.iter().min_by(|a, b| criterion(a).total_cmp(&criterion(b)))?;
    let weights: Vec<f64> = passed.iter().map(|f| (0.5 * (criterion(best) - criterion(f))).exp()).collect();
    let total: f64 = weights.iter().sum();
    let weighed = || passed.iter().zip(&weights).map(|(f, w)| (*f, w / total));
    let findings: Findings = std::array::from_fn(|k| weighed().map(|(f, w)| w * f.findings[k]).sum());
    let drift_px = DRIFT * samples.iter().map(|s| s.walk).sum::<f64>() / samples.len() as f64;
    let sigmas = std::array::from_fn(|k| {
        let laws: Vec<_> =
            weighed().map(|(f, w)| [w, f.findings[k] - findings[k], own_variance(f, k, drift_px).sqrt()]).collect();
        spread(&laws)
    });
    let probabilities = weighed().map(|(f, w)| (f.family, w)).collect();
    Some(Verdict { best: best.family, probabilities, findings, sigmas })
}

/// Half the width of the interval about zero that holds 68.3 % of a mixture of normal distributions, each given by
/// `[weight, mean, sigma]`, the weights' sum 1.
///
/// A law with a small weight and far less sure of the moment would rule the standard deviation and nothing else.
fn spread(laws: &[[f64; 3]]) -> f64 {
    let farthest = laws.iter().map(|[_, mean, sigma]| mean.abs() + 4.0 * sigma).fold(0.0, f64::max);
    let held = |half: f64| -> f64 {
        let below = |x: f64, sigma: f64| 0.5 * libm::erfc(-x / (sigma.max(f64::MIN_POSITIVE) * SQRT_2));
        laws.iter().map(|[w, mean, sigma]| w * (below(half - mean, *sigma) - below(-half - mean, *sigma))).sum()
    };
    let (mut low, mut high) = (0.0, farthest);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if held(middle) < ONE_SIGMA { low = middle } else { high = middle }
    }
    high
}

/// What a law's free parameters cost, and that it is none of those that are known. Exponents that are merely fitted say no
/// more of how the force begins than a stiffness that is, which costs at least `least`: neither is preferred to the other
/// for having fewer parameters.
fn cost(f: &LawFit, least: f64) -> f64 {
    match f.family {
        Family::KelvinVoigt | Family::HuntCrossley => 0.0,
        Family::Power | Family::TwoExponents if least.is_finite() => f.narrowing.max(least) + 2.0 * KNOWN_ODDS.ln(),
        _ => f.narrowing + 2.0 * KNOWN_ODDS.ln(),
    }
}

fn passes(f: &LawFit, excess: f64) -> bool {
    f.chi2 / f.freedom <= excess.powi(2) * (1.0 + 4.0 * (2.0 / f.freedom).sqrt())
}

/// A law's own variance of one finding, its misfit and its freedom at both ends included, where each step drifts by so
/// much.
fn own_variance(f: &LawFit, k: usize, drift_px: f64) -> f64 {
    let own = f.sigmas[k].powi(2) * (f.chi2 / f.freedom).max(LEAST_SCATTER);
    // Where exponents or the stiffness are free, start and end are what they make of the unseen first and last two
    // percents of the force, over which a y^1.5 contact takes UNSEEN of its depth; the depth is counted from the start.
    let [start, _, end, first, last, before, after, depth, peak, lasts] = f.findings;
    let (begins, ends, faint, hidden) = match f.family {
        // A dashpot pushes at once and lets go at once.
        Family::Stiffness { dashpot: true, .. } => {
            (DASHPOT[0] * lasts, (end - last).max(DASHPOT[1] * lasts), 1.0, [0.0; 2])
        }
        _ => {
            let unseen = |seen: f64, speed: f64| FREE_END * seen.max(UNSEEN * depth / speed.abs());
            (unseen(first - start, before), unseen(end - last, after), FREE_FAINT, HIDDEN)
        }
    };
    // One displacement that is off shifts where the body seems to touch and to let go, in opposite senses; the stiffness
    // makes up for half of what it does to the peak.
    let (touches, leaves) = (UNTOLD_PX / before.abs(), UNTOLD_PX / after.abs());
    let untold = match k {
        0 | 3 => touches,
        // From one end of the contact to the other.
        1 => (UNTOLD_PX / lasts).hypot(drift_px) / peak,
        2 | 4 => leaves,
        7 => UNTOLD_PX,
        8 => 0.5 * UNTOLD_PX * peak / depth,
        9 => touches + leaves,
        _ => 0.0,
    };
    let is_known = matches!(f.family, Family::KelvinVoigt | Family::HuntCrossley);
    let unknown = match k {
        _ if is_known => 0.0,
        0 => begins.hypot(hidden[0] * f.sigmas[0]),
        2 => ends,
        3 => (faint * begins).hypot(hidden[1] * f.sigmas[3]),
        4 => faint * ends,
        7 => before * begins,
        8 => FREE_PEAK * peak,
        // Both ends are off inwards or outwards together.
        9 => begins + ends,
        _ => 0.0,
    };
    own + unknown.powi(2) + untold.powi(2)
}

fn fit_all(guess: &FirstGuess, samples: &[Sample]) -> Vec<LawFit> {
    let from_guess = |family, n, m, ratio| {
        let (start, units) = guess.parameters(n, m, ratio);
        fit_law(family, &start, ANY, &units, samples).map(|fit| (fit, units))
    };
    let spring = from_guess(Family::KelvinVoigt, 1.0, 0.0, 1.57);
    let hertz = from_guess(Family::HuntCrossley, 1.5, 1.5, 1.47);
    let power = match &hertz {
        Some((fit, units)) => fit_law(Family::Power, &fit.parameters, ANY, units, samples).map(|fit| (fit, *units)),
        None => from_guess(Family::Power, 1.3, 1.3, 1.5),
    };
    let two = two_exponents(&spring, &power, samples);
    // The simpler law that comes nearer says how the force begins, which the positions hardly show: begun at two free
    // exponents, or at the other, the free stiffness may follow the same motion by a force that begins frames apart.
    let chi2 = |law: &Option<(LawFit, Units)>| law.as_ref().map_or(f64::INFINITY, |(fit, _)| fit.chi2);
    let near = if chi2(&hertz) < chi2(&spring) { &hertz } else { &spring };
    let near = near.as_ref().or(two.as_ref());
    let free = near.map_or_else(Vec::new, |near| free(near, samples));
    [spring, hertz, power, two].into_iter().flatten().map(|(fit, _)| fit).chain(free).collect()
}

/// Laws with their stiffness free, begun at a neighbour: of one degree after the other until the motion is followed, two
/// at least, so that what they disagree in is seen.
fn free((fit, units): &(LawFit, Units), samples: &[Sample]) -> Vec<LawFit> {
    // The factor is a polynomial over the stroke, so its unit is the depth reached.
    let (start, units) = rescale(&fit.parameters, units, fit.findings[7]);
    let dashpot = fit.family == Family::KelvinVoigt;
    let exponents = [[start[4], NEAR[0]], [start[5], NEAR[1]]];
    let mut fits: Vec<LawFit> = Vec::new();
    for degree in DEGREES {
        if fits.len() > 1 && fits.iter().any(|fit| passes(fit, 1.0)) {
            break;
        }
        fits.extend(fit_law(Family::Stiffness { degree, dashpot }, &start, exponents, &units, samples));
    }
    fits
}

/// The law with two free exponents, begun at the better of its two neighbours, and if that does not do, at the other.
fn two_exponents(
    spring: &Option<(LawFit, Units)>,
    power: &Option<(LawFit, Units)>,
    samples: &[Sample],
) -> Option<(LawFit, Units)> {
    let mut starts: Vec<(LawFit, Units)> = spring.iter().chain(power).cloned().collect();
    starts.sort_by(|a, b| a.0.chi2.total_cmp(&b.0.chi2));
    let mut best: Option<(LawFit, Units)> = None;
    for (near, units) in starts {
        if best.as_ref().is_some_and(|(fit, _)| passes(fit, 1.0)) {
            break;
        }
        let mut start = near.parameters;
        if near.family == Family::KelvinVoigt {
            start[5] = 0.1;
        }
        let fit = fit_law(Family::TwoExponents, &start, ANY, &units, samples);
        let better = fit.filter(|f| best.as_ref().is_none_or(|(b, _)| f.chi2 < b.chi2));
        best = better.map(|f| (f, units)).or(best);
    }
    best
}

/// The same law with another unit of depth.
fn rescale(p: &Parameters, units: &Units, depth: f64) -> (Parameters, Units) {
    let ratio = depth / units.depth;
    let mut out = *p;
    out[2] += p[4] * ratio.ln();
    out[3] *= ratio.powf(p[5] - p[4]);
    (out, Units { depth, ..*units })
}
