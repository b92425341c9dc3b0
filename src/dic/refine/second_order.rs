//! Refinement with the second-order shape function (12 parameters).
//!
//! For strong local curvature. In smoother fields it only doubles the noise of the displacement. It starts from the
//! affine match and works pixel by pixel in double precision. H. Lu, P. D. Cary, Exp. Mech. 40 (2000) 393,
//! <https://doi.org/10.1007/BF02326485>.

use super::icgn::{Match, MatchError, Refiner};
use crate::dic::geometry::{Second, Warp};
use crate::numeric::{LANES, Lanes, invert};

/// The number of parameters: displacement, gradients and second derivatives of u, then of v.
pub(in crate::dic) const PARAMETERS: usize = 12;

/// The step length that ends the iteration, px.
const TOLERANCE_PX: f64 = 0.002;

/// The maximum number of iterations.
const MAX_ITERATIONS: u32 = 25;

/// A polynomial of second order in the offset: coefficients of 1, dx, dy, dx^2, dx dy, dy^2.
type Polynomial = [f64; 6];

/// Returns the offset to which the second-order warp moves the offset (dx, dy) from the centre, px.
fn warp_point(warp: &Warp, second: &Second, dx: f64, dy: f64) -> (f64, f64) {
    let (x, y) = warp.apply(dx, dy);
    let bend = |c: &[f64; 3]| c[0] * dx * dx + c[1] * dx * dy + c[2] * dy * dy;
    (x + bend(&second[0]), y + bend(&second[1]))
}

/// Returns the monomials of second order: the factors of the 6 coefficients of one axis.
fn monomials(dx: f64, dy: f64) -> Polynomial {
    [1.0, dx, dy, dx * dx, dx * dy, dy * dy]
}

/// Multiplies two polynomials and drops terms above the second order.
fn truncated_product(a: &Polynomial, b: &Polynomial) -> Polynomial {
    [
        a[0] * b[0],
        a[0] * b[1] + a[1] * b[0],
        a[0] * b[2] + a[2] * b[0],
        a[0] * b[3] + a[1] * b[1] + a[3] * b[0],
        a[0] * b[4] + a[1] * b[2] + a[2] * b[1] + a[4] * b[0],
        a[0] * b[5] + a[2] * b[2] + a[5] * b[0],
    ]
}

/// Composes the warp with the inverse of a small step, to first order in the step; drops terms above the second order.
///
/// `step` has the coefficients of [`monomials`] for u, then for v.
fn after_inverse(warp: &Warp, second: &Second, step: &[f64; PARAMETERS]) -> (Warp, Second) {
    let back = |axis: usize| -> Polynomial { std::array::from_fn(|k| -step[6 * axis + k]) };
    let (mut x, mut y) = (back(0), back(1));
    x[1] += 1.0;
    y[2] += 1.0;
    let (xx, xy, yy) = (truncated_product(&x, &x), truncated_product(&x, &y), truncated_product(&y, &y));
    let combine = |first: [f64; 3], second: &[f64; 3]| -> Polynomial {
        std::array::from_fn(|k| {
            let constant = if k == 0 { first[0] } else { 0.0 };
            constant + first[1] * x[k] + first[2] * y[k] + second[0] * xx[k] + second[1] * xy[k] + second[2] * yy[k]
        })
    };
    let u = combine([warp.u, 1.0 + warp.ux, warp.uy], &second[0]);
    let v = combine([warp.v, warp.vx, 1.0 + warp.vy], &second[1]);
    let first = Warp { u: u[0], ux: u[1] - 1.0, uy: u[2], v: v[0], vx: v[1], vy: v[2] - 1.0 };
    (first, [[u[3], u[4], u[5]], [v[3], v[4], v[5]]])
}

/// A second-order match with its variance factors.
#[derive(Debug, Clone, Copy)]
pub(in crate::dic) struct QuadraticMatch {
    pub(in crate::dic) found: Match,
    /// The diagonal of the inverse Hessian for u and v.
    pub(in crate::dic) inverse: (f64, f64),
}

/// The sums of one pass over the target.
struct Pass {
    zncc: f64,
    /// The right-hand side of the normal equations.
    right: [f64; PARAMETERS],
}

