//! Box filters: sums over a square neighbourhood of every pixel.

use multiversion::multiversion;

use crate::numeric::{LANES, Vector, vectorized};

/// Half the side of the neighbourhood over which residuals are summed, px.
pub(in crate::dic) const RESIDUAL_REACH: usize = 3;

/// The side of that neighbourhood, px.
const SIDE: usize = 2 * RESIDUAL_REACH + 1;

/// Sums each column of `rows`, with this row stride, over [`SIDE`] rows into `columns`.
#[inline(always)]
fn sum_columns<V: Vector>(rows: &[f32], stride: usize, columns: &mut [f32]) {
    for x in (0..stride / LANES * LANES).step_by(LANES) {
        let mut sum = V::load(&rows[x..]);
        for k in 1..SIDE {
            sum = sum.add(V::load(&rows[k * stride + x..]));
        }
        sum.store(&mut columns[x..]);
    }
}

/// Returns the sums over eight adjacent neighbourhoods from their column sums.
#[inline(always)]
fn sum_neighbourhoods<V: Vector>(columns: &[f32]) -> V {
    let near = &columns[..SIDE - 1 + LANES];
    let mut sum = V::load(near);
    for k in 1..SIDE {
        sum = sum.add(V::load(&near[k..]));
    }
    sum
}

vectorized! {
    /// Computes the sum over the [`SIDE`] x [`SIDE`] neighbourhood of every value whose neighbourhood lies inside.
    ///
    /// `values` and `out` are planes with this row stride, a multiple of [`LANES`]. All other values of `out` are kept,
    /// and so are those of the last one to eight columns with a neighbourhood, which must be padding. `columns` is
    /// scratch memory for one row.
    pub(in crate::dic) fn neighbourhood_sums(values: &[f32], stride: usize, columns: &mut [f32], out: &mut [f32]) =
        neighbourhood_sums_with
}

/// Implements [`neighbourhood_sums`] on vectors of type `V`.
#[inline(always)]
fn neighbourhood_sums_with<V: Vector>(values: &[f32], stride: usize, columns: &mut [f32], out: &mut [f32]) {
    for row in 0..(values.len() / stride).saturating_sub(SIDE - 1) {
        let rows = &values[row * stride..][..SIDE * stride];
        sum_columns::<V>(rows, stride, columns);
        let out = &mut out[(row + RESIDUAL_REACH) * stride + RESIDUAL_REACH..];
        for x in (0..(stride - SIDE) / LANES * LANES).step_by(LANES) {
            sum_neighbourhoods::<V>(&columns[x..]).store(&mut out[x..]);
        }
    }
}

vectorized! {
    /// Whether every neighbourhood sum of `values` is less than `limit` times the number of its pixels.
    ///
    /// `pixels` holds that number for each value. Stride, `columns` and the columns that are left out are those of
    /// [`neighbourhood_sums`].
    pub(in crate::dic) fn are_within(
        values: &[f32],
        pixels: &[f32],
        stride: usize,
        limit: f32,
        columns: &mut [f32],
    ) -> bool = are_within_with
}

/// Implements [`are_within`] on vectors of type `V`.
#[inline(always)]
fn are_within_with<V: Vector>(values: &[f32], pixels: &[f32], stride: usize, limit: f32, columns: &mut [f32]) -> bool {
    let (one, limit) = (V::splat(1.0), V::splat(limit));
    let mut over = V::splat(0.0);
    for row in 0..(values.len() / stride).saturating_sub(SIDE - 1) {
        let rows = &values[row * stride..][..SIDE * stride];
        sum_columns::<V>(rows, stride, columns);
        let pixels = &pixels[(row + RESIDUAL_REACH) * stride + RESIDUAL_REACH..];
        for x in (0..(stride - SIDE) / LANES * LANES).step_by(LANES) {
            over = over.add(one.and(sum_neighbourhoods::<V>(&columns[x..]).at_least(limit.mul(V::load(&pixels[x..])))));
        }
    }
    over.to_lanes().sum() < 0.5
}

