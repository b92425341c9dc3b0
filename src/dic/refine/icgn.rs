//! Sub-pixel refinement: inverse-compositional Gauss-Newton (IC-GN).
//!
//! Minimises the zero-mean normalised sum of squared differences (ZNSSD) between the reference subset and the warped
//! target. The warp is composed with the inverse of a step of the *reference*, so the Hessian is computed once per
//! subset. The gradient is of fourth order: the derivative of the spline would emphasise the frequencies where
//! interpolation errs, and double the bias. B. Pan, K. Li, W. Tong, Exp. Mech. 53 (2013) 1277,
//! <https://doi.org/10.1007/s11340-013-9717-6>.

use super::warped_rows::{RotatedRows, RowSampler, StoredRows, TiledRows, WarpedRows, WarpedTarget};
use crate::dic::geometry::{Block, Pixel, Second, Shape, SubsetMask, Warp};
use crate::dic::image::{InterpolatedImage, ShiftedRows, relative_gain};
use crate::dic::subset::{ReferenceSubset, Sums, project};
use crate::numeric::{Lanes, Vector, vectorized};

/// The step length that ends the iteration, px.
const TOLERANCE_PX: f64 = 0.002;

/// The maximum step length for the geometric extrapolation of the remaining steps, px.
const MAX_SERIES_PX: f64 = 0.01;

/// The maximum ratio of successive steps for the extrapolation.
const MAX_STEADY_RATIO: f64 = 0.3;

/// The maximum number of iterations; sound subsets take 3 to 6.
const MAX_ITERATIONS: u32 = 12;

/// The length of a first step that needs no second one, px. A step is wrong by some per cent.
const NEAR_PX: f64 = 0.01;

/// The step length that ends the quick iterations, px.
const QUICK_TOLERANCE_PX: f64 = 0.02;

/// The length of a first exact step after quick ones that ends the iteration, px. The next would be some ten times
/// shorter.
const LAST_STEP_PX: f64 = 0.005;

/// The maximum number of quick iterations.
const MAX_QUICK_ITERATIONS: u32 = 4;

/// The largest displacement gradient for the quick iterations.
const MAX_TILED_GRADIENT: f64 = 0.12;

/// The variance below which a target holds nothing but rounding, DN^2.
pub(in crate::dic) const MIN_VARIANCE: f64 = 1e-3;

/// The maximum distance between two matches that count as one, px.
const SAME_PX: f64 = 0.1;

/// The reason why a subset was not found in the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::dic) enum MatchError {
    /// The iteration left the image.
    OutOfFrame,
    /// The iteration did not converge.
    NotConverged,
}

/// The match of a subset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::dic) struct Match {
    /// The warp from reference to target.
    pub(in crate::dic) warp: Warp,
    /// Its second-order part.
    pub(in crate::dic) second: Second,
    /// The zero-mean normalised cross-correlation.
    pub(in crate::dic) zncc: f64,
    /// The number of iterations.
    pub(in crate::dic) iterations: u32,
}

impl Match {
    /// Whether both are the same match, found from different starts: their displacements differ by less than 0.1 px.
    pub(in crate::dic) fn is_near(&self, other: &Self) -> bool {
        (self.warp.u - other.warp.u).hypot(self.warp.v - other.warp.v) < SAME_PX
    }
}

/// The sampling of a warped target.
#[derive(Clone, Copy)]
enum Sampling {
    /// Every pixel at its own position.
    Exact,
    /// In tiles that are only shifted.
    Tiled,
}

/// One reference subset and the target to match it with.
#[derive(Clone, Copy)]
pub(in crate::dic) struct Refiner<'a> {
    pub(in crate::dic) subset: &'a ReferenceSubset,
    pub(in crate::dic) window: &'a SubsetMask,
    pub(in crate::dic) shape: Shape,
    /// The target, interpolated.
    pub(in crate::dic) target: &'a InterpolatedImage,
    /// The centre of the subset in the reference, px from the corner of the target's prepared part.
    pub(in crate::dic) at: Pixel,
}

/// An update of a warp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::dic) struct GaussNewtonStep {
    /// The step of the reference.
    pub(in crate::dic) step: Warp,
    /// The ZNCC before the step.
    pub(in crate::dic) zncc: f64,
    /// The expected increase of the ZNCC by the step.
    pub(in crate::dic) zncc_gain: f64,
}

