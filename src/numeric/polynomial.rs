//! Weighted polynomial fits through positions that share unknown offsets.

use nalgebra::{SMatrix, SVector};

use crate::results::Estimate;

/// The maximum order of a [`Polynomial`].
pub const MAX_ORDER: usize = 5;

type Matrix = SMatrix<f64, MAX_ORDER, MAX_ORDER>;
type Vector = SVector<f64, MAX_ORDER>;

/// The minimum length of a column that is independent of the others, in units of its own length.
const SINGULAR: f64 = 1e-7;

/// One position in time. Samples of one component share an unknown offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time, nominal frame periods.
    pub time_frames: f64,
    /// The component, whose samples share one offset.
    pub component: u32,
    /// The position, px or deg.
    pub value: f64,
    /// Its white standard uncertainty, same unit as `value`.
    pub sigma: f64,
    /// The random walk of the step to this sample: its standard uncertainty stays in all later samples of the
    /// component. Same unit.
    pub walk: f64,
}

/// Weighted means over the samples of one component.
#[derive(Debug, Clone, Copy)]
struct Component {
    id: u32,
    weight: f64,
    value: f64,
    powers: Vector,
}

/// One sample in a fit of this order.
struct Row<const ORDER: usize> {
    /// The index of its component.
    place: usize,
    /// The powers 1 to the order of its time; once the means are known, less those of its component.
    lever: SVector<f64, ORDER>,
    weight: f64,
    /// The displacement by the known acceleration.
    known_part: f64,
}

/// The curve `value = offset(component) + sum of c_k (t - at)^k + acceleration (t - at)^2 / 2`, k from 1 to the order.
///
/// The offsets are eliminated by removing each component's weighted mean. This is the exact least-squares solution, and
/// only the shared coefficients remain.
#[derive(Debug, Clone)]
pub struct Polynomial {
    at_frames: f64,
    unit_frames: f64,
    acceleration: f64,
    /// The number of coefficients that are not 0.
    order: usize,
    coefficients: Vector,
    covariance: Matrix,
    components: Vec<Component>,
    chi2: f64,
    freedom: usize,
}

impl Polynomial {
    /// Fits a polynomial of `order` (1 to [`MAX_ORDER`]) about `at_frames` with a known `acceleration` (per frame^2).
    ///
    /// Each sample is weighted with `sigma`^-2. `acceleration` is kept as it is; the fitted coefficients come on top.
    ///
    /// Returns `None` where the samples do not determine it: fewer than `order` differences within components, or
    /// coinciding times.
    ///
    /// # Panics
    ///
    /// If `order` is out of range.
    pub fn fit(samples: &[Sample], at_frames: f64, order: usize, acceleration: f64) -> Option<Self> {
        assert!((1..=MAX_ORDER).contains(&order), "order {order} is not within 1 to {MAX_ORDER}");
        let far = |s: &Sample| (s.time_frames - at_frames).abs();
        let unit_frames = samples.iter().map(far).fold(0.0, f64::max);
        let mut fit = Self {
            at_frames,
            unit_frames,
            acceleration,
            order,
            coefficients: Vector::zeros(),
            covariance: Matrix::zeros(),
            components: Vec::new(),
            chi2: 0.0,
            freedom: 0,
        };
        if !(unit_frames > 0.0 && unit_frames.is_finite()) {
            return None;
        }
        match order {
            1 => fit.solve::<1>(samples)?,
            2 => fit.solve::<2>(samples)?,
            3 => fit.solve::<3>(samples)?,
            4 => fit.solve::<4>(samples)?,
            _ => fit.solve::<MAX_ORDER>(samples)?,
        }
        Some(fit)
    }

    /// Returns a curve about `at_frames` of which only a bound on its rate is known.
    ///
    /// Its rate is 0 with the standard uncertainty `sigma_rate`, per frame. It has no component, so
    /// [`Self::predict`] returns `None`.
    pub fn unknown(at_frames: f64, sigma_rate: f64) -> Self {
        let mut covariance = Matrix::zeros();
        covariance[(0, 0)] = sigma_rate.powi(2);
        Self {
            at_frames,
            unit_frames: 1.0,
            acceleration: 0.0,
            order: 1,
            coefficients: Vector::zeros(),
            covariance,
            components: Vec::new(),
            chi2: 0.0,
            freedom: 0,
        }
    }