/// The number of neighbourhood rows that one strip covers.
const STRIP: usize = 4;

/// Computes the column minima over strips of [`STRIP`] rows among the rows that have a whole neighbourhood.
pub(in crate::dic) fn strip_minima(values: &[f32], stride: usize, minima: &mut Vec<f32>) {
    let rows = (values.len() / stride).saturating_sub(2 * RESIDUAL_REACH);
    minima.clear();
    minima.resize(rows.div_ceil(STRIP) * stride, f32::INFINITY);
    for row in 0..rows {
        let from = &values[(row + RESIDUAL_REACH) * stride..][..stride];
        let to = &mut minima[row / STRIP * stride..][..stride];
        to.iter_mut().zip(from).for_each(|(minima, value)| *minima = minima.min(*value));
    }
}

vectorized! {
    /// Whether the sums over the union of the neighbourhoods in each strip are less than `limit` times the smallest
    /// pixel count of one of them. This is sufficient for [`are_within`].
    ///
    /// `pixels` holds the [`strip_minima`] of the pixel counts. `columns` is scratch memory for one row.
    pub(in crate::dic) fn are_strips_within(
        values: &[f32],
        pixels: &[f32],
        stride: usize,
        limit: f32,
        columns: &mut [f32],
    ) -> bool = are_strips_within_with
}

/// Implements [`are_strips_within`] on vectors of type `V`.
#[inline(always)]
fn are_strips_within_with<V: Vector>(
    values: &[f32],
    pixels: &[f32],
    stride: usize,
    limit: f32,
    columns: &mut [f32],
) -> bool {
    const ROWS: usize = SIDE - 1 + STRIP;
    let (one, limit) = (V::splat(1.0), V::splat(limit));
    let mut over = V::splat(0.0);
    let count = values.len() / stride;
    for (strip, pixels) in pixels.chunks_exact(stride).enumerate() {
        // The last strip may have fewer rows.
        let first = (strip * STRIP).min(count - ROWS.min(count));
        let rows = &values[first * stride..][..ROWS.min(count) * stride];
        for x in (0..stride / LANES * LANES).step_by(LANES) {
            let mut sums = [V::splat(0.0); 2];
            for (k, row) in rows.chunks_exact(stride).enumerate() {
                sums[k % 2] = sums[k % 2].add(V::load(&row[x..]));
            }
            sums[0].add(sums[1]).store(&mut columns[x..]);
        }
        let pixels = &pixels[RESIDUAL_REACH..];
        for x in (0..(stride - SIDE) / LANES * LANES).step_by(LANES) {
            over = over.add(one.and(sum_neighbourhoods::<V>(&columns[x..]).at_least(limit.mul(V::load(&pixels[x..])))));
        }
    }
    over.to_lanes().sum() < 0.5
}

/// Computes the sum over the square of side 2 `reach` + 1 around every value of a plane with this row stride.
///
/// Sums within `reach` of the edges are undefined. `columns` is scratch memory.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
pub(in crate::dic) fn box_sums(
    values: &[f32],
    stride: usize,
    reach: usize,
    columns: &mut Vec<f32>,
    out: &mut Vec<f32>,
) {
    for plane in [&mut *columns, &mut *out] {
        plane.clear();
        plane.resize(values.len(), 0.0);
    }
    let inner = reach * stride..values.len().saturating_sub(reach * stride).max(reach * stride);
    for shift in 0..=2 * reach {
        let from = &values[shift * stride..][..inner.len()];
        columns[inner.clone()].iter_mut().zip(from).for_each(|(sum, value)| *sum += value);
    }
    let inner = reach..values.len() - reach;
    for shift in 0..=2 * reach {
        let from = &columns[shift..][..inner.len()];
        out[inner.clone()].iter_mut().zip(from).for_each(|(sum, value)| *sum += value);
    }
}
