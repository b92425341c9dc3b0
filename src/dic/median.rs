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
    let below = |bits: u32| count_below(residual, f32::from_bits(bits)) > rank;
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

/// Values this near in the order of their bits are the same: one part in four thousand.
const NEAR_BITS: u32 = 2048;

/// The value that `rank` others are smaller than, of values none of which is negative; a little less than it is.
pub(super) fn nth_smallest(values: &[Lanes], rank: usize) -> f32 {
    let (rank, (mut low, mut high)) = (rank as f32, (0, f32::INFINITY.to_bits() + 1));
    while high - low > NEAR_BITS {
        let middle = low + (high - low) / 2;
        if values_below(values, f32::from_bits(middle)) > rank { high = middle } else { low = middle }
    }
    f32::from_bits(low)
}

vectorized! {
    /// How many values are smaller than a limit, exactly up to sixteen million.
    fn values_below(values: &[Lanes], limit: f32) -> f32 = values_below_with
}

#[inline(always)]
fn values_below_with<V: Vector>(values: &[Lanes], limit: f32) -> f32 {
    let (one, limit) = (V::splat(1.0), V::splat(limit));
    let mut counts = [V::splat(0.0); 4];
    let rows = values.chunks_exact(counts.len());
    for row in rows.remainder() {
        counts[0] = counts[0].add(one.and(V::from_lanes(row).at_least(limit)));
    }
    for rows in rows {
        for (count, row) in counts.iter_mut().zip(rows) {
            *count = count.add(one.and(V::from_lanes(row).at_least(limit)));
        }
    }
    let counts = counts[0].add(counts[1]).add(counts[2].add(counts[3]));
    (values.len() * LANES) as f32 - counts.to_lanes().0.iter().sum::<f32>()
}

vectorized! {
    /// How many squares are smaller than a limit, exactly up to sixteen million.
    fn count_below(residual: &[Lanes], limit: f32) -> f32 = count_below_with
}

#[inline(always)]
fn count_below_with<V: Vector>(residual: &[Lanes], limit: f32) -> f32 {
    let (one, limit) = (V::splat(1.0), V::splat(limit));
    // Sums that do not wait for one another.
    let mut counts = [V::splat(0.0); 4];
    let rows = residual.chunks_exact(counts.len());
    for row in rows.remainder() {
        let value = V::from_lanes(row);
        counts[0] = counts[0].add(one.and(value.mul(value).at_least(limit)));
    }
    for rows in rows {
        for (count, row) in counts.iter_mut().zip(rows) {
            let value = V::from_lanes(row);
            *count = count.add(one.and(value.mul(value).at_least(limit)));
        }
    }
    let counts = counts[0].add(counts[1]).add(counts[2].add(counts[3]));
    (residual.len() * LANES) as f32 - counts.to_lanes().0.iter().sum::<f32>()
}
