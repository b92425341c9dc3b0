//! The choice among contact laws, and the average over them.

use std::f64::consts::SQRT_2;

use super::contact_law::{ContactEstimates, Family, Findings, Parameters, Units};
use super::law_fit::{Expected, LawFit, fit_law};
use crate::numeric::Sample;
use crate::results::ForceLaw;

/// The maximum misfit of the freest law at which its times are still used, sigmas.
const CLOSE_SIGMAS: f64 = 3.0;

/// Share of the maximum depth at which the force of a y^1.5 contact passes 2 % of its peak: 0.02^(2/3).
const UNSEEN: f64 = 0.074;

/// Probability of a normal variable within one sigma.
const ONE_SIGMA: f64 = 0.682_7;

/// The uncertainty of start and end under free exponents or stiffness, as a share of the time in which the force is too
/// small to detect. This share and the following ones come from simulated stiffness ripples of 25 % of any length and
/// phase.
const FREE_END: f64 = 0.75;

/// The uncertainty of the moments of 2 % force, as a share of that of start and end.
const FREE_LEVEL: f64 = 0.4;

/// Additional errors of the start and of the moment of 2 % force under a free stiffness, in their own sigmas. The noise
/// masks the onset of the force from the free stiffness too.
const MASKED_ONSET: [f64; 2] = [1.0, 2.0];

/// The relative uncertainty of the peak force under a free stiffness.
const FREE_PEAK: f64 = 0.02;

/// The uncertainty of start and end with an independent dashpot, as shares of the contact.
const DASHPOT: [f64; 2] = [0.0025, 0.007];

/// The displacement error that no residual reveals, px: the remainder of interpolation and uneven illumination.
const RESIDUAL_PX: f64 = 0.0004;

/// The share of a step's random walk that has the same sign as its neighbours'. It was measured at the turning point of
/// rendered balls, the only moment known to a thousandth of a frame.
const DRIFT: f64 = 0.25;

/// The prior of the exponents of any contact; it includes springs, smooth bodies (3/2) and cones (2).
const ANY: [Expected; 2] = [[1.25, 0.25], [0.75, 0.75]];

/// The prior deviation of the exponents from those of the nearest simple law, where the stiffness absorbs the rest.
const NEAR: [f64; 2] = [0.05, 0.2];

/// The degrees of a free stiffness.
const DEGREES: [usize; 3] = [3, 5, 7];

/// The minimum variance ratio that is used where positions scatter about a law by less than their sigmas. About 200
/// positions determine the ratio to a tenth.
const MIN_SCATTER: f64 = 0.8;

/// Start values for the fits from the two straight flights. Frames, px, inwards positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InitialGuess {
    /// The deepest moment.
    pub deepest: f64,
    /// The distance by which the flight before, extrapolated, passes the deepest point.
    pub shortfall: f64,
    /// Speed before.
    pub speed: f64,
    /// Restitution.
    pub restitution: f64,
    /// Free fall into the surface, px/frame^2.
    pub gravity: f64,
}

/// The errors of the positions that their standard uncertainties do not contain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionErrors {
    /// The ratio of the flights' scatter to their sigmas.
    pub excess: f64,
    /// The error that neighbouring positions of the contact share, px.
    pub drift_px: f64,
}

impl PositionErrors {
    /// Returns the ratio of all errors to the sigmas of the positions.
    ///
    /// A law may follow a common error, so that this error limits how well positions distinguish laws.
    fn ratio(&self, samples: &[Sample]) -> f64 {
        let mean_sigma = samples.iter().map(|sample| sample.sigma).sum::<f64>() / samples.len().max(1) as f64;
        self.excess.hypot(self.drift_px / mean_sigma.max(f64::MIN_POSITIVE))
    }
}

/// The combined result of the laws that passed.
#[derive(Debug, Clone)]
pub struct ForceLawPosterior {
    /// The most probable law.
    pub best: Family,
    /// The probability of each law that passed; the sum is 1.
    pub probabilities: Vec<(Family, f64)>,
    /// The means over the laws, weighted by probability. Their standard uncertainties include the laws' own, the spread
    /// between the laws, the misfit, and, under free exponents or stiffness, the uncertainty of start and end.
    pub contact: ContactEstimates,
}

