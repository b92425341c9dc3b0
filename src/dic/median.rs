//! How large the residuals of a body are, whatever a few strange ones are.

use super::lanes::{LANES, Lanes};
use super::vector::{Vector, vectorized};

/// Squares this near in the order of their bits are the same: less than one part in a hundred.
const EXACT_BITS: u32 = 65536;

/// The median of the sizes of as many residuals; more of them are 0, which no window holds.
///
/// `mean_square` is the mean of their squares.
pub(super) fn median_size(residual: &[Lanes], pixels: usize, mean_square: f64) -> f32 {
    let rank = (residual.len() * LANES - pixels + pixels / 2) as f32;
    let below = |bits: u32| squares_below(residual, f32::from_bits(bits)) > rank;
    // Squares are in the order of their bits; halving the range finds the one that so many are smaller than. That of
    // noise is 0.455 of the mean square; anything else takes longer.
    let near = [0.41, 0.49].map(|share| (share * mean_square) as f32);
    let (mut low, mut high) = match near.map(f32::to_bits) {
        [low, high] if high < f32::INFINITY.to_bits() && !below(low) && below(high) => (low, high),
        _ => (0, f32::MAX.to_bits()),
    };
    while high - low > EXACT_BITS {
        let middle = low + (high - low) / 2;
        if below(middle) { high = middle } else { low = middle }
    }
    f32::from_bits(low).sqrt()
}

/// Bits that are not told of a value: it is known to one part in four thousand.
const LEFT_OUT_BITS: u32 = 11;

/// The value that `rank` others are smaller than, of values none of which is negative; a little less than it is.
///
/// Found the sooner the nearer it is to `near`.
pub(super) fn nth_smallest(values: &[Lanes], rank: usize, near: f32) -> f32 {
    let rank = rank as f32;
    let value = |place: u32| f32::from_bits(place << LEFT_OUT_BITS);
    let below = |place: u32| values_below(values, value(place)) > rank;
    let bracket = [0.85, 1.18].map(|share| (share * near).to_bits() >> LEFT_OUT_BITS);
    let (mut low, mut high) = match bracket {
        [low, high] if near > 0.0 && near < 1e30 && !below(low) && below(high) => (low, high),
        _ => (0, (f32::INFINITY.to_bits() >> LEFT_OUT_BITS) + 1),
    };
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if below(middle) { high = middle } else { low = middle }
    }
    value(low)
}

vectorized! {
    /// How many values are smaller than a limit, exactly up to sixteen million.
    fn values_below(values: &[Lanes], limit: f32) -> f32 = values_below_with
}

#[inline(always)]
fn values_below_with<V: Vector>(values: &[Lanes], limit: f32) -> f32 {
    count_below::<V, false>(values, limit)
}

vectorized! {
    /// As [`values_below`], of their squares.
    fn squares_below(values: &[Lanes], limit: f32) -> f32 = squares_below_with
}

#[inline(always)]
fn squares_below_with<V: Vector>(values: &[Lanes], limit: f32) -> f32 {
    count_below::<V, true>(values, limit)
}

#[inline(always)]
fn count_below<V: Vector, const SQUARES: bool>(values: &[Lanes], limit: f32) -> f32 {
    let (one, limit) = (V::splat(1.0), V::splat(limit));
    // Sums that do not wait for one another.
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
    fn a_value_of_some_rank_is_that_of_a_sorted_list_wherever_it_is_looked_for() {
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
