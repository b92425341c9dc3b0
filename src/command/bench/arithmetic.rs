//! Arithmetic that saturates a core, to count the cores of a machine.

use crate::numeric::{Vector, vectorized};

/// The number of independent accumulators, enough to fill the pipelines of a core.
const ACCUMULATORS: usize = 10;
const ROUNDS: usize = 1000;

vectorized! {
    /// Runs [`ROUNDS`] rounds of [`ACCUMULATORS`] independent fused multiply-adds from `start`, without memory access.
    /// Returns their sum, so that the compiler keeps them.
    ///
    /// The throughput gained by further threads shows the true number of cores: two threads on one core gain nothing.
    pub(super) fn saturate_core(start: f32) -> f32 = saturate_core_with
}

/// Implements [`saturate_core`] on vectors of type `V`.
#[inline(always)]
fn saturate_core_with<V: Vector>(start: f32) -> f32 {
    let (shrink, mut sums) = (V::splat(0.999), [V::splat(start); ACCUMULATORS]);
    for _ in 0..ROUNDS {
        for sum in &mut sums {
            *sum = shrink.plus_product(*sum, shrink);
        }
    }
    let mut total = sums[0];
    for sum in &sums[1..] {
        total = total.add(*sum);
    }
    total.to_lanes().sum() as f32
}