impl ForceLawPosterior {
    /// Returns the result with standard uncertainties multiplied by `factor`.
    #[must_use]
    pub fn widened(self, factor: f64) -> Self {
        Self { contact: self.contact.widened(factor), ..self }
    }

    /// Returns the name of the most probable law in the results.
    pub fn law(&self) -> ForceLaw {
        force_law(self.best)
    }

    /// Returns the probability of that name, 0 to 1.
    pub fn probability(&self) -> f64 {
        let same = self.probabilities.iter().filter(|(family, _)| force_law(*family) == self.law());
        same.map(|(_, probability)| probability).sum::<f64>().min(1.0)
    }
}

/// Returns the name of a family in the results.
fn force_law(family: Family) -> ForceLaw {
    match family {
        Family::KelvinVoigt => ForceLaw::KelvinVoigt,
        Family::HuntCrossley => ForceLaw::HuntCrossley,
        Family::Power | Family::TwoExponents => ForceLaw::PowerLaw,
        Family::Stiffness { .. } => ForceLaw::None,
    }
}

impl InitialGuess {
    /// Returns start parameters of a law with exponents `n` and `m`, and their units.
    ///
    /// `ratio` is the time to the deepest point over depth / speed: 1.57 for a spring, 1.47 for n = 3/2.
    fn start_parameters(&self, n: f64, m: f64, ratio: f64) -> (Parameters, Units) {
        let depth = self.shortfall / (ratio - 1.0);
        let units = Units { depth, speed: self.speed, gravity: self.gravity };
        let e = self.restitution.clamp(0.05, 1.0);
        let root_e = e.sqrt();
        // The energy at the deepest point is about v^2 e / 2; the damper takes the rest.
        let amplitude = 0.5 * (n + 1.0) * self.speed.powi(2) * root_e / depth;
        let damping = 1.5 * (1.0 - e) * if m > 0.5 { 1.0 } else { 0.4 };
        let start = self.deepest - ratio * depth / self.speed;
        ([start, self.speed, amplitude.ln(), damping, n, m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], units)
    }
}

/// Fits every family and weights them by their evidence in Laplace's approximation (Kass & Raftery 1995,
/// doi:10.1080/01621459.1995.10476572), which combines chi2 with the narrowing of each law's free parameters.
///
/// A law passes if chi2/freedom is at most r^2 (1 + 4 sqrt(2/freedom)), where r is the ratio of the errors to the sigmas
/// of the positions. Among the laws that pass, the evidence decides. If none passes, the law with free
/// stiffness is taken if its misfit is within three sigmas; the misfit then enters the uncertainties. Otherwise the
/// result is `None`.
pub fn select_law(guess: &InitialGuess, samples: &[Sample], errors: PositionErrors) -> Option<ForceLawPosterior> {
    let fits = fit_all(guess, samples);
    let excess = errors.ratio(samples);
    let mut passed: Vec<&LawFit> = fits.iter().filter(|f| is_acceptable(f, excess)).collect();
    if passed.is_empty() {
        // No law passes, but one with a free stiffness may follow the motion closely enough to yield times.
        let close = |f: &&LawFit| f.chi2 / f.freedom <= (CLOSE_SIGMAS * excess).powi(2);
        passed.extend(fits.iter().filter(|f| matches!(f.family, Family::Stiffness { .. })).filter(close));
    }
    let stiffnesses = fits.iter().filter(|f| matches!(f.family, Family::Stiffness { .. }));
    let min_narrowing = stiffnesses.map(|f| narrowing(f, excess)).fold(f64::INFINITY, f64::min);
    let criterion = |f: &LawFit| f.chi2 / excess.powi(2) + parameter_cost(f, min_narrowing, excess);
    let best = passed.iter().min_by(|a, b| criterion(a).total_cmp(&criterion(b)))?;
    let weights: Vec<f64> = passed.iter().map(|f| (0.5 * (criterion(best) - criterion(f))).exp()).collect();
    let total: f64 = weights.iter().sum();
    let weighed = || passed.iter().zip(&weights).map(|(f, w)| (*f, w / total));
    let findings: Findings = std::array::from_fn(|k| weighed().map(|(f, w)| w * f.findings[k]).sum());
    let common = CommonErrors {
        walk_px: DRIFT * samples.iter().map(|s| s.walk).sum::<f64>() / samples.len() as f64,
        residual_px: RESIDUAL_PX.hypot(errors.drift_px),
    };
    let sigmas: Findings = std::array::from_fn(|k| {
        let component = |(f, weight): (&LawFit, f64)| NormalComponent {
            weight,
            mean: f.findings[k] - findings[k],
            sigma: law_variance(f, k, common).sqrt(),
        };
        central_half_width(&weighed().map(component).collect::<Vec<_>>())
    });
    let probabilities = weighed().map(|(f, w)| (f.family, w)).collect();
    Some(ForceLawPosterior { best: best.family, probabilities, contact: ContactEstimates::new(&findings, &sigmas) })
}

