//! Gradient gain: corrects the bias of fourth-order gradients.
//!
//! Gradients of fourth order are a few per cent too small, so a Gauss-Newton step is too long by that factor. Further
//! iterations would correct it. The factor follows from the texture itself, because its gradients of eighth order are
//! accurate.
//!
//! A match solves sum g (f - t) = 0, with g the gradients of fourth order. The target's levels t change with the
//! displacement by the true gradient h. Noise therefore moves the result by sum g n / sum g h, not by the sum g n / sum
//! g^2 of the inverse Hessian. Standard uncertainties from the inverse Hessian are too large by the same factor.

use crate::dic::geometry::{GridPoint, Pixel, SubsetMask};
use crate::dic::image::PreparedFrame;
use crate::numeric::{LANES, Lanes, Vector, vectorized};

/// The minimum gradient gain of a texture that can be tracked.
const MIN_GAIN: f64 = 0.75;

/// The row step of the gradients that are sampled.
const ROW_STEP: usize = 5;

/// The sums of squares of fourth-order gradients, and of their products with those of eighth order.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::dic) struct GradientGain {
    squares: f64,
    products: f64,
}

impl GradientGain {
    /// Sums over the pixels between the first and the last column of every [`ROW_STEP`]th row.
    ///
    /// `spans` has one pair of columns for each row of the prepared part. Rows whose first column is larger are empty.
    pub(in crate::dic) fn from_spans(reference: &PreparedFrame, spans: &[(i32, i32)]) -> Self {
        let mut sums = Self::default();
        for (y, (left, right)) in spans.iter().enumerate().step_by(ROW_STEP).filter(|(_, span)| span.0 <= span.1) {
            let first = reference.levels.index(*left as isize, y as isize);
            let [squares, products] = add_gradients(reference, first, (right - left + 1) as usize);
            sums.add(Self { squares, products });
        }
        sums
    }

    /// Sums over every [`ROW_STEP`]th row of the pixels of a subset centred at `at` in the reference.
    pub(in crate::dic) fn from_subset(reference: &PreparedFrame, subset: &SubsetMask, at: GridPoint) -> Self {
        let Pixel { x, y } = reference.local(at);
        let mut sums = Self::default();
        for block in &subset.blocks {
            let first = reference.levels.index((x + block.dx) as isize, (y + block.dy) as isize);
            let mask = &subset.mask[block.start..block.start + block.rows];
            let [squares, products] = add_block(reference, first, mask);
            sums.add(Self { squares, products });
        }
        sums
    }

    /// Adds the sums over other pixels.
    pub(in crate::dic) fn add(&mut self, other: Self) {
        self.squares += other.squares;
        self.products += other.products;
    }

    /// Returns the gradient gain: the factor that corrects one Gauss-Newton step; 1 outside [`MIN_GAIN`] to 1.
    pub(in crate::dic) fn gain(&self) -> f64 {
        let gain = self.squares / self.products;
        // Without texture the gain is undefined, and no match succeeds anyway.
        if (MIN_GAIN..=1.0).contains(&gain) { gain } else { 1.0 }
    }
}

vectorized! {
    /// Returns the sums over `count` pixels of a row of the squared gradients, and of their products with those of
    /// eighth order. `first` is the index of the first pixel. The last `count` modulo 8 pixels are left out.
    fn add_gradients(reference: &PreparedFrame, first: usize, count: usize) -> [f64; 2] = add_gradients_with
}

/// Implements [`add_gradients`] on vectors of type `V`.
#[inline(always)]
fn add_gradients_with<V: Vector>(reference: &PreparedFrame, first: usize, count: usize) -> [f64; 2] {
    let mut sums = [V::splat(0.0); 2];
    // Whole vectors only: a few pixels at the end of a row do not matter.
    for x in (first..first + count / LANES * LANES).step_by(LANES) {
        add_eight(reference, x, V::splat(1.0), &mut sums);
    }
    [sums[0].to_lanes().sum(), sums[1].to_lanes().sum()]
}

vectorized! {
    /// Returns the sums of [`add_gradients`] over a block of eight columns, on its mask, at every [`ROW_STEP`]th row.
    fn add_block(reference: &PreparedFrame, first: usize, mask: &[Lanes]) -> [f64; 2] = add_block_with
}

/// Implements [`add_block`] on vectors of type `V`.
#[inline(always)]
fn add_block_with<V: Vector>(reference: &PreparedFrame, first: usize, mask: &[Lanes]) -> [f64; 2] {
    let (stride, mut sums) = (reference.levels.stride(), [V::splat(0.0); 2]);
    for (row, mask) in mask.iter().enumerate().step_by(ROW_STEP) {
        add_eight(reference, first + row * stride, V::from_lanes(mask), &mut sums);
    }
    [sums[0].to_lanes().sum(), sums[1].to_lanes().sum()]
}

/// Adds the squared gradients of eight pixels in a row, and their products with those of eighth order, to `sums`.
///
/// `x` is the index of the first pixel.
#[inline(always)]
fn add_eight<V: Vector>(reference: &PreparedFrame, x: usize, mask: V, sums: &mut [V; 2]) {
    // B. Fornberg, Math. Comput. 51 (1988) 699, <https://doi.org/10.1090/S0025-5718-1988-0935077-0>, table 1.
    const EIGHTH: [f32; 4] = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
    let (levels, stride) = (reference.levels.data(), reference.levels.stride());
    for (gradient, step) in [(&reference.gradient_x, 1), (&reference.gradient_y, stride)] {
        let mut eighth = V::splat(0.0);
        for (k, weight) in (1..).zip(EIGHTH) {
            let difference = V::load(&levels[x + k * step..]).sub(V::load(&levels[x - k * step..]));
            eighth = eighth.add(difference.mul(V::splat(weight)));
        }
        let fourth = V::load(&gradient.data()[x..]).mul(mask);
        *sums = [sums[0].add(fourth.mul(fourth)), sums[1].add(fourth.mul(eighth))];
    }
}
