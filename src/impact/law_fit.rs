//! Least-squares fit of a contact law to positions.

use nalgebra::{DMatrix, DVector};

use super::contact_law::{Family, Findings, Parameters, SETS, Units};
use super::law_motion::LawMotions;
use crate::numeric::Sample;

/// The maximum number of iterations of one fit.
const MAX_ITERATIONS: usize = 60;
/// The number of iterations after which only a large gain justifies another.
const USUAL_ITERATIONS: usize = 15;
/// A large gain of chi2 per iteration.
const LARGE_GAIN: f64 = 0.5;
/// The gain of chi2 below which a fit has converged: for a law with few parameters, and for one with many, whose
/// parameters are nearly degenerate.
const SETTLED: [f64; 2] = [1e-3, 1e-2];
/// The misfit at which a law is given up, sigmas, where chi2 falls by no more than [`HOPELESS_GAIN`] per iteration.
const HOPELESS_SIGMAS: f64 = 10.0;
const HOPELESS_GAIN: f64 = 0.02;
/// The expected size of the stiffness factor's coefficients; finer ripples are smaller.
const RIPPLES: [f64; 7] = [0.3, 0.2, 0.2, 0.1, 0.1, 0.05, 0.05];
/// The expected value and spread of an exponent.
pub type Expected = [f64; 2];
/// The bounds of both exponents.
const EXPONENTS: (f64, f64) = (0.0, 4.0);

/// A law fitted to one contact.
#[derive(Debug, Clone)]
pub struct LawFit {
    /// The family.
    pub family: Family,
    /// Its fitted parameters.
    pub parameters: Parameters,
    /// Sum of squared residuals (and priors) in sigmas.
    pub chi2: f64,
    /// Degrees of freedom.
    pub freedom: f64,
    /// The Occam factor of the free exponents and stiffness, in Laplace's approximation of the evidence: twice the
    /// logarithm of how much the positions narrow the prior.
    pub narrowing: f64,
    /// The predicted quantities.
    pub findings: Findings,
    /// Their propagated standard uncertainties, with the samples' sigmas and walks as given.
    pub sigmas: Findings,
}

/// Positions grouped by component, so that each component's mean can be removed.
pub(super) struct Data<'a> {
    samples: &'a [Sample],
    /// Index of each sample's component and each component's total weight.
    group: Vec<usize>,
    weight: Vec<f64>,
}

impl<'a> Data<'a> {
    /// Groups samples by their component.
    pub(super) fn new(samples: &'a [Sample]) -> Self {
        let mut ids: Vec<u32> = Vec::new();
        let mut weight: Vec<f64> = Vec::new();
        let mut group = Vec::with_capacity(samples.len());
        for s in samples {
            let i = ids.iter().position(|id| *id == s.component).unwrap_or_else(|| {
                ids.push(s.component);
                weight.push(0.0);
                ids.len() - 1
            });
            weight[i] += s.sigma.powi(-2);
            group.push(i);
        }
        Self { samples, group, weight }
    }

    /// Returns values of the samples relative to the weighted mean of their component, in sigmas.
    pub(super) fn whiten(&self, mut values: Vec<f64>) -> Vec<f64> {
        let mut mean = vec![0.0; self.weight.len()];
        for (i, s) in self.samples.iter().enumerate() {
            mean[self.group[i]] += values[i] * s.sigma.powi(-2) / self.weight[self.group[i]];
        }
        for (i, s) in self.samples.iter().enumerate() {
            values[i] = (values[i] - mean[self.group[i]]) / s.sigma;
        }
        values
    }
}

impl Data<'_> {
    /// Returns the variance of a weighted sum of the whitened values that results from the random walk of the steps.
    fn walk_variance(&self, weights: &DVector<f64>) -> f64 {
        let mut later = vec![0.0; self.weight.len()];
        let mut variance = 0.0;
        for (i, sample) in self.samples.iter().enumerate().rev() {
            later[self.group[i]] += weights[i] / sample.sigma;
            variance += (sample.walk * later[self.group[i]]).powi(2);
        }
        variance
    }
}

