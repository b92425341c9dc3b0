//! How much of a step towards a target is right.
//!
//! Gradients of fourth order read a few per cent low, so a step is that much too long; further steps would take it
//! back. By how much the texture itself says: its gradients of eighth order read right.

use super::lanes::LANES;
use super::prepared::Prepared;
use super::vector::{Vector, vectorized};

/// Gradients of fourth order read no less than this of those of eighth, in a texture that can be followed.
const LEAST_SHARE: f64 = 0.75;

/// From one row to the next of those whose gradients are looked at.
const ROW_STEP: usize = 5;

/// The part of a step that is right, by the pixels between the first and the last column of every row; none where the
/// first is larger.
pub(super) fn of(reference: &Prepared, spans: &[(i32, i32)]) -> f64 {
    let mut sums = [0.0; 2];
    for (y, (left, right)) in spans.iter().enumerate().step_by(ROW_STEP).filter(|(_, span)| span.0 <= span.1) {
        let first = reference.levels.index(*left as isize, y as isize);
        let row = add_gradients(reference, first, (right - left + 1) as usize);
        sums = [sums[0] + row[0], sums[1] + row[1]];
    }
    let share = sums[0] / sums[1];
    // Without texture there is no share; nothing is found there anyway.
    if (LEAST_SHARE..=1.0).contains(&share) { share } else { 1.0 }
}

vectorized! {
    /// Sums of squares of the gradients of a row, and of their products with gradients of eighth order.
    fn add_gradients(reference: &Prepared, first: usize, count: usize) -> [f64; 2] = add_gradients_with
}

#[inline(always)]
fn add_gradients_with<V: Vector>(reference: &Prepared, first: usize, count: usize) -> [f64; 2] {
    // B. Fornberg, Math. Comput. 51 (1988) 699, <https://doi.org/10.1090/S0025-5718-1988-0935077-0>, table 1.
    const EIGHTH: [f32; 4] = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
    let (levels, stride) = (reference.levels.data(), reference.levels.stride());
    let mut sums = [V::splat(0.0); 2];
    // Whole vectors only: a few pixels at the end of a row do not matter.
    for x in (first..first + count / LANES * LANES).step_by(LANES) {
        for (gradient, step) in [(&reference.gradient_x, 1), (&reference.gradient_y, stride)] {
            let mut eighth = V::splat(0.0);
            for (k, weight) in (1..).zip(EIGHTH) {
                let difference = V::load(&levels[x + k * step..]).sub(V::load(&levels[x - k * step..]));
                eighth = eighth.add(difference.mul(V::splat(weight)));
            }
            let fourth = V::load(&gradient.data()[x..]);
            sums = [sums[0].add(fourth.mul(fourth)), sums[1].add(fourth.mul(eighth))];
        }
    }
    [sums[0].to_lanes().sum(), sums[1].to_lanes().sum()]
}