/// Errors that neighbouring positions share, px.
#[derive(Debug, Clone, Copy)]
struct CommonErrors {
    /// The random walk per step.
    walk_px: f64,
    /// The displacement error that no residual reveals.
    residual_px: f64,
}

/// One of the normal distributions of a mixture.
#[derive(Debug, Clone, Copy)]
struct NormalComponent {
    weight: f64,
    mean: f64,
    sigma: f64,
}

impl NormalComponent {
    /// Returns its part of the mass within `half` of zero.
    fn mass_within(&self, half: f64) -> f64 {
        let below = |x: f64| 0.5 * libm::erfc(-x / (self.sigma.max(f64::MIN_POSITIVE) * SQRT_2));
        self.weight * (below(half - self.mean) - below(-half - self.mean))
    }
}

/// Returns half the width of the interval about zero that holds 68.3 % of a mixture of normal distributions.
///
/// The weights sum to 1. A law of small weight and large uncertainty would otherwise dominate the standard deviation.
fn central_half_width(mixture: &[NormalComponent]) -> f64 {
    let reach = mixture.iter().map(|law| law.mean.abs() + 4.0 * law.sigma).fold(0.0, f64::max);
    let (mut low, mut high) = (0.0, reach);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let mass: f64 = mixture.iter().map(|law| law.mass_within(middle)).sum();
        if mass < ONE_SIGMA { low = middle } else { high = middle }
    }
    high
}

/// Returns the cost of the free parameters of a law in units of chi2.
///
/// All laws are equally likely beforehand, because no real contact follows the known ones exactly, and a contact of few
/// frames hardly tests them. Fitted exponents constrain the onset of the force no better than a fitted stiffness, which
/// costs at least `min_narrowing`. Neither is therefore preferred for having fewer parameters.
fn parameter_cost(f: &LawFit, min_narrowing: f64, excess: f64) -> f64 {
    match f.family {
        Family::KelvinVoigt | Family::HuntCrossley => 0.0,
        Family::Power | Family::TwoExponents if min_narrowing.is_finite() => narrowing(f, excess).max(min_narrowing),
        _ => narrowing(f, excess),
    }
}

/// Returns the narrowing of a law's free parameters by positions whose errors are `excess` times their sigmas.
fn narrowing(f: &LawFit, excess: f64) -> f64 {
    let free = f.family.parameter_count() - 4;
    (f.narrowing - 2.0 * free as f64 * excess.ln()).max(0.0)
}

/// Whether a law explains the positions: chi2 per degree of freedom is at most `excess^2` (1 + 4 sqrt(2 / freedom)).
fn is_acceptable(f: &LawFit, excess: f64) -> bool {
    f.chi2 / f.freedom <= excess.powi(2) * (1.0 + 4.0 * (2.0 / f.freedom).sqrt())
}

/// Returns the variance of quantity `k` of [`Findings`] under one law, in the square of its unit.
///
/// It sums the variance of the fit, widened by the misfit, the undetected ends of the force under free exponents or
/// stiffness, and the displacement error that no residual reveals.
fn law_variance(f: &LawFit, k: usize, common: CommonErrors) -> f64 {
    let CommonErrors { walk_px, residual_px } = common;
    let own = f.sigmas[k].powi(2) * (f.chi2 / f.freedom).max(MIN_SCATTER);
    // Under free exponents or stiffness, start and end depend on the first and last two per cent of the force, which
    // are not observed. A y^1.5 contact takes UNSEEN of its depth over them; the depth is counted from the start.
    let [start, _, end, first, last, before, after, depth, peak, lasts] = f.findings;
    let (begins, ends, faint, hidden) = match f.family {
        // A dashpot pushes and releases at once.
        Family::Stiffness { dashpot: true, .. } => {
            (DASHPOT[0] * lasts, (end - last).max(DASHPOT[1] * lasts), 1.0, [0.0; 2])
        }
        _ => {
            let unseen = |seen: f64, speed: f64| FREE_END * seen.max(UNSEEN * depth / speed.abs());
            (unseen(first - start, before), unseen(end - last, after), FREE_LEVEL, MASKED_ONSET)
        }
    };
    // A wrong displacement shifts the apparent start and end in opposite senses. The stiffness compensates half of its
    // effect on the peak.
    let (touches, leaves) = (residual_px / before.abs(), residual_px / after.abs());
    let residual = match k {
        0 | 3 => touches,
        // From one end of the contact to the other.
        1 => (residual_px / lasts).hypot(walk_px) / peak,
        2 | 4 => leaves,
        7 => residual_px,
        8 => 0.5 * residual_px * peak / depth,
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
        // Both ends err inwards or outwards together.
        9 => begins + ends,
        _ => 0.0,
    };
    own + unknown.powi(2) + residual.powi(2)
}

