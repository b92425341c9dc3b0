//! Least-squares fit of a contact law to positions.

use nalgebra::{DMatrix, DVector};

use super::contact_law::{Family, Findings, MOST_PARAMETERS, Parameters, Units};
use super::law_motion::Passages;
use crate::numeric::Sample;

/// Most rounds of one fit.
const ROUNDS: usize = 60;
/// After so many only a large gain justifies another.
const USUAL_ROUNDS: usize = 15;
/// A large gain of chi2.
const LARGE_GAIN: f64 = 0.5;
/// Converged: chi2 falls by less, a law with few parameters and one with many (its parameters replace each other).
const SETTLED: [f64; 2] = [1e-3, 1e-2];
/// A law that misses by so many sigmas, and comes nearer by no more than this share of chi2 a round, is none of this contact.
const HOPELESS_SIGMAS: f64 = 10.0;
const HOPELESS_GAIN: f64 = 0.02;
/// Expected size of the stiffness factor's coefficients: the finer a ripple, the smaller.
const RIPPLES: [f64; 7] = [0.3, 0.2, 0.2, 0.1, 0.1, 0.05, 0.05];
/// An exponent that is expected to be about so much, give or take so much.
pub type Expected = [f64; 2];
/// Bounds of both exponents.
const EXPONENTS: (f64, f64) = (0.0, 4.0);

/// Sets of parameters that are followed side by side, of laws that have few and of those that have many: vectors hold
/// eight numbers at most.
const FEW: usize = 8;
const MANY: usize = 16;
const _: () = assert!(MOST_PARAMETERS < MANY);

/// A law fitted to one contact.
#[derive(Debug, Clone)]
pub struct LawFit {
    /// Which.
    pub family: Family,
    /// Its parameters.
    pub parameters: Parameters,
    /// Sum of squared residuals (and priors) in sigmas.
    pub chi2: f64,
    /// Degrees of freedom.
    pub freedom: f64,
    /// What its free exponents and stiffness cost: twice the logarithm of how much the positions narrow down what was
    /// expected of them (the Occam factor of Laplace's approximation of the evidence).
    pub narrowing: f64,
    /// What it says.
    pub findings: Findings,
    /// Standard uncertainties of that, by propagation, the samples' sigmas and walks taken as they are.
    pub sigmas: Findings,
}

/// Positions grouped by component, for taking them about their means.
pub(super) struct Data<'a> {
    samples: &'a [Sample],
    /// Index of each sample's component and each component's total weight.
    group: Vec<usize>,
    weight: Vec<f64>,
}

impl<'a> Data<'a> {
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

    /// Values about their component's mean, in sigmas.
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
    /// Variance of a number that is a sum of the whitened values with these weights, from what each step adds to all
    /// positions after it.
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

/// The motion at one set of parameters: depths at the samples and findings.
struct Outcome {
    depths: Vec<f64>,
    findings: Findings,
    /// `None` where the motion cannot be told on either side.
    slopes: Option<Slopes>,
}

/// How residuals and findings change with each parameter.
struct Slopes {
    jacobian: DMatrix<f64>,
    gradients: DMatrix<f64>,
}

/// The motions at some parameters, and at those moved in one of them each.
struct Motions {
    /// At each sample.
    depths: Vec<[f64; MANY]>,
    findings: Vec<Findings>,
    /// Which of them the law allows and come back.
    sound: Vec<bool>,
}

struct Problem<'a> {
    family: Family,
    /// Of spring and damping, for those that are free.
    exponents: [Expected; 2],
    units: Units,
    data: Data<'a>,
}

