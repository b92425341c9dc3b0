//! Robust size of residuals: medians by bisection over the bits of single-precision numbers.

use crate::numeric::{LANES, Lanes, Vector, vectorized};

/// The width of the final bracket of [`median_absolute`], as a difference of bit patterns: less than 1 % of a square.
const BRACKET_BITS: u32 = 65536;

/// Returns the median absolute residual of `pixels` pixels, rounded down by less than 0.5 %. Lanes off the window are
/// 0.
///
/// `mean_square` is the mean of their squares, which only speeds up the search.
pub(in crate::dic) fn median_absolute(residual: &[Lanes], pixels: usize, mean_square: f64) -> f32 {
    let rank = (residual.len() * LANES - pixels + pixels / 2) as f32;
    let below = |bits: u32| squares_below(residual, f32::from_bits(bits)) > rank;
    // Squares are ordered like their bits, so bisection finds the rank. The median square of noise is 0.455 of the mean
    // square; other residuals take more steps.
    let near = [0.41, 0.49].map(|share| (share * mean_square) as f32);
    let (mut low, mut high) = match near.map(f32::to_bits) {
        [low, high] if high < f32::INFINITY.to_bits() && !below(low) && below(high) => (low, high),
        _ => (0, f32::MAX.to_bits()),
    };
    while high - low > BRACKET_BITS {
        let middle = low + (high - low) / 2;
        if below(middle) { high = middle } else { low = middle }
    }
    f32::from_bits(low).sqrt()
}

/// The number of low bits that [`nth_smallest`] does not resolve: a relative error of 1 in 4000.
const DROPPED_BITS: u32 = 11;

/// Returns the value at `rank` (0 for the smallest) in ascending order, rounded down by at most one part in 4096.
///
/// The values are not negative.
///
/// The search is faster the closer `near` is to the result.
pub(in crate::dic) fn nth_smallest(values: &[Lanes], rank: usize, near: f32) -> f32 {
    let rank = rank as f32;
    let value = |place: u32| f32::from_bits(place << DROPPED_BITS);
    let below = |place: u32| values_below(values, value(place)) > rank;
    let bracket = [0.85, 1.18].map(|share| (share * near).to_bits() >> DROPPED_BITS);
    let (mut low, mut high) = match bracket {
        [low, high] if near > 0.0 && near < 1e30 && !below(low) && below(high) => (low, high),
        _ => (0, (f32::INFINITY.to_bits() >> DROPPED_BITS) + 1),
    };
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if below(middle) { high = middle } else { low = middle }
    }
    value(low)
}

vectorized! {
    /// Returns the number of values smaller than a limit, exact up to sixteen million.
    fn values_below(values: &[Lanes], limit: f32) -> f32 = values_below_with
}

/// Implements [`values_below`] on vectors of type `V`.
#[inline(always)]
fn values_below_with<V: Vector>(values: &[Lanes], limit: f32) -> f32 {
    count_below::<V, false>(values, limit)
}

vectorized! {
    /// Returns the number of values whose squares are smaller than a limit.
    fn squares_below(values: &[Lanes], limit: f32) -> f32 = squares_below_with
}

/// Implements [`squares_below`] on vectors of type `V`.
#[inline(always)]
fn squares_below_with<V: Vector>(values: &[Lanes], limit: f32) -> f32 {
    count_below::<V, true>(values, limit)
}

/// Returns the number of values, or of their squares, that are smaller than a limit.
#[inline(always)]
fn count_below<V: Vector, const SQUARES: bool>(values: &[Lanes], limit: f32) -> f32 {
    let (one, limit) = (V::splat(1.0), V::splat(limit));
    // Independent accumulators hide the latency of the additions.
    let mut counts = [V::splat(0.0); 4];
    for rows in values.chunks(counts.len()) {
        for (count, row) in counts.iter_mut().zip(rows) {
            let value = V::from_lanes(row);
            let value = if SQUARES { value.mul(value) } else { value };
            *count = count.add(one.and(value.at_least(limit)));
        }
    }
    let counts = counts[0].add(counts[1]).add(counts[2].add(counts[3]));
    (values.len() * LANES) as f32 - counts.to_lanes().0.iter().sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_of_some_rank_equals_the_sorted_list_for_any_start() {
        let mut state = 5_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 20) as f32 * 0.013
        };
        let values: Vec<Lanes> = (0..37).map(|_| Lanes(std::array::from_fn(|_| random()))).collect();
        let mut sorted: Vec<f32> = values.iter().flat_map(|row| row.0).collect();
        sorted.sort_by(f32::total_cmp);
        for (rank, expected) in sorted.iter().enumerate() {
            let found = nth_smallest(&values, rank, 0.0);
            assert!(found <= *expected && found >= expected * (1.0 - 5e-4), "{found} {expected}");
            for near in [0.9 * expected, 1.1 * expected, 40.0, f32::NAN] {
                assert_eq!(found.to_bits(), nth_smallest(&values, rank, near).to_bits());
            }
        }
    }
}
