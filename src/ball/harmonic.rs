//! Least squares along a rim: something that goes as `a cos + b sin + c`, each bin trusted by what is left of it.

use nalgebra::{Matrix3, Vector3};

use super::rim::LANES;

/// Beyond these sizes a residual counts nothing; infinite where there is no limit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Limits {
    /// Times the root of its weight.
    pub weighted: f32,
    pub plain: f32,
}

/// What `a cos + b sin + c` leaves of the values.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
pub(super) fn left(values: &[f32], [cos, sin]: [&[f32]; 2], [a, b, c]: [f32; 3], out: &mut [f32]) {
    for (((out, value), cos), sin) in out.iter_mut().zip(values).zip(cos).zip(sin) {
        *out = value - (cos * a + sin * b + c);
    }
}

/// The trust in every bin (J. W. Tukey's biweight), and the sums of the normal equations.
///
/// `bins` are the values, their weights, the roots of these, and what was left of the values; lists are multiples of
/// [`LANES`] long. The sums are those of the weights times cos cos, cos sin, sin sin, cos, sin and 1, then of the
/// weighted values times cos, sin and 1.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
pub(super) fn reweigh(
    bins: [&[f32]; 4],
    [cos, sin]: [&[f32]; 2],
    limits: Limits,
    trust: &mut [f32],
) -> [[f32; LANES]; 9] {
    let (weighted, plain) = (1.0 / limits.weighted, 1.0 / limits.plain);
    // As arrays: the ends of slices would be looked for lane by lane.
    let [value, weight, root, residual] = bins.map(|list| list.as_chunks::<LANES>().0);
    let (cos, sin) = (cos.as_chunks::<LANES>().0, sin.as_chunks::<LANES>().0);
    let bins = value.iter().zip(weight).zip(root.iter().zip(residual)).zip(cos.iter().zip(sin));
    let mut sums = [[0.0; LANES]; 9];
    for (trust, (((value, weight), (root, residual)), (cos, sin))) in
        trust.as_chunks_mut::<LANES>().0.iter_mut().zip(bins)
    {
        for i in 0..LANES {
            let (z, far) = (residual[i] * root[i] * weighted, residual[i] * plain);
            let (z, far) = (1.0 - z * z, 1.0 - far * far);
            // All three are looked at: branches would stop the lanes.
            let share = if (z > 0.0) & (far > 0.0) & (weight[i] > 0.0) { z * far } else { 0.0 };
            trust[i] = share * share;
            let weight = trust[i] * weight[i];
            let (x, y) = (weight * cos[i], weight * sin[i]);
            sums[0][i] += x * cos[i];
            sums[1][i] += x * sin[i];
            sums[2][i] += y * sin[i];
            sums[3][i] += x;
            sums[4][i] += y;
            sums[5][i] += weight;
            sums[6][i] += x * value[i];
            sums[7][i] += y * value[i];
            sums[8][i] += weight * value[i];
        }
    }
    sums
}

/// The normal matrix and the right side.
pub(super) fn matrix(sums: &[[f32; LANES]; 9]) -> (Matrix3<f64>, Vector3<f64>) {
    let [xx, xy, yy, x, y, one, right @ ..] = sums.map(|lanes| lanes.iter().map(|sum| f64::from(*sum)).sum());
    (Matrix3::new(xx, xy, x, xy, yy, y, x, y, one), Vector3::from(right))
}