impl Refiner<'_> {
    /// Returns the pixels of the subset: offset from the centre along x and y, px, index of the packed row, and lane.
    fn pixels(&self) -> impl Iterator<Item = (f64, f64, usize, usize)> {
        self.window
            .blocks
            .iter()
            .flat_map(|block| {
                (0..block.rows).flat_map(move |row| {
                    let packed = block.start + row;
                    let dy = f64::from(block.dy + row as i32);
                    (0..LANES).map(move |lane| (f64::from(block.dx + lane as i32), dy, packed, lane))
                })
            })
            .filter(|(_, _, packed, lane)| self.window.mask[*packed].0[*lane] > 0.5)
    }

    /// Refines a first-order match with the second-order shape function. The iterations of both are added.
    ///
    /// # Errors
    ///
    /// [`MatchError`] if the iteration leaves the image or does not converge.
    pub(in crate::dic) fn refine_quadratic(&self, start: &Match) -> Result<QuadraticMatch, MatchError> {
        let inverse = invert(&self.hessian(), PARAMETERS).ok_or(MatchError::NotConverged)?;
        let (mut warp, mut second) = (start.warp, [[0.0; 3]; 2]);
        let half = f64::from(self.window.half);
        let mut values = Vec::new();
        for iterations in 1..=MAX_ITERATIONS {
            let pass = self.quadratic_pass(&warp, &second, &mut values)?;
            let step: [f64; PARAMETERS] =
                std::array::from_fn(|row| inverse[row].iter().zip(&pass.right).map(|(a, b)| a * b).sum());
            let length = [0, 6].into_iter().fold(0.0_f64, |high, k| {
                let first = half * step[k + 1].abs().max(step[k + 2].abs());
                let bend = half * half * step[k + 3].abs().max(step[k + 4].abs()).max(step[k + 5].abs());
                high.max(step[k].abs()).max(first).max(bend)
            });
            if length.is_nan() || length >= half {
                return Err(MatchError::NotConverged);
            }
            (warp, second) = after_inverse(&warp, &second, &step);
            if length < TOLERANCE_PX {
                let found = Match { warp, second, zncc: pass.zncc, iterations: start.iterations + iterations };
                return Ok(QuadraticMatch { found, inverse: (inverse[0][0], inverse[6][6]) });
            }
        }
        Err(MatchError::NotConverged)
    }

    /// Returns the sum of J J^T over the subset, with the Jacobian J of the second-order warp.
    fn hessian(&self) -> [[f64; PARAMETERS]; PARAMETERS] {
        let mut sums = [[[0.0; 6]; 6]; 3];
        for (dx, dy, packed, lane) in self.pixels() {
            let gx = f64::from(self.subset.gradient_x[packed].0[lane]);
            let gy = f64::from(self.subset.gradient_y[packed].0[lane]);
            let terms = monomials(dx, dy);
            for (sums, weight) in sums.iter_mut().zip([gx * gx, gx * gy, gy * gy]) {
                for (line, a) in sums.iter_mut().zip(terms) {
                    line.iter_mut().zip(terms).for_each(|(sum, b)| *sum += weight * a * b);
                }
            }
        }
        std::array::from_fn(|row| std::array::from_fn(|column| sums[row / 6 + column / 6][row % 6][column % 6]))
    }

    /// Samples the target at every pixel into `values`, DN, in the order of [`Self::pixels`].
    ///
    /// # Errors
    ///
    /// [`MatchError::OutOfFrame`] if a pixel leaves the image.
    fn sample_quadratic(&self, warp: &Warp, second: &Second, values: &mut Vec<f64>) -> Result<(), MatchError> {
        values.clear();
        let (x, y) = (f64::from(self.at.x), f64::from(self.at.y));
        let (right, bottom) = (self.target.width() as f64 - 1.0, self.target.height() as f64 - 1.0);
        for (dx, dy, ..) in self.pixels() {
            let (tx, ty) = warp_point(warp, second, dx, dy);
            let (tx, ty) = (x + tx, y + ty);
            // Written so that NaN is outside.
            if !((0.0..=right).contains(&tx) && (0.0..=bottom).contains(&ty)) {
                return Err(MatchError::OutOfFrame);
            }
            values.push(f64::from(self.target.value_at(tx, ty)));
        }
        Ok(())
    }

    /// Returns ZNCC and right-hand side at a second-order warp. `values` is scratch memory.
    ///
    /// # Errors
    ///
    /// [`MatchError::OutOfFrame`], or [`MatchError::NotConverged`] if the target has no contrast.
    fn quadratic_pass(&self, warp: &Warp, second: &Second, values: &mut Vec<f64>) -> Result<Pass, MatchError> {
        self.sample_quadratic(warp, second, values)?;
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let energy: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        if energy.is_nan() || energy <= 1e-3 * count {
            return Err(MatchError::NotConverged);
        }
        let gain = (self.subset.energy / energy).sqrt();
        let (mut product, mut right) = (0.0, [0.0; PARAMETERS]);
        for ((dx, dy, packed, lane), value) in self.pixels().zip(values.iter()) {
            let level = f64::from(self.subset.levels[packed].0[lane]);
            let difference = gain * (value - mean) - level;
            product += level * (value - mean);
            let gx = difference * f64::from(self.subset.gradient_x[packed].0[lane]);
            let gy = difference * f64::from(self.subset.gradient_y[packed].0[lane]);
            for (k, term) in monomials(dx, dy).into_iter().enumerate() {
                right[k] += gx * term;
                right[6 + k] += gy * term;
            }
        }
        let zncc = (product / (self.subset.energy * energy).sqrt()).clamp(-1.0, 1.0);
        Ok(Pass { zncc, right })
    }

    /// Computes the residual of a second-order match, DN, packed like the subset; empty if it leaves the image.
    pub(in crate::dic) fn quadratic_residual(&self, found: &Match, out: &mut Vec<Lanes>) {
        out.clear();
        let mut values = Vec::new();
        if self.sample_quadratic(&found.warp, &found.second, &mut values).is_err() {
            return;
        }
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let energy: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        let gain = (self.subset.energy / energy).sqrt();
        out.resize(self.window.mask.len(), Lanes::splat(0.0));
        for ((_, _, packed, lane), value) in self.pixels().zip(&values) {
            out[packed].0[lane] = self.subset.levels[packed].0[lane] - (gain * (value - mean)) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::geometry::grid;
    use crate::dic::tests::{Speckle, record};
    use crate::dic::{CorrelationParams, Correlator, Shape, Start};
    use crate::results::PointStatus;

    #[test]
    fn taking_a_step_back_undoes_it() {
        let warp = Warp { u: 1.3, ux: 0.02, uy: -0.1, v: -0.7, vx: 0.05, vy: -0.03 };
        let second = [[1e-3, -4e-4, 2e-4], [3e-4, 5e-4, -1e-3]];
        let step = [1e-3, 2e-5, -3e-5, 1e-6, 2e-6, -1e-6, -2e-3, 1e-5, 4e-5, -2e-6, 1e-6, 3e-6];
        let (first, bend) = after_inverse(&warp, &second, &step);
        let (dx, dy) = (7.0, -5.0);
        let moved = |k: usize| monomials(dx, dy).iter().zip(&step[k..]).map(|(a, b)| a * b).sum::<f64>();
        let found = warp_point(&first, &bend, dx + moved(0), dy + moved(6));
        let expected = warp_point(&warp, &second, dx, dy);
        assert!((found.0 - expected.0).abs() < 1e-5 && (found.1 - expected.1).abs() < 1e-5, "{found:?} {expected:?}");
    }

    #[test]
    fn a_bent_field_is_exact_with_the_quadratic_shape_and_biased_with_the_affine_one() {
        let speckle = Speckle::standard(51, 200.0);
        let bend = |x: f64, y: f64| (0.4 + 6e-4 * (x - 100.0).powi(2), 2e-4 * (y - 100.0) * (x - 100.0));
        // The disc centres follow the field but their shape does not, so the field is mild.
        let (a, b) = (record(&speckle.draw(200, 200), 0.0, 1), record(&speckle.moved(bend).draw(200, 200), 0.0, 2));
        let points = grid::rectangle([40, 40, 120, 120], 10, 31);
        let mean_error = |shape: Shape| {
            let params = CorrelationParams { shape, ..CorrelationParams::default() };
            let mut correlator = Correlator::new(&params, 200, 200).unwrap();
            let (a, b) = (correlator.prepare(a.view()), correlator.prepare(b.view()));
            let mut field = Vec::new();
            correlator.correlate(&a, &b, &points, Start::Search, &mut field);
            assert!(field.iter().all(|point| point.status == PointStatus::Valid), "{shape:?}");
            let error = |point: &crate::results::FieldPoint| {
                let truth = bend(f64::from(point.x_px), f64::from(point.y_px));
                f64::from(point.displacement.unwrap().u_px) - truth.0
            };
            field.iter().map(error).sum::<f64>() / field.len() as f64
        };
        let (affine, quadratic) = (mean_error(Shape::Affine), mean_error(Shape::Quadratic));
        eprintln!("mean error of u: affine {affine:.5} px, quadratic {quadratic:.5} px");
        // The affine subset averages the curvature: 6e-4 times the mean square of 15 px, about 0.05 px.
        assert!(affine > 0.03, "{affine}");
        assert!(quadratic.abs() < 0.003, "{quadratic}");
    }
}