/// The motion for one set of parameters: depths at the samples and predicted quantities.
struct Outcome {
    depths: Vec<f64>,
    findings: Findings,
    /// `None` where neither one-sided difference yields a motion.
    slopes: Option<Slopes>,
}

/// Derivatives of residuals and predicted quantities by each parameter.
struct Slopes {
    jacobian: DMatrix<f64>,
    gradients: DMatrix<f64>,
}

/// The motions for one set of parameters and for that set with one parameter changed at a time.
struct Motions {
    /// The depths of each set at the samples.
    depths: Vec<Vec<f64>>,
    findings: Vec<Findings>,
    /// Whether the set is physical and the body rebounds.
    sound: Vec<bool>,
}

struct Problem<'a> {
    family: Family,
    /// The prior of the spring's and the damping's exponent, for those that are free.
    exponents: [Expected; 2],
    units: Units,
    data: Data<'a>,
}

impl Problem<'_> {
    /// Computes the motion and its derivatives; `None` if the law is not physical or the body does not rebound.
    ///
    /// The differences are forward, or backward where a forward step yields no motion.
    fn evaluate(&self, p: &Parameters) -> Option<Outcome> {
        let p = self.family.complete(p);
        let mut steps: Vec<f64> = (0..self.family.parameter_count()).map(|k| self.difference_step(k)).collect();
        let mut motions =
            self.is_physical(&p).then(|| self.integrate_motions(&p, &steps)).filter(|motions| motions.sound[0])?;
        let is_sound = |motions: &Motions, k: usize| motions.sound[k + 1];
        if !(0..steps.len()).all(|k| is_sound(&motions, k)) {
            (0..steps.len()).filter(|k| !is_sound(&motions, *k)).for_each(|k| steps[k] = -steps[k]);
            motions = self.integrate_motions(&p, &steps);
        }
        let slopes = (0..steps.len()).all(|k| is_sound(&motions, k)).then(|| self.differentiate(&motions, &steps));
        Some(Outcome { depths: motions.depths.swap_remove(0), findings: motions.findings[0], slopes })
    }

    /// Whether the law is physical with these parameters.
    fn is_physical(&self, p: &Parameters) -> bool {
        let exponents = p[4..6].iter().all(|n| (EXPONENTS.0..=EXPONENTS.1).contains(n));
        exponents && p[1] > 0.0 && p.iter().all(|x| x.is_finite())
    }

    /// Computes the motion at `p`, and with each of its parameters changed by a step.
    fn integrate_motions(&self, p: &Parameters, steps: &[f64]) -> Motions {
        let (mut sets, mut sound) = (vec![*p], vec![true]);
        for (k, step) in steps.iter().enumerate() {
            let mut moved = *p;
            moved[k] += step;
            let moved = self.family.complete(&moved);
            sound.push(self.is_physical(&moved));
            sets.push(if sound[k + 1] { moved } else { *p });
        }
        let (mut depths, mut findings) = (Vec::new(), Vec::new());
        for (sets, sound) in sets.chunks(SETS).zip(sound.chunks_mut(SETS)) {
            let motions = LawMotions::new(self.family, sets, &self.units);
            sound.iter_mut().enumerate().for_each(|(set, sound)| *sound &= motions.rebounds(set));
            let starts: [f64; SETS] = std::array::from_fn(|set| sets[set.min(sets.len() - 1)][0]);
            findings.extend(motions.findings(&starts));
            let samples = self.data.samples.iter();
            let rows: Vec<_> = samples.map(|s| motions.depths(&starts.map(|start| s.time_frames - start))).collect();
            depths.extend((0..SETS).map(|set| rows.iter().map(|row| row[set]).collect()));
        }
        Motions { depths, findings, sound }
    }

    /// Returns the residuals of the positions in sigmas, followed by those of the priors.
    fn residuals(&self, p: &Parameters, outcome: &Outcome) -> DVector<f64> {
        // The depth grows against the normal, so position plus depth is constant.
        let sum = self.data.samples.iter().zip(&outcome.depths).map(|(s, d)| s.value + d).collect();
        let mut rows = self.data.whiten(sum);
        rows.extend((4..self.family.parameter_count()).map(|k| {
            let [mean, size] = self.prior(k);
            (p[k] - mean) / size
        }));
        DVector::from_vec(rows)
    }

    /// Returns the expected value and spread of a free parameter after the fourth.
    ///
    /// The first per cent of a force constrain its exponent and its onset only jointly.
    fn prior(&self, parameter: usize) -> Expected {
        match parameter {
            4 | 5 => self.exponents[parameter - 4],
            _ => [0.0, RIPPLES[parameter - 6]],
        }
    }

    /// Returns the step of a parameter for its finite difference, in units of the parameter.
    fn difference_step(&self, parameter: usize) -> f64 {
        match parameter {
            0 => 1e-5 * self.units.depth / self.units.speed,
            1 => 1e-6 * self.units.speed,
            _ => 1e-6,
        }
    }

    /// Returns the difference quotients of residuals and predicted quantities over the steps.
    fn differentiate(&self, motions: &Motions, steps: &[f64]) -> Slopes {
        let (samples, count) = (self.data.samples.len(), steps.len());
        let mut jacobian = DMatrix::zeros(samples + count - 4, count);
        let mut gradients = DMatrix::zeros(motions.findings[0].len(), count);
        for (k, h) in steps.iter().enumerate() {
            let change =
                motions.depths[k + 1].iter().zip(&motions.depths[0]).map(|(moved, own)| (moved - own) / h).collect();
            for (i, x) in self.data.whiten(change).into_iter().enumerate() {
                jacobian[(i, k)] = x;
            }
            if k >= 4 {
                jacobian[(samples + k - 4, k)] = 1.0 / self.prior(k)[1];
            }
            for (i, (a, b)) in motions.findings[k + 1].iter().zip(&motions.findings[0]).enumerate() {
                gradients[(i, k)] = (a - b) / h;
            }
        }
        Slopes { jacobian, gradients }
    }

    /// Minimises the sum of squared residuals by the Levenberg-Marquardt method.
    ///
    /// `None` where a motion or its derivatives do not exist. D. W. Marquardt, J. Soc. Ind. Appl. Math. 11 (1963)
    /// 431, <https://doi.org/10.1137/0111030>.
    fn minimize(&self, start: &Parameters) -> Option<LawFit> {
        let mut p = self.family.complete(start);
        let mut outcome = self.evaluate(&p)?;
        let mut residuals = self.residuals(&p, &outcome);
        let mut damping = 1e-3;
        for iteration in 0..MAX_ITERATIONS {
            let Slopes { jacobian, .. } = outcome.slopes.as_ref()?;
            let normal = jacobian.tr_mul(jacobian);
            let right = jacobian.tr_mul(&residuals);
            let before = residuals.norm_squared();
            let mut fell = 0.0;
            while damping < 1e8 {
                let mut damped = normal.clone();
                for k in 0..damped.nrows() {
                    damped[(k, k)] += damping * normal[(k, k)] + 1e-300;
                }
                let trial = damped.cholesky().map(|c| c.solve(&right)).and_then(|change| {
                    let mut moved = p;
                    change.iter().enumerate().for_each(|(k, x)| moved[k] -= x);
                    let moved = self.family.complete(&moved);
                    let outcome = self.evaluate(&moved)?;
                    Some((moved, self.residuals(&moved, &outcome), outcome))
                });
                match trial {
                    Some((moved, r, o)) if r.norm_squared() <= before => {
                        fell = before - r.norm_squared();
                        (p, residuals, outcome) = (moved, r, o);
                        damping *= 0.1;
                        break;
                    }
                    _ => damping *= 10.0,
                }
            }
            let settled = SETTLED[usize::from(self.family.parameter_count() > 5)];
            let is_settled = fell < if iteration < USUAL_ITERATIONS { settled } else { LARGE_GAIN };
            let is_hopeless = before > HOPELESS_SIGMAS.powi(2) * self.data.samples.len() as f64;
            if is_settled || (is_hopeless && fell < HOPELESS_GAIN * before) {
                break;
            }
            damping = damping.max(1e-9);
        }
        self.finish(&p, &outcome, residuals.norm_squared())
    }

    /// Returns the fit with propagated uncertainties; `None` where the positions do not determine the parameters.
    fn finish(&self, p: &Parameters, outcome: &Outcome, chi2: f64) -> Option<LawFit> {
        let Slopes { jacobian, gradients } = outcome.slopes.as_ref()?;
        let normal = jacobian.tr_mul(jacobian);
        // Parameters are scaled by their own effect, so that the inverse is well conditioned.
        let scale = DVector::from_fn(normal.nrows(), |k, _| normal[(k, k)].powf(-0.5));
        if scale.iter().any(|s| !s.is_finite()) {
            return None;
        }
        let scaled = DMatrix::from_fn(normal.nrows(), normal.nrows(), |i, j| normal[(i, j)] * scale[i] * scale[j]);
        let inverse = scaled.cholesky()?.inverse();
        let narrowing = self.narrowing(&inverse, &scale)?;
        let mut sigmas = outcome.findings;
        for (i, sigma) in sigmas.iter_mut().enumerate() {
            let row = DVector::from_fn(normal.nrows(), |k, _| gradients[(i, k)] * scale[k]);
            let weights = &inverse * &row;
            let per_row = DVector::from_fn(normal.nrows(), |k, _| weights[k] * scale[k]);
            *sigma = (row.dot(&weights).max(0.0) + self.data.walk_variance(&(jacobian * per_row))).sqrt();
        }
        let rows = jacobian.nrows() as f64;
        let freedom = rows - self.data.weight.len() as f64 - self.family.parameter_count() as f64;
        let sound = freedom > 0.0 && sigmas.iter().chain(&outcome.findings).all(|x| x.is_finite());
        sound.then_some(LawFit {
            family: self.family,
            parameters: *p,
            chi2,
            freedom,
            narrowing,
            findings: outcome.findings,
            sigmas,
        })
    }
}

impl Problem<'_> {
    /// Computes [`LawFit::narrowing`] from the covariance of all parameters, divided by `scale` on both sides.
    ///
    /// `None` if the covariance is not positive definite.
    fn narrowing(&self, inverse: &DMatrix<f64>, scale: &DVector<f64>) -> Option<f64> {
        let free = self.family.parameter_count() - 4;
        if free == 0 {
            return Some(0.0);
        }
        let relative_scale = |k: usize| scale[k + 4] / self.prior(k + 4)[1];
        let narrowed =
            DMatrix::from_fn(free, free, |i, j| inverse[(i + 4, j + 4)] * relative_scale(i) * relative_scale(j));
        Some(-2.0 * narrowed.cholesky()?.l_dirty().diagonal().map(f64::ln).sum())
    }
}

/// Fits one family of laws to positions along the outward normal (px), starting at `start`.
///
/// The free exponents are expected near `exponents`. `None` where the fit does not converge to a contact that ends,
/// or the positions do not determine it.
pub fn fit_law(
    family: Family,
    start: &Parameters,
    exponents: [Expected; 2],
    units: &Units,
    samples: &[Sample],
) -> Option<LawFit> {
    Problem { family, exponents, units: *units, data: Data::new(samples) }.minimize(start)
}
