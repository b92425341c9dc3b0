//! Robust least squares of a first harmonic, `a cos + b sin + c`, along a rim.

use nalgebra::{Matrix3, Vector3};

use super::annulus::{Directions, LANES};

/// The residuals from which the weight is zero; infinite for no limit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Limits {
    /// The limit of residuals times the root of their weight.
    pub weighted: f32,
    /// The limit of residuals.
    pub plain: f32,
}

/// Computes the residuals of the values after subtracting `a cos + b sin + c`; `harmonic` holds a, b and c.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
pub(super) fn residuals(values: &[f32], directions: Directions<'_>, harmonic: [f32; 3], out: &mut [f32]) {
    let [a, b, c] = harmonic;
    for (((out, value), cos), sin) in out.iter_mut().zip(values).zip(directions.cos).zip(directions.sin) {
        *out = value - (cos * a + sin * b + c);
    }
}

/// Computes the robust weight of every bin (J. W. Tukey's biweight) and sums the normal equations.
///
/// `bins` holds the values, their weights, the square roots of the weights, and the residuals. The lengths of the lists
/// are multiples of [`LANES`]. The first six sums are those of the weights times cos cos, cos sin, sin sin, cos, sin
/// and 1. The others are those of the weighted values times cos, sin and 1.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
pub(super) fn reweigh(
    bins: [&[f32]; 4],
    directions: Directions<'_>,
    limits: Limits,
    robust_weight: &mut [f32],
) -> [[f32; LANES]; 9] {
    let (weighted, plain) = (1.0 / limits.weighted, 1.0 / limits.plain);
    // With arrays the compiler needs no bounds check per lane.
    let [value, weight, root, residual] = bins.map(|list| list.as_chunks::<LANES>().0);
    let (cos, sin) = (directions.cos.as_chunks::<LANES>().0, directions.sin.as_chunks::<LANES>().0);
    let bins = value.iter().zip(weight).zip(root.iter().zip(residual)).zip(cos.iter().zip(sin));
    let mut sums = [[0.0; LANES]; 9];
    for (robust_weight, (((value, weight), (root, residual)), (cos, sin))) in
        robust_weight.as_chunks_mut::<LANES>().0.iter_mut().zip(bins)
    {
        for i in 0..LANES {
            let (z, far) = (residual[i] * root[i] * weighted, residual[i] * plain);
            let (z, far) = (1.0 - z * z, 1.0 - far * far);
            // `&` evaluates all three: branches would prevent vectorization.
            let biweight = if (z > 0.0) & (far > 0.0) & (weight[i] > 0.0) { z * far } else { 0.0 };
            robust_weight[i] = biweight * biweight;
            let weight = robust_weight[i] * weight[i];
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

/// Returns the normal matrix and the right-hand side.
pub(super) fn normal_equations(sums: &[[f32; LANES]; 9]) -> (Matrix3<f64>, Vector3<f64>) {
    let [xx, xy, yy, x, y, one, right @ ..] = sums.map(|lanes| lanes.iter().map(|sum| f64::from(*sum)).sum());
    (Matrix3::new(xx, xy, x, xy, yy, y, x, y, one), Vector3::from(right))
}