impl Problem<'_> {
    /// The motion at these parameters, with its slopes by forward differences, or backward where that leads to no motion.
    fn outcome(&self, p: &Parameters) -> Option<Outcome> {
        let p = self.family.complete(p);
        let mut steps: Vec<f64> = (0..self.family.count()).map(|k| self.step_of(k)).collect();
        let mut motions = self.allows(&p).then(|| self.motions(&p, &steps)).filter(|motions| motions.sound[0])?;
        let is_sound = |motions: &Motions, k: usize| motions.sound[k + 1];
        if !(0..steps.len()).all(|k| is_sound(&motions, k)) {
            (0..steps.len()).filter(|k| !is_sound(&motions, *k)).for_each(|k| steps[k] = -steps[k]);
            motions = self.motions(&p, &steps);
        }
        let slopes = (0..steps.len()).all(|k| is_sound(&motions, k)).then(|| self.slopes(&motions, &steps));
        let depths = motions.depths.iter().map(|row| row[0]).collect();
        Some(Outcome { depths, findings: motions.findings[0], slopes })
    }

    /// Whether the law makes sense with these parameters.
    fn allows(&self, p: &Parameters) -> bool {
        let exponents = p[4..6].iter().all(|n| (EXPONENTS.0..=EXPONENTS.1).contains(n));
        exponents && p[1] > 0.0 && p.iter().all(|x| x.is_finite())
    }

    /// The motion at `p`, and with each of its parameters moved by a step.
    fn motions(&self, p: &Parameters, steps: &[f64]) -> Motions {
        let (mut sets, mut sound) = (vec![*p], vec![true]);
        for (k, step) in steps.iter().enumerate() {
            let mut moved = *p;
            moved[k] += step;
            let moved = self.family.complete(&moved);
            sound.push(self.allows(&moved));
            sets.push(if sound[k + 1] { moved } else { *p });
        }
        let mut motions = Motions { depths: Vec::new(), findings: Vec::new(), sound };
        match sets.len() <= FEW {
            true => self.follow::<FEW>(&sets, &mut motions),
            false => self.follow::<MANY>(&sets, &mut motions),
        }
        motions
    }

    fn follow<const SETS: usize>(&self, sets: &[Parameters], motions: &mut Motions) {
        let passages = Passages::<SETS>::new(self.family, sets, &self.units);
        motions.sound.iter_mut().enumerate().for_each(|(set, sound)| *sound &= passages.comes_back(set));
        let starts: [f64; SETS] = std::array::from_fn(|set| sets[set.min(sets.len() - 1)][0]);
        motions.findings.extend(passages.findings(&starts));
        motions.depths.extend(self.data.samples.iter().map(|s| {
            let mut row = [0.0; MANY];
            row[..SETS].copy_from_slice(&passages.depths(&starts.map(|start| s.time_frames - start)));
            row
        }));
    }

    /// Residuals in sigmas, the priors behind.
    fn residuals(&self, p: &Parameters, outcome: &Outcome) -> DVector<f64> {
        // The depth grows against the normal, so position plus depth is constant.
        let sum = self.data.samples.iter().zip(&outcome.depths).map(|(s, d)| s.value + d).collect();
        let mut rows = self.data.whiten(sum);
        rows.extend((4..self.family.count()).map(|k| {
            let [mean, size] = self.expected(k);
            (p[k] - mean) / size
        }));
        DVector::from_vec(rows)
    }

    /// What a free parameter behind the fourth is expected to be: the first percents of a force show too little to tell
    /// its exponent and its beginning apart.
    fn expected(&self, parameter: usize) -> Expected {
        match parameter {
            4 | 5 => self.exponents[parameter - 4],
            _ => [0.0, RIPPLES[parameter - 6]],
        }
    }

    fn step_of(&self, parameter: usize) -> f64 {
        match parameter {
            0 => 1e-5 * self.units.depth / self.units.speed,
            1 => 1e-6 * self.units.speed,
            _ => 1e-6,
        }
    }

    /// Differences of the motions over the steps.
    fn slopes(&self, motions: &Motions, steps: &[f64]) -> Slopes {
        let (samples, count) = (self.data.samples.len(), steps.len());
        let mut jacobian = DMatrix::zeros(samples + count - 4, count);
        let mut gradients = DMatrix::zeros(motions.findings[0].len(), count);
        for (k, h) in steps.iter().enumerate() {
            let change = motions.depths.iter().map(|row| (row[k + 1] - row[0]) / h).collect();
            for (i, x) in self.data.whiten(change).into_iter().enumerate() {
                jacobian[(i, k)] = x;
            }
            if k >= 4 {
                jacobian[(samples + k - 4, k)] = 1.0 / self.expected(k)[1];
            }
            for (i, (a, b)) in motions.findings[k + 1].iter().zip(&motions.findings[0]).enumerate() {
                gradients[(i, k)] = (a - b) / h;
            }
        }
        Slopes { jacobian, gradients }
    }

    /// Levenberg-Marquardt (Marquardt 1963, doi:10.1137/0111030).
    fn solve(&self, start: &Parameters) -> Option<LawFit> {
        let mut p = self.family.complete(start);
        let mut outcome = self.outcome(&p)?;
        let mut residuals = self.residuals(&p, &outcome);
        let mut damping = 1e-3;
        for round in 0..ROUNDS {
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
                    let outcome = self.outcome(&moved)?;
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
            let settled = SETTLED[usize::from(self.family.count() > 5)];
            let is_settled = fell < if round < USUAL_ROUNDS { settled } else { LARGE_GAIN };
            let is_hopeless = before > HOPELESS_SIGMAS.powi(2) * self.data.samples.len() as f64;
            if is_settled || (is_hopeless && fell < HOPELESS_GAIN * before) {
                break;
            }
            damping = damping.max(1e-9);
        }
        self.conclude(&p, &outcome, residuals.norm_squared())
    }

    fn conclude(&self, p: &Parameters, outcome: &Outcome, chi2: f64) -> Option<LawFit> {
        let Slopes { jacobian, gradients } = outcome.slopes.as_ref()?;
        let normal = jacobian.tr_mul(jacobian);
        // Parameters on the scale of their own effect, so that the inverse is well conditioned.
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
        let freedom = rows - self.data.weight.len() as f64 - self.family.count() as f64;
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
    /// See [`LawFit::narrowing`]; from the covariance of all parameters over `scale` on both sides.
    fn narrowing(&self, inverse: &DMatrix<f64>, scale: &DVector<f64>) -> Option<f64> {
        let free = self.family.count() - 4;
        if free == 0 {
            return Some(0.0);
        }
        let of = |k: usize| scale[k + 4] / self.expected(k + 4)[1];
        let narrowed = DMatrix::from_fn(free, free, |i, j| inverse[(i + 4, j + 4)] * of(i) * of(j));
        Some(-2.0 * narrowed.cholesky()?.l_dirty().diagonal().map(f64::ln).sum())
    }
}

/// Fits one family to positions along the outward normal, from `start`, the free ones of its exponents being expected
/// near `exponents`. `None` where it does not converge to a contact that ends, or the positions do not determine it.
pub fn fit_law(
    family: Family,
    start: &Parameters,
    exponents: [Expected; 2],
    units: &Units,
    samples: &[Sample],
) -> Option<LawFit> {
    Problem { family, exponents, units: *units, data: Data::new(samples) }.solve(start)
}