    /// Returns the first powers of a time relative to the centre of the fit, in its unit.
    fn powers<const ORDER: usize>(&self, time_frames: f64) -> SVector<f64, ORDER> {
        let u = (time_frames - self.at_frames) / self.unit_frames;
        let mut power = 1.0;
        SVector::from_fn(|_, _| {
            power *= u;
            power
        })
    }

    /// Returns the displacement by the known acceleration since the centre of the fit, in the unit of the values.
    fn known_part(&self, time_frames: f64) -> f64 {
        0.5 * self.acceleration * (time_frames - self.at_frames).powi(2)
    }

    /// Computes the weighted means of value and powers over the samples of each component, and returns the rows.
    fn average_components<const ORDER: usize>(&mut self, samples: &[Sample]) -> Vec<Row<ORDER>> {
        let mut rows = Vec::with_capacity(samples.len());
        let mut place = 0;
        for s in samples {
            let (weight, known_part, powers) =
                (s.sigma.powi(-2), self.known_part(s.time_frames), self.powers(s.time_frames));
            // Successive samples are mostly of one component.
            if self.components.get(place).is_none_or(|c| c.id != s.component) {
                place = self.place(s.component).unwrap_or(self.components.len());
            }
            if place == self.components.len() {
                self.components.push(Component { id: s.component, weight: 0.0, value: 0.0, powers: Vector::zeros() });
            }
            let c = &mut self.components[place];
            c.weight += weight;
            c.value += weight * (s.value - known_part);
            for (sum, power) in c.powers.iter_mut().zip(&powers) {
                *sum += weight * power;
            }
            rows.push(Row { place, lever: powers, weight, known_part });
        }
        for c in &mut self.components {
            c.value /= c.weight;
            c.powers /= c.weight;
        }
        for row in &mut rows {
            row.lever -= self.components[row.place].powers.fixed_rows::<ORDER>(0);
        }
        rows
    }

    /// Solves the normal equations and computes the covariance of the coefficients, including the random walk. `None`
    /// if they are singular.
    fn solve<const ORDER: usize>(&mut self, samples: &[Sample]) -> Option<()> {
        let rows = self.average_components::<ORDER>(samples);
        self.freedom = samples.len().checked_sub(self.components.len() + ORDER)?;
        let (mut normal, mut right) = (SMatrix::<f64, ORDER, ORDER>::zeros(), SVector::<f64, ORDER>::zeros());
        for (s, Row { place, lever, weight, known_part }) in samples.iter().zip(&rows) {
            normal += *weight * lever * lever.transpose();
            right += *weight * (s.value - known_part - self.components[*place].value) * lever;
        }
        // The columns are scaled to a unit diagonal, so that the pivots measure the conditioning.
        let length = SVector::<f64, ORDER>::from_fn(|i, _| normal[(i, i)].sqrt());
        if length.iter().any(|l| !(*l > 0.0 && l.is_finite())) {
            return None;
        }
        let scaled = SMatrix::<f64, ORDER, ORDER>::from_fn(|i, j| normal[(i, j)] / (length[i] * length[j]));
        let factor = scaled.cholesky()?;
        if factor.l_dirty().diagonal().iter().any(|pivot| *pivot < SINGULAR) {
            return None;
        }
        let coefficients = factor.solve(&right.component_div(&length)).component_div(&length);
        let inverse = factor.inverse();
        let covariance = SMatrix::from_fn(|i, j| inverse[(i, j)] / (length[i] * length[j]));
        let covariance = covariance + self.walk_covariance(samples, &rows, &covariance);
        self.coefficients.fixed_rows_mut::<ORDER>(0).copy_from(&coefficients);
        self.covariance.fixed_view_mut::<ORDER, ORDER>(0, 0).copy_from(&covariance);
        let square = |(s, row): (&Sample, &Row<ORDER>)| {
            let fitted = row.lever.iter().zip(&coefficients).map(|(lever, c)| c * lever).sum::<f64>();
            ((s.value - (self.components[row.place].value + fitted + row.known_part)) / s.sigma).powi(2)
        };
        self.chi2 = samples.iter().zip(&rows).map(square).sum();
        Some(())
    }

    /// Returns the covariance of the coefficients that results from the random walk of the poses.
    ///
    /// A disturbance of one step moves every later pose of its component; the estimate responds with the sum of the
    /// gains of those poses.
    fn walk_covariance<const ORDER: usize>(
        &self,
        samples: &[Sample],
        rows: &[Row<ORDER>],
        covariance: &SMatrix<f64, ORDER, ORDER>,
    ) -> SMatrix<f64, ORDER, ORDER> {
        let mut later = vec![SVector::<f64, ORDER>::zeros(); self.components.len()];
        let mut added = SMatrix::zeros();
        if samples.iter().all(|s| s.walk == 0.0) {
            return added;
        }
        for (s, Row { place, lever, weight, .. }) in samples.iter().zip(rows).rev() {
            let sum = &mut later[*place];
            *sum += covariance * lever * *weight;
            added += s.walk.powi(2) * *sum * sum.transpose();
        }
        added
    }