/// Fits all families, simple ones first, each starting from a simpler neighbour.
fn fit_all(guess: &InitialGuess, samples: &[Sample]) -> Vec<LawFit> {
    let from_guess = |family, n, m, ratio| {
        let (start, units) = guess.start_parameters(n, m, ratio);
        fit_law(family, &start, ANY, &units, samples).map(|fit| (fit, units))
    };
    let spring = from_guess(Family::KelvinVoigt, 1.0, 0.0, 1.57);
    let hertz = from_guess(Family::HuntCrossley, 1.5, 1.5, 1.47);
    let power = match &hertz {
        Some((fit, units)) => fit_law(Family::Power, &fit.parameters, ANY, units, samples).map(|fit| (fit, *units)),
        None => from_guess(Family::Power, 1.3, 1.3, 1.5),
    };
    let two = fit_two_exponents(&spring, &power, samples);
    // The better of the simple laws fixes the onset of the force, which the positions hardly constrain. Starting from
    // two free exponents, or from the other law, the free stiffness may reach the same motion with a force that begins
    // frames apart.
    let chi2 = |law: &Option<(LawFit, Units)>| law.as_ref().map_or(f64::INFINITY, |(fit, _)| fit.chi2);
    let [near, far] = if chi2(&hertz) < chi2(&spring) { [&hertz, &spring] } else { [&spring, &hertz] };
    let near = near.as_ref().or(two.as_ref());
    let mut free = near.map_or_else(Vec::new, |near| fit_free_stiffness(near, samples));
    // Where no simple law passes, neither does the onset of the nearest: the other law's counts as well.
    let is_simple = [&spring, &hertz, &power, &two].into_iter().flatten().any(|(fit, _)| is_acceptable(fit, 1.0));
    if !is_simple && let Some(far) = far {
        free.extend(fit_free_stiffness(far, samples));
    }
    [spring, hertz, power, two].into_iter().flatten().map(|(fit, _)| fit).chain(free).collect()
}

/// Fits laws with a free stiffness, starting from a neighbour.
///
/// The degree rises until the motion is followed. At least two degrees are fitted, so that their disagreement is
/// visible.
fn fit_free_stiffness(neighbour: &(LawFit, Units), samples: &[Sample]) -> Vec<LawFit> {
    let (fit, units) = neighbour;
    // The factor is a polynomial over the stroke, so its unit is the depth reached.
    let (start, units) = change_depth_unit(&fit.parameters, units, fit.findings[7]);
    let dashpot = fit.family == Family::KelvinVoigt;
    let exponents = [[start[4], NEAR[0]], [start[5], NEAR[1]]];
    let mut fits: Vec<LawFit> = Vec::new();
    for degree in DEGREES {
        if fits.len() > 1 && fits.iter().any(|fit| is_acceptable(fit, 1.0)) {
            break;
        }
        fits.extend(fit_law(Family::Stiffness { degree, dashpot }, &start, exponents, &units, samples));
    }
    fits
}

