//! How much of a step towards a target is right.
//!
//! Gradients of fourth order read a few per cent low, so a step is that much too long; further steps would take it
//! back. By how much the texture itself says: its gradients of eighth order read right.
//!
//! The answer of a match is where sum g (f - t) = 0, with g the gradients of fourth order; the target's levels t change
//! with the displacement by the true gradient h. So noise moves the answer by sum g n / sum g h, not by the
//! sum g n / sum g^2 of the inverse Hessian: the standard uncertainty that follows from that is too large by the same share.

use super::lanes::{LANES, Lanes};
use super::prepared::Prepared;
use super::vector::{Vector, vectorized};
use super::window::Window;

/// Gradients of fourth order read no less than this of those of eighth, in a texture that can be followed.
const LEAST_SHARE: f64 = 0.75;

/// From one row to the next of those whose gradients are looked at.
const ROW_STEP: usize = 5;

/// Sums of squares of the gradients of fourth order, and of their products with those of eighth.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sharpness {
    squares: f64,
    products: f64,
}

impl Sharpness {
    /// Of the pixels between the first and the last column of every row; none where the first is larger.
    pub(super) fn of(reference: &Prepared, spans: &[(i32, i32)]) -> Self {
        let mut sums = Self::default();
        for (y, (left, right)) in spans.iter().enumerate().step_by(ROW_STEP).filter(|(_, span)| span.0 <= span.1) {
            let first = reference.levels.index(*left as isize, y as isize);
            let [squares, products] = add_gradients(reference, first, (right - left + 1) as usize);
            sums.add(Self { squares, products });
        }
        sums
    }

    /// Of the pixels of a window at a place in the reference's part.
    pub(super) fn within(reference: &Prepared, window: &Window, at: (u32, u32)) -> Self {
        let (x, y) = reference.local(at);
        let mut sums = Self::default();
        for block in &window.blocks {
            let first = reference.levels.index((x + block.dx) as isize, (y + block.dy) as isize);
            let mask = &window.mask[block.start..block.start + block.rows];
            let [squares, products] = add_block(reference, first, mask);
            sums.add(Self { squares, products });
        }
        sums
    }

    /// Adds those of other pixels.
    pub(super) fn add(&mut self, other: Self) {
        self.squares += other.squares;
        self.products += other.products;
    }

    /// The part of a step that is right.
    pub(super) fn share(&self) -> f64 {
        let share = self.squares / self.products;
        // Without texture there is no share; nothing is found there anyway.
        if (LEAST_SHARE..=1.0).contains(&share) { share } else { 1.0 }
    }
}

vectorized! {
    /// Sums of squares of the gradients of a row, and of their products with gradients of eighth order.
    fn add_gradients(reference: &Prepared, first: usize, count: usize) -> [f64; 2] = add_gradients_with
}

#[inline(always)]
fn add_gradients_with<V: Vector>(reference: &Prepared, first: usize, count: usize) -> [f64; 2] {
    let mut sums = [V::splat(0.0); 2];
    // Whole vectors only: a few pixels at the end of a row do not matter.
    for x in (first..first + count / LANES * LANES).step_by(LANES) {
        add_eight(reference, x, V::splat(1.0), &mut sums);
    }
    [sums[0].to_lanes().sum(), sums[1].to_lanes().sum()]
}

vectorized! {
    /// As [`add_gradients`], of a column of eight pixels, on its mask.
    fn add_block(reference: &Prepared, first: usize, mask: &[Lanes]) -> [f64; 2] = add_block_with
}

#[inline(always)]
fn add_block_with<V: Vector>(reference: &Prepared, first: usize, mask: &[Lanes]) -> [f64; 2] {
    let (stride, mut sums) = (reference.levels.stride(), [V::splat(0.0); 2]);
    for (row, mask) in mask.iter().enumerate().step_by(ROW_STEP) {
        add_eight(reference, first + row * stride, V::from_lanes(mask), &mut sums);
    }
    [sums[0].to_lanes().sum(), sums[1].to_lanes().sum()]
}

/// Adds those of eight neighbours, the first at `x`.
#[inline(always)]
fn add_eight<V: Vector>(reference: &Prepared, x: usize, mask: V, sums: &mut [V; 2]) {
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