    /// Returns the index of the component with this `id`; `None` before its first sample.
    fn place(&self, id: u32) -> Option<usize> {
        self.components.iter().position(|c| c.id == id)
    }

    /// Returns the means of the component with this `id`; `None` if the fit had no sample of it.
    fn component(&self, id: u32) -> Option<&Component> {
        self.place(id).map(|place| &self.components[place])
    }

    /// Returns the first derivative at `time_frames`, per frame, including the known acceleration.
    pub fn rate(&self, time_frames: f64) -> Estimate {
        let u = (time_frames - self.at_frames) / self.unit_frames;
        let mut power = 1.0 / self.unit_frames;
        let gradient = Vector::from_fn(|k, _| {
            let g = (k as f64 + 1.0) * power;
            power *= u;
            g
        });
        let known = self.acceleration * (time_frames - self.at_frames);
        Estimate { value: self.coefficients.dot(&gradient) + known, sigma: self.sigma_of(&gradient) }
    }

    /// Returns the second derivative at the centre of the fit, per frame^2, including the known part.
    ///
    /// A fit of order 1 has the known part alone, with a standard uncertainty of 0.
    pub fn curvature(&self) -> Estimate {
        let unit = 2.0 / self.unit_frames.powi(2);
        Estimate {
            value: self.acceleration + unit * self.coefficients[1],
            sigma: unit * self.covariance[(1, 1)].max(0.0).sqrt(),
        }
    }

    /// Returns the curve at `time_frames` for a component of the fit; `None` for another one.
    ///
    /// The standard uncertainty includes that of the component's mean, but not the noise of a new sample.
    pub fn predict(&self, time_frames: f64, component: u32) -> Option<Estimate> {
        let c = self.component(component)?;
        let (value, lever) = self.curve(time_frames, c);
        Some(Estimate { value, sigma: self.sigma_of(&lever).hypot(c.weight.powf(-0.5)) })
    }

    /// Returns the curve of a component at a time, and the factors of its coefficients there.
    fn curve(&self, time_frames: f64, c: &Component) -> (f64, Vector) {
        let lever = self.powers(time_frames) - c.powers;
        (c.value + self.coefficients.dot(&lever) + self.known_part(time_frames), lever)
    }

    /// Returns the displacement of the curve from one time to another, which does not depend on the offsets.
    pub fn advance(&self, from_frames: f64, to_frames: f64) -> Estimate {
        let lever = self.powers(to_frames) - self.powers(from_frames);
        let known = self.known_part(to_frames) - self.known_part(from_frames);
        Estimate { value: self.coefficients.dot(&lever) + known, sigma: self.sigma_of(&lever) }
    }

    /// Returns sample minus curve, and the sample's own standard uncertainty; `None` for a component outside the fit.
    pub fn residual(&self, sample: &Sample) -> Option<(f64, f64)> {
        let c = self.component(sample.component)?;
        let u = (sample.time_frames - self.at_frames) / self.unit_frames;
        let (mut power, mut fitted) = (1.0, 0.0);
        for k in 0..self.order {
            power *= u;
            fitted += self.coefficients[k] * (power - c.powers[k]);
        }
        Some((sample.value - (c.value + fitted + self.known_part(sample.time_frames)), sample.sigma))
    }

    /// Returns the sum of squared residuals in units of the samples' sigmas.
    pub fn chi2(&self) -> f64 {
        self.chi2
    }

    /// Returns the degrees of freedom: the number of samples less components and order.
    pub fn freedom(&self) -> usize {
        self.freedom
    }

    /// Returns the ratio of the scatter about the curve to the samples' own sigmas; 1 unless it is significantly
    /// larger.
    ///
    /// It is significant if chi^2 exceeds its expectation, the degrees of freedom, by more than three of its standard
    /// deviations.
    pub fn excess(&self) -> f64 {
        let freedom = self.freedom as f64;
        let limit = freedom + 3.0 * (2.0 * freedom).sqrt();
        if self.freedom > 0 && self.chi2 > limit { (self.chi2 / freedom).sqrt() } else { 1.0 }
    }