/// Fits the law with two free exponents, starting from the better of its two neighbours.
///
/// Starts from the other one if that fails.
fn fit_two_exponents(
    spring: &Option<(LawFit, Units)>,
    power: &Option<(LawFit, Units)>,
    samples: &[Sample],
) -> Option<(LawFit, Units)> {
    let mut starts: Vec<(LawFit, Units)> = spring.iter().chain(power).cloned().collect();
    starts.sort_by(|a, b| a.0.chi2.total_cmp(&b.0.chi2));
    let mut best: Option<(LawFit, Units)> = None;
    for (near, units) in starts {
        if best.as_ref().is_some_and(|(fit, _)| is_acceptable(fit, 1.0)) {
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

/// Returns the same law with `depth` (px) as its unit of depth.
fn change_depth_unit(p: &Parameters, units: &Units, depth: f64) -> (Parameters, Units) {
    let ratio = depth / units.depth;
    let mut out = *p;
    out[2] += p[4] * ratio.ln();
    out[3] *= ratio.powf(p[5] - p[4]);
    (out, Units { depth, ..*units })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::Xorshift;
    use crate::results::Estimate;

    /// The contact of a ball at 3.2 px per frame: a spring that is softer by half as soon as the velocity reverses.
    const SPEED: f64 = 3.2;
    const START: f64 = 22.7;
    const COMPRESSION: f64 = 2.2;
    const RELEASE: f64 = 3.1;

    /// Returns the maximum depth, px.
    fn depth_px() -> f64 {
        SPEED * COMPRESSION * std::f64::consts::FRAC_2_PI
    }

    /// Returns the depth of the ball, px; negative outside the surface.
    fn position_px(time: f64) -> f64 {
        let quarter = std::f64::consts::FRAC_PI_2;
        let since = time - START;
        if since < 0.0 {
            SPEED * since
        } else if since < COMPRESSION {
            depth_px() * (quarter * since / COMPRESSION).sin()
        } else if since < COMPRESSION + RELEASE {
            depth_px() * (quarter * (since - COMPRESSION) / RELEASE).cos()
        } else {
            -depth_px() * quarter * (since - COMPRESSION - RELEASE) / RELEASE
        }
    }

    /// Returns the worst error of start, end, depth and duration, in their uncertainties. `shift_px` moves each position.
    fn worst_pull(shift_px: impl FnMut(f64) -> f64, sigma: f64, errors: PositionErrors) -> f64 {
        let guess = InitialGuess {
            deepest: 25.0,
            shortfall: SPEED * COMPRESSION - depth_px(),
            speed: SPEED,
            restitution: COMPRESSION / RELEASE,
            gravity: 0.0,
        };
        let mut shift_px = shift_px;
        let at = |frame: u32| {
            let time_frames = f64::from(frame);
            let value = shift_px(time_frames) - position_px(time_frames);
            Sample { time_frames, component: 0, value, sigma, walk: 0.0 }
        };
        let posterior = select_law(&guess, &(5..42).map(at).collect::<Vec<_>>(), errors).unwrap();
        let ContactEstimates { start, end, depth_max, duration, .. } = posterior.contact;
        let pull = |(found, exact): (Estimate, f64)| (found.value - exact).abs() / found.sigma;
        let pairs = [
            (start, START),
            (end, START + COMPRESSION + RELEASE),
            (depth_max, depth_px()),
            (duration, COMPRESSION + RELEASE),
        ];
        pairs.into_iter().map(pull).fold(0.0, f64::max)
    }

    #[test]
    fn a_short_contact_that_follows_no_law_lies_within_its_uncertainties() {
        let mut random = Xorshift::default();
        for case in 0..12 {
            let sigma = 0.03 + 0.005 * f64::from(case);
            let noise = |_| sigma * ((0..12).map(|_| random.below(1000) as f64 / 1000.0).sum::<f64>() - 6.0);
            let worst = worst_pull(noise, sigma, PositionErrors { excess: 1.0, drift_px: 0.0 });
            assert!(worst < 3.0, "{case}: {worst} sigmas");
        }
    }

    #[test]
    fn a_drift_during_a_short_contact_lies_within_its_uncertainties() {
        // A fit that takes the positions for independent follows the drift, and is off by up to 3 sigmas.
        for per_frame_px in [-0.06, -0.03, 0.015, 0.04, 0.06] {
            let drift = |time: f64| per_frame_px * (time - START).clamp(0.0, COMPRESSION + RELEASE);
            let drift_px = 1.5 * f64::abs(per_frame_px);
            let worst = worst_pull(drift, 0.005, PositionErrors { excess: 1.0, drift_px });
            assert!(worst < 1.5, "{per_frame_px}: {worst} sigmas");
        }
    }
}
