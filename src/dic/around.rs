//! Sums over the neighbourhood of every pixel of a map.

use multiversion::multiversion;

use super::lanes::LANES;
use super::vector::{Vector, vectorized};

/// Half the side of the neighbourhood whose residual is taken, px.
pub(super) const RESIDUAL_REACH: usize = 3;

/// Its side.
const SIDE: usize = 2 * RESIDUAL_REACH + 1;

/// The sums down the columns of as many rows as a neighbourhood has.
#[inline(always)]
fn add_columns<V: Vector>(rows: &[f32], stride: usize, columns: &mut [f32]) {
    for x in (0..stride / LANES * LANES).step_by(LANES) {
        let mut sum = V::load(&rows[x..]);
        for k in 1..SIDE {
            sum = sum.add(V::load(&rows[k * stride + x..]));
        }
        sum.store(&mut columns[x..]);
    }
}

/// The sums of the first eight neighbourhoods over their columns.
#[inline(always)]
fn add_along<V: Vector>(columns: &[f32]) -> V {
    let near = &columns[..SIDE - 1 + LANES];
    let mut sum = V::load(near);
    for k in 1..SIDE {
        sum = sum.add(V::load(&near[k..]));
    }
    sum
}

vectorized! {
    /// The sum over the neighbourhood of every value, as far as it lies within.
    pub(super) fn add_around(values: &[f32], stride: usize, columns: &mut [f32], out: &mut [f32]) = add_around_with
}

#[inline(always)]
fn add_around_with<V: Vector>(values: &[f32], stride: usize, columns: &mut [f32], out: &mut [f32]) {
    for row in 0..(values.len() / stride).saturating_sub(SIDE - 1) {
        let rows = &values[row * stride..][..SIDE * stride];
        add_columns::<V>(rows, stride, columns);
        let out = &mut out[(row + RESIDUAL_REACH) * stride + RESIDUAL_REACH..];
        for x in (0..(stride - SIDE) / LANES * LANES).step_by(LANES) {
            add_along::<V>(&columns[x..]).store(&mut out[x..]);
        }
    }
}

vectorized! {
    /// Whether every sum over a neighbourhood is less than `most` times its pixels.
    pub(super) fn are_within(planes: (&[f32], &[f32]), stride: usize, most: f32, columns: &mut [f32]) -> bool = are_within_with
}

#[inline(always)]
fn are_within_with<V: Vector>(
    (values, pixels): (&[f32], &[f32]),
    stride: usize,
    most: f32,
    columns: &mut [f32],
) -> bool {
    let (one, most) = (V::splat(1.0), V::splat(most));
    let mut over = V::splat(0.0);
    for row in 0..(values.len() / stride).saturating_sub(SIDE - 1) {
        let rows = &values[row * stride..][..SIDE * stride];
        add_columns::<V>(rows, stride, columns);
        let pixels = &pixels[(row + RESIDUAL_REACH) * stride + RESIDUAL_REACH..];
        for x in (0..(stride - SIDE) / LANES * LANES).step_by(LANES) {
            over = over.add(one.and(add_along::<V>(&columns[x..]).at_least(most.mul(V::load(&pixels[x..])))));
        }
    }
    over.to_lanes().sum() < 0.5
}

/// Rows of neighbourhoods that are looked at together.
const STRIP: usize = 4;

/// The least value of every column in strips of the rows that have a whole neighbourhood.
pub(super) fn least_of_strips(values: &[f32], stride: usize, least: &mut Vec<f32>) {
    let rows = (values.len() / stride).saturating_sub(2 * RESIDUAL_REACH);
    least.clear();
    least.resize(rows.div_ceil(STRIP) * stride, f32::INFINITY);
    for row in 0..rows {
        let from = &values[(row + RESIDUAL_REACH) * stride..][..stride];
        let to = &mut least[row / STRIP * stride..][..stride];
        to.iter_mut().zip(from).for_each(|(least, value)| *least = least.min(*value));
    }
}

vectorized! {
    /// Whether the sums over all rows that neighbourhoods of a strip hold are less than `most` times the fewest pixels of
    /// one of them: then every neighbourhood is within.
    pub(super) fn are_strips_within(planes: (&[f32], &[f32]), stride: usize, most: f32, columns: &mut [f32]) -> bool =
        are_strips_within_with
}

#[inline(always)]
fn are_strips_within_with<V: Vector>(
    (values, pixels): (&[f32], &[f32]),
    stride: usize,
    most: f32,
    columns: &mut [f32],
) -> bool {
    const ROWS: usize = SIDE - 1 + STRIP;
    let (one, most) = (V::splat(1.0), V::splat(most));
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
            over = over.add(one.and(add_along::<V>(&columns[x..]).at_least(most.mul(V::load(&pixels[x..])))));
        }
    }
    over.to_lanes().sum() < 0.5
}

/// The sum of the square of side 2 `reach` + 1 around every value; nonsense within `reach` rows of the ends.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
pub(super) fn box_sums(values: &[f32], stride: usize, reach: usize, columns: &mut Vec<f32>, out: &mut Vec<f32>) {
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