impl Refiner<'_> {
    /// Finds the subset in the target by IC-GN, starting from the warp `start`.
    ///
    /// # Errors
    ///
    /// [`MatchError`] if the iteration leaves the image or does not converge.
    pub(in crate::dic) fn refine(&self, start: Warp) -> Result<Match, MatchError> {
        self.iterate(start, |warp| self.gauss_newton_step(warp))
    }

    /// Runs [`Self::refine`] and stores the residual before the last step, which hardly changes it, in `residual`.
    ///
    /// # Errors
    ///
    /// See [`Self::refine`]. `residual` is then unspecified.
    pub(in crate::dic) fn refine_with_residual(
        &self,
        start: Warp,
        residual: &mut Vec<Lanes>,
    ) -> Result<Match, MatchError> {
        let mut last = Sums::default();
        let found = self.iterate(start, |warp| {
            last = self.sample_target(warp, residual)?;
            self.solve_step(last).map(|update| (update.step, update.zncc))
        })?;
        self.subtract(self, last, residual);
        Ok(found)
    }

    /// Runs one update if it is at most [`NEAR_PX`] long, else [`Self::refine_with_residual`].
    ///
    /// `gradient_gain` multiplies the step. `residual` is that before the update.
    ///
    /// # Errors
    ///
    /// See [`Self::refine_with_residual`].
    pub(in crate::dic) fn refine_near(
        &self,
        start: Warp,
        gradient_gain: f64,
        residual: &mut Vec<Lanes>,
    ) -> Result<Match, MatchError> {
        let sums = self.sample_target(&start, residual)?;
        let GaussNewtonStep { step, zncc, zncc_gain } = self.solve_step(sums)?;
        let is_near = step.length(f64::from(self.window.half)) <= NEAR_PX;
        let Some(warp) = start.after_inverse(&step.scaled(gradient_gain)).filter(|_| is_near) else {
            return self.refine_with_residual(start, residual);
        };
        self.subtract(self, sums, residual);
        Ok(Match { warp, second: [[0.0; 3]; 2], zncc: (zncc + zncc_gain).min(1.0), iterations: 1 })
    }

    /// Iterates with quick steps in tiles, then with the exact ones of `step_at`, until they are short enough.
    ///
    /// `step_at` returns the step at a warp and the ZNCC there. The match has the ZNCC before its last step.
    ///
    /// # Errors
    ///
    /// See [`Self::refine`].
    fn iterate(
        &self,
        start: Warp,
        mut step_at: impl FnMut(&Warp) -> Result<(Warp, f64), MatchError>,
    ) -> Result<Match, MatchError> {
        let half = f64::from(self.window.half);
        let (mut warp, quick) = self.iterate_in_tiles(start)?;
        let mut before = None;
        for iterations in quick + 1..=quick + MAX_ITERATIONS {
            let (step, zncc) = step_at(&warp)?;
            let length = step.length(half);
            if length.is_nan() || length >= half {
                return Err(MatchError::NotConverged);
            }
            // The steps shrink geometrically, so the sum of the remaining series can be taken at once.
            let ratio = before.map_or(1.0, |before: Warp| step.projection_ratio(&before, half));
            let steady = length < MAX_SERIES_PX && ratio.abs() < MAX_STEADY_RATIO;
            let last = steady || (quick > 0 && length < LAST_STEP_PX);
            let step = if steady { step.scaled(1.0 / (1.0 - ratio)) } else { step };
            before = Some(step);
            warp = warp.after_inverse(&step).ok_or(MatchError::NotConverged)?;
            if last || length < TOLERANCE_PX {
                return Ok(Match { warp, second: [[0.0; 3]; 2], zncc, iterations });
            }
        }
        Err(MatchError::NotConverged)
    }

    /// Iterates with tiles that are only shifted, four times as fast. Returns the warp and the number of iterations.
    ///
    /// The error is proportional to the deformation, some thousandths of a pixel. A translation, or a warp beyond
    /// [`MAX_TILED_GRADIENT`], is returned as it is.
    ///
    /// # Errors
    ///
    /// See [`Self::refine`].
    fn iterate_in_tiles(&self, start: Warp) -> Result<(Warp, u32), MatchError> {
        let half = f64::from(self.window.half);
        let mut warp = start;
        if self.shape == Shape::Translation {
            return Ok((warp, 0));
        }
        for iterations in 0..MAX_QUICK_ITERATIONS {
            if !warp.is_within(MAX_TILED_GRADIENT) {
                return Ok((warp, iterations));
            }
            let step = self.solve_step(self.sums_at(&warp, Sampling::Tiled)?)?.step;
            let length = step.length(half);
            if length.is_nan() || length >= half {
                return Err(MatchError::NotConverged);
            }
            warp = warp.after_inverse(&step).ok_or(MatchError::NotConverged)?;
            if length < QUICK_TOLERANCE_PX {
                return Ok((warp, iterations + 1));
            }
        }
        Ok((warp, MAX_QUICK_ITERATIONS))
    }

    /// Returns the Gauss-Newton step of the reference at `warp`, and the ZNCC there.
    ///
    /// # Errors
    ///
    /// [`MatchError::OutOfFrame`], or [`MatchError::NotConverged`] if the target has no contrast.
    pub(in crate::dic) fn gauss_newton_step(&self, warp: &Warp) -> Result<(Warp, f64), MatchError> {
        self.solve_step(self.sums_at(warp, Sampling::Exact)?).map(|update| (update.step, update.zncc))
    }

    /// Returns the step of this part of `whole` from the [samples](Self::sample_target) of `whole`.
    ///
    /// # Errors
    ///
    /// See [`Self::solve_step`].
    pub(in crate::dic) fn step_from(
        &self,
        whole: &Refiner<'_>,
        samples: &[Lanes],
    ) -> Result<GaussNewtonStep, MatchError> {
        self.solve_step(stored_sums_of(self, whole.subset.mean, samples))
    }

    /// Solves the normal equations of the sums.
    ///
    /// # Errors
    ///
    /// [`MatchError::NotConverged`] if the target has no contrast.
    pub(in crate::dic) fn solve_step(&self, sums: Sums) -> Result<GaussNewtonStep, MatchError> {
        let subset = self.subset;
        let pixels = self.window.pixels as f64;
        let mean = sums.levels / pixels;
        let (slopes, energy) = self.without_illumination(&sums, mean);
        if energy.is_nan() || energy <= MIN_VARIANCE * pixels {
            return Err(MatchError::NotConverged);
        }
        let light = subset.light.as_ref();
        let product = sums.product - light.map_or(0.0, |light| light.product_with_reference(slopes));
        let zncc = (product / (subset.energy * energy).sqrt()).clamp(-1.0, 1.0);
        let gain = (subset.energy / energy).sqrt();
        let affine: [f64; 6] = std::array::from_fn(|k| {
            let even = mean * subset.jacobian_sum[k] + light.map_or(0.0, |light| light.jacobian_product(slopes, k));
            gain * (sums.jacobian[k] - even) - subset.jacobian_levels[k]
        });
        let (right, count) = project(self.shape, &affine);
        let (mut step, mut drop) = ([0.0; 6], 0.0);
        for ((step, line), pull) in step.iter_mut().zip(&subset.inverse).zip(right).take(count) {
            *step = line.iter().zip(&right).take(count).map(|(a, b)| a * b).sum();
            drop += *step * pull;
        }
        // The remaining sum of squares is 2 energy (1 - ZNCC).
        let step = Warp::from_step(self.shape, &step);
        Ok(GaussNewtonStep { step, zncc, zncc_gain: 0.5 * drop / subset.energy })
    }

    /// Returns the slopes of the target's illumination plane, DN/px, and the sum of squares of its levels without plane
    /// and mean, DN^2. `mean` is the mean level of the target. Without a plane in the reference the slopes are zero.
    pub(in crate::dic) fn without_illumination(&self, sums: &Sums, mean: f64) -> ([f64; 2], f64) {
        let energy = sums.energy - sums.levels * mean;
        self.subset.light.as_ref().map_or(([0.0; 2], energy), |light| {
            let slopes = light.fit_slopes(sums.levels, sums.first_moments);
            (slopes, energy - light.energy(slopes))
        })
    }

    /// Whether the warped subset lies wholly in the target, by its bounds.
    pub(in crate::dic) fn is_inside(&self, warp: &Warp) -> bool {
        self.window.fits_warped(warp, self.at, self.target.size())
    }

    /// Returns the sums over the target under a warp.
    ///
    /// # Errors
    ///
    /// [`MatchError::OutOfFrame`] if the warped subset leaves the image.
    fn sums_at(&self, warp: &Warp, sampling: Sampling) -> Result<Sums, MatchError> {
        if !self.is_inside(warp) {
            return Err(MatchError::OutOfFrame);
        }
        Ok(match sampling {
            Sampling::Tiled => tiled_sums_of(self, warp),
            Sampling::Exact => sums_of(self, warp, &mut []),
        })
    }

    /// Samples the warped target exactly and stores the samples minus the mean of the reference, packed, in `values`.
    /// Returns the sums over them.
    ///
    /// # Errors
    ///
    /// [`MatchError::OutOfFrame`] if the warped subset leaves the image; `values` is then empty.
    pub(in crate::dic) fn sample_target(&self, warp: &Warp, values: &mut Vec<Lanes>) -> Result<Sums, MatchError> {
        values.clear();
        if !self.is_inside(warp) {
            return Err(MatchError::OutOfFrame);
        }
        values.resize(self.window.mask.len(), Lanes::splat(0.0));
        Ok(sums_of(self, warp, values))
    }

    /// Returns the sums over all blocks of the exactly sampled target, and stores its levels in `values` if it has
    /// room.
    ///
    /// For a kernel of `N` taps, `M` is `N` + 1.
    #[inline(always)]
    fn sums_with<V: Vector, const N: usize, const M: usize>(&self, warp: &Warp, values: &mut [Lanes]) -> Sums {
        let mut sums = Sums::default();
        let warped = self.warped_target(warp);
        let shift = *warp == Warp::shift(warp.u, warp.v);
        let turned = RotatedRows::<V, N, M>::applies_to(warp);
        for block in &self.window.blocks {
            if shift {
                let (x, y) = warped.position(f64::from(block.dx), f64::from(block.dy));
                let column = ShiftedRows::<V, N>::new(self.target, x, y);
                if self.shape == Shape::Translation {
                    self.add_block::<V, false>(&mut sums, block, column, values);
                } else {
                    self.add_block::<V, true>(&mut sums, block, column, values);
                }
            } else if turned {
                let column = RotatedRows::<V, N, M>::new(warped, block);
                self.add_block::<V, true>(&mut sums, block, column, values);
            } else {
                let column = WarpedRows::<N, M>::new(warped, block);
                self.add_block::<V, true>(&mut sums, block, column, values);
            }
        }
        sums
    }

    /// Returns the sums over all blocks of the target sampled in tiles. For a kernel of `N` taps.
    #[inline(always)]
    fn tiled_sums_with<V: Vector, const N: usize>(&self, warp: &Warp) -> Sums {
        let mut sums = Sums::default();
        let warped = self.warped_target(warp);
        for block in &self.window.blocks {
            self.add_block::<V, true>(&mut sums, block, TiledRows::<V, N>::new(warped, block), &mut []);
        }
        sums
    }

    /// Returns the sums over all blocks of stored samples, from which `mean` was subtracted when they were stored.
    #[inline(always)]
    fn stored_sums_with<V: Vector>(&self, mean: f32, samples: &[Lanes]) -> Sums {
        let mut sums = Sums::default();
        for block in &self.window.blocks {
            let column = StoredRows::<V>::new(&samples[block.start..block.start + block.rows], mean);
            self.add_block::<V, true>(&mut sums, block, column, &mut []);
        }
        sums
    }

    /// Returns the target under a warp about the subset's centre.
    #[inline(always)]
    fn warped_target<'b>(&'b self, warp: &'b Warp) -> WarpedTarget<'b> {
        WarpedTarget {
            target: self.target,
            at: self.at,
            warp,
            gain: relative_gain(self.subset.contrast, self.target.contrast),
        }
    }

    /// Adds the sums over one block of eight columns to `sums`. `column` samples its rows.
    ///
    /// A pure translation needs no `LEVERS`, the position-weighted sums. Stores the target's levels in `values` if it
    /// has room.
    #[inline(always)]
    fn add_block<V: Vector, const LEVERS: bool>(
        &self,
        sums: &mut Sums,
        block: &Block,
        mut column: impl RowSampler<V>,
        values: &mut [Lanes],
    ) {
        let packed = block.start..block.start + block.rows;
        let (mask, reference) = (&self.window.mask[packed.clone()], &self.subset.levels[packed.clone()]);
        let gradients = (&self.subset.gradient_x[packed.clone()], &self.subset.gradient_y[packed]);
        let mut kept = values.get_mut(block.start..block.start + block.rows).unwrap_or_default().iter_mut();
        let zero = V::splat(0.0);
        let (mut levels, mut energy, mut product) = (zero, zero, zero);
        let (mut along_x, mut along_y, mut lever_x, mut lever_y, mut down) = (zero, zero, zero, zero, zero);
        let mean = V::splat(self.subset.mean);
        let rows = mask.iter().zip(reference).zip(gradients.0.iter().zip(gradients.1));
        for (dy, ((mask, reference), (gradient_x, gradient_y))) in (block.dy..).zip(rows) {
            let (gradient_x, gradient_y) = (V::from_lanes(gradient_x), V::from_lanes(gradient_y));
            let sampled = column.next(gradient_x, gradient_y);
            let value = sampled.sub(mean).mul(V::from_lanes(mask));
            if let Some(kept) = kept.next() {
                *kept = value.to_lanes();
            }
            levels = levels.add(value);
            energy = energy.plus_product(value, value);
            product = product.plus_product(value, V::from_lanes(reference));
            let dy = V::splat(dy as f32);
            let (term_x, term_y) = (value.mul(gradient_x), value.mul(gradient_y));
            along_x = along_x.add(term_x);
            along_y = along_y.add(term_y);
            if LEVERS {
                lever_x = lever_x.plus_product(term_x, dy);
                lever_y = lever_y.plus_product(term_y, dy);
                down = down.plus_product(value, dy);
            }
        }
        let [levels, across, _] = levels.to_lanes().moments(f64::from(block.dx));
        sums.levels += levels;
        sums.first_moments[0] += across;
        sums.first_moments[1] += down.to_lanes().sum();
        sums.energy += energy.to_lanes().sum();
        sums.product += product.to_lanes().sum();
        for (half, (plain, lever)) in [(along_x, lever_x), (along_y, lever_y)].into_iter().enumerate() {
            let moments = plain.to_lanes().moments(f64::from(block.dx));
            sums.jacobian[3 * half] += moments[0];
            sums.jacobian[3 * half + 1] += moments[1];
            sums.jacobian[3 * half + 2] += lever.to_lanes().sum();
        }
    }
}