    /// Returns the standard uncertainty of a linear combination of the coefficients with these factors.
    fn sigma_of(&self, gradient: &Vector) -> f64 {
        (gradient.transpose() * self.covariance * gradient)[(0, 0)].max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cubic(t: f64) -> f64 {
        0.3 * t + 0.02 * t * t - 0.001 * t.powi(3)
    }

    fn samples(offsets: &[(f64, f64, f64)]) -> Vec<Sample> {
        // (from, to, offset) of each component, with one sample per frame.
        let mut out = Vec::new();
        for (id, (from, to, offset)) in offsets.iter().enumerate() {
            let mut t = *from;
            while t <= *to {
                out.push(Sample {
                    time_frames: t,
                    component: id as u32,
                    value: offset + cubic(t),
                    sigma: 0.01,
                    walk: 0.0,
                });
                t += 1.0;
            }
        }
        out
    }

    #[test]
    fn a_cubic_in_three_pieces_is_found_exactly() {
        let fit =
            Polynomial::fit(&samples(&[(0.0, 3.0, 0.0), (5.0, 8.0, 40.0), (9.0, 12.0, -7.0)]), 6.0, 3, 0.0).unwrap();
        assert!((fit.rate(6.0).value - (0.3 + 0.04 * 6.0 - 0.003 * 36.0)).abs() < 1e-9);
        assert!((fit.curvature().value - (0.04 - 0.006 * 6.0)).abs() < 1e-9);
        assert!((fit.predict(10.5, 1).unwrap().value - (40.0 + cubic(10.5))).abs() < 1e-9);
        assert!((fit.advance(1.0, 7.5).value - (cubic(7.5) - cubic(1.0))).abs() < 1e-9);
        assert!(fit.predict(10.5, 9).is_none());
        assert_eq!(fit.freedom(), 12 - 3 - 3);
    }

    #[test]
    fn a_known_curvature_needs_no_fitting() {
        let data: Vec<_> = (0..6)
            .map(|i| f64::from(i) * 1.5)
            .map(|t| Sample {
                time_frames: t,
                component: 3,
                value: 2.0 - 0.4 * t + 0.5 * 0.07 * t * t,
                sigma: 0.1,
                walk: 0.0,
            })
            .collect();
        let fit = Polynomial::fit(&data, 3.0, 1, 0.07).unwrap();
        assert!((fit.rate(0.0).value + 0.4).abs() < 1e-12);
        assert!(fit.chi2() < 1e-20);
    }

    #[test]
    fn the_sigma_of_a_straight_line_holds_the_noise_of_the_poses_and_of_the_steps() {
        let data: Vec<_> = (0..11)
            .map(|i| Sample { time_frames: f64::from(i), component: 0, value: 0.0, sigma: 0.2, walk: 0.07 })
            .collect();
        let fit = Polynomial::fit(&data, 2.0, 1, 0.0).unwrap();
        let gains: Vec<f64> = (0..11).map(|i| (f64::from(i) - 5.0) / 110.0).collect();
        let white: f64 = gains.iter().map(|gain| gain * gain).sum();
        let walk: f64 = (0..11).map(|j| gains[j..].iter().sum::<f64>().powi(2)).sum();
        let expected = (0.2_f64.powi(2) * white + 0.07_f64.powi(2) * walk).sqrt();
        assert!((fit.rate(2.0).sigma - expected).abs() < 1e-12, "{}", fit.rate(2.0).sigma);
    }

    #[test]
    fn what_the_samples_do_not_determine_is_refused() {
        let one = |t: f64, component| Sample { time_frames: t, component, value: t, sigma: 1.0, walk: 0.0 };
        assert!(Polynomial::fit(&[], 0.0, 1, 0.0).is_none());
        assert!(Polynomial::fit(&[one(1.0, 0)], 0.0, 1, 0.0).is_none());
        assert!(Polynomial::fit(&[one(1.0, 0), one(2.0, 1), one(3.0, 2)], 0.0, 1, 0.0).is_none(), "three loose ends");
        assert!(Polynomial::fit(&[one(1.0, 0), one(1.0, 0)], 0.0, 1, 0.0).is_none(), "one moment twice");
        assert!(Polynomial::fit(&[one(1.0, 0), one(2.0, 0)], 0.0, 2, 0.0).is_none(), "a parabola through two points");
        assert!(Polynomial::fit(&[one(1.0, 0), one(2.0, 0)], 0.0, 1, 0.0).is_some());
    }
}
