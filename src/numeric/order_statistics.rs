//! Order statistics by counting. No branch depends on the values, so none is mispredicted.

/// Values counted at a time, for vector instructions.
const LANES: usize = 16;

/// The low bits of a value that are ignored: the result is exact to one part in four thousand.
const IGNORED_BITS: u32 = 11;

/// Returns the value at `rank` (0 for the smallest) in ascending order, rounded down by at most one part in 4096.
///
/// The values are not negative. Pads `values` with infinities.
pub fn nth_smallest(values: &mut Vec<f32>, rank: usize) -> f32 {
    values.resize(values.len().next_multiple_of(LANES), f32::INFINITY);
    // Non-negative floats sort like their bits.
    f32::from_bits(bits_of_rank(values, rank as u32))
}

/// Returns the bits of the value at `rank` (from 0) in ascending order, the [`IGNORED_BITS`] set to 0, by bisection.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn bits_of_rank(values: &[f32], rank: u32) -> u32 {
    let mut bits = 0;
    for place in (IGNORED_BITS..31).rev() {
        let limit = bits + (1 << place);
        let count: u32 = values.iter().map(|value| u32::from(value.to_bits() < limit)).sum();
        // A bit is added without a branch.
        bits += u32::from(count <= rank) << place;
    }
    bits
}

/// The maximum number of values of a neighbourhood.
pub const MAX_COUNT: usize = 3 * LANES;

/// Returns the `rank`th highest of at most 48 values, exactly; `rank` is 1 for the highest.
///
/// Unused values must be minus infinity. Infinity for a rank of 0.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
pub fn nth_highest(values: &[f32; MAX_COUNT], rank: u32) -> f32 {
    let mut higher = [0_u32; MAX_COUNT];
    for other in values {
        for lane in 0..MAX_COUNT {
            higher[lane] += u32::from(*other > values[lane]);
        }
    }
    // The lowest of those that fewer than `rank` values exceed.
    let mut lowest = [f32::INFINITY; LANES];
    for (values, higher) in values.chunks_exact(LANES).zip(higher.chunks_exact(LANES)) {
        for lane in 0..LANES {
            let value = if higher[lane] < rank { values[lane] } else { f32::INFINITY };
            lowest[lane] = if value < lowest[lane] { value } else { lowest[lane] };
        }
    }
    // By halves, because in sequence each comparison would wait for the last.
    for half in [8, 4, 2, 1] {
        for lane in 0..half {
            lowest[lane] = if lowest[lane + half] < lowest[lane] { lowest[lane + half] } else { lowest[lane] };
        }
    }
    lowest[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_any_rank_are_those_of_a_sorted_list() {
        let mut state = 7_u32;
        for count in [1, 5, 16, 41, 48] {
            let mut values: Vec<f32> = (0..count)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    // Some are equal.
                    (state >> 27) as f32 * 0.37
                })
                .collect();
            let mut sorted = values.clone();
            sorted.sort_by(f32::total_cmp);
            let mut padded = [f32::NEG_INFINITY; MAX_COUNT];
            padded[..count].copy_from_slice(&values);
            for (rank, expected) in sorted.iter().enumerate() {
                let found = nth_smallest(&mut values, rank);
                assert!(found <= *expected && found >= expected * (1.0 - 5e-4), "{found} {expected}");
                assert_eq!(nth_highest(&padded, (count - rank) as u32).to_bits(), expected.to_bits());
            }
        }
    }
}