vectorized! {
    /// Returns the sums over the exactly sampled target under a warp, for its kernel: see [`Refiner::sums_with`].
    fn sums_of(refiner: &Refiner<'_>, warp: &Warp, values: &mut [Lanes]) -> Sums = sums_with
}

/// Implements [`sums_of`] on vectors of type `V`.
#[inline(always)]
fn sums_with<V: Vector>(refiner: &Refiner<'_>, warp: &Warp, values: &mut [Lanes]) -> Sums {
    match refiner.target.tap_count() {
        4 => refiner.sums_with::<V, 4, 5>(warp, values),
        _ => refiner.sums_with::<V, 6, 7>(warp, values),
    }
}

vectorized! {
    /// Returns the sums over the target sampled in tiles, for its kernel: see [`Refiner::tiled_sums_with`].
    fn tiled_sums_of(refiner: &Refiner<'_>, warp: &Warp) -> Sums = tiled_sums_with
}

vectorized! {
    /// Returns the sums over stored samples: see [`Refiner::stored_sums_with`].
    fn stored_sums_of(refiner: &Refiner<'_>, mean: f32, samples: &[Lanes]) -> Sums = stored_sums_with
}

/// Implements [`stored_sums_of`] on vectors of type `V`.
#[inline(always)]
fn stored_sums_with<V: Vector>(refiner: &Refiner<'_>, mean: f32, samples: &[Lanes]) -> Sums {
    refiner.stored_sums_with::<V>(mean, samples)
}

/// Implements [`tiled_sums_of`] on vectors of type `V`.
#[inline(always)]
fn tiled_sums_with<V: Vector>(refiner: &Refiner<'_>, warp: &Warp) -> Sums {
    match refiner.target.tap_count() {
        4 => refiner.tiled_sums_with::<V, 4>(warp),
        _ => refiner.tiled_sums_with::<V, 6>(warp),
    }
}

#[cfg(test)]
mod tests;
