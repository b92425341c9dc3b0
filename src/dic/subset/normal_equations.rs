//! Sums for one Gauss-Newton update, in one pass over a reference and an aligned target.

use crate::dic::geometry::{Pixel, SubsetMask};
use crate::dic::image::PaddedImage;
use crate::numeric::{LANES, Lanes, Vector, vectorized};

/// The sums of one pass over the warped target, minus the mean of the reference.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::dic) struct Sums {
    pub(in crate::dic) levels: f64,
    /// The sums of the levels times the offsets from the centre along x and y.
    pub(in crate::dic) first_moments: [f64; 2],
    pub(in crate::dic) energy: f64,
    pub(in crate::dic) product: f64,
    pub(in crate::dic) jacobian: [f64; 6],
}

/// Sums over the pixels of a window.
///
/// f is the grey level of the reference, g that of the target, and J the Jacobian of the affine warp, (gx, gx dx, gx
/// dy, gy, gy dx, gy dy).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(in crate::dic) struct Moments {
    /// The sum of f.
    pub(in crate::dic) reference: f64,
    /// The sum of g.
    pub(in crate::dic) target: f64,
    /// The sums of f f, g g and f g.
    pub(in crate::dic) products: [f64; 3],
    /// The sums of J, J f and J g.
    pub(in crate::dic) jacobian: [[f64; 6]; 3],
    /// The sums of gx gx, gx gy and gy gy, each times 1, dx, dy, dx^2, dx dy, dy^2.
    pub(in crate::dic) second: [[f64; 6]; 3],
}

/// Aligned planes of one shape.
#[derive(Clone, Copy)]
pub(in crate::dic) struct Layers<'a> {
    pub(in crate::dic) reference: &'a PaddedImage,
    pub(in crate::dic) gradient_x: &'a PaddedImage,
    pub(in crate::dic) gradient_y: &'a PaddedImage,
    pub(in crate::dic) target: &'a PaddedImage,
}

vectorized! {
    /// Sums the columns of `window` about `at` into `sums`, one kind of sum after the other: see [`SUMS_PER_COLUMN`].
    ///
    /// The window must lie in the planes, and their values off the mask must be finite.
    fn sum_window(layers: Layers<'_>, window: &SubsetMask, at: Pixel, sums: &mut [f32]) = sum_window_with
}

vectorized! {
    /// Sums the column sums of a window over its columns, with powers of x as weights: see [`TOTALS`].
    ///
    /// `sums` starts at the first column, and `stride` is the distance between the sums of two kinds.
    fn sum_columns(sums: &[f32], stride: usize, window: &SubsetMask, out: &mut [f64; TOTALS]) = sum_columns_with
}

impl Moments {
    /// Computes the sums over `window` centred at `at`.
    ///
    /// The window must lie in the planes, and their values off the mask must be finite. `sums` is scratch memory.
    pub(in crate::dic) fn sum(layers: Layers<'_>, window: &SubsetMask, at: Pixel, sums: &mut Vec<f32>) -> Self {
        let stride = window.extent.size().width.next_multiple_of(LANES) + LANES;
        sums.clear();
        sums.resize(SUMS_PER_COLUMN * stride, 0.0);
        sum_window(layers, window, at, sums);
        collect_moments(sums, stride, window)
    }

    /// Returns the sums over the target's levels minus the mean of the reference.
    ///
    /// `pixels` is the number of pixels of the window. First moments are not known and set to 0.
    pub(in crate::dic) fn target_sums(&self, pixels: usize) -> Sums {
        let (pixels, mean) = (pixels as f64, self.reference / pixels as f64);
        let [_, squares, product] = self.products;
        Sums {
            levels: self.target - pixels * mean,
            first_moments: [0.0; 2],
            energy: squares - 2.0 * mean * self.target + pixels * mean * mean,
            product: product - mean * self.target,
            jacobian: std::array::from_fn(|k| self.jacobian[2][k] - mean * self.jacobian[0][k]),
        }
    }
}

/// The number of sums per column.
///
/// One each of f, g, f f, g g and f g. Two each of gx, gy, gx f, gy f, gx g and gy g, the second a running sum. Three
/// each of gx gx, gx gy and gy gy. A running sum weights its values with the number of rows left.
pub(in crate::dic) const SUMS_PER_COLUMN: usize = PLAIN + 2 * PAIRS + 3 * TRIPLES;

/// The numbers of sums without weights, with weights x and y, and with their squares.
const PLAIN: usize = 5;
const PAIRS: usize = 6;
const TRIPLES: usize = 3;

/// The number of totals over all columns, padded to a multiple of eight.
///
/// One for each plain sum. Of each pair: the first, the first times x, the second. Of each triple: the first, times x
/// and x^2, the second, times x, and the third.
const TOTALS: usize = (PLAIN + 3 * PAIRS + 6 * TRIPLES).next_multiple_of(LANES);

/// The number of blocks of a window whose weights are held at a time.
const BLOCKS: usize = 4;

/// Adds `rows` rows of eight columns, from the pixel with index `first` on, to the sums `all`.
///
/// `mask` returns the mask of a row, or `None` where all pixels belong.
#[inline(always)]
pub(in crate::dic) fn add_rows<V: Vector>(
    all: &mut [V; SUMS_PER_COLUMN],
    layers: Layers<'_>,
    first: usize,
    rows: usize,
    mask: impl Fn(usize) -> Option<V>,
) {
    // A local copy keeps the sums in registers.
    let mut sums = *all;
    let stride = layers.reference.stride();
    let (reference, gradient_x) = (&layers.reference.data()[first..], &layers.gradient_x.data()[first..]);
    let (gradient_y, target) = (&layers.gradient_y.data()[first..], &layers.target.data()[first..]);
    for row in 0..rows {
        let (here, mask) = (row * stride, mask(row));
        let load = |plane: &[f32]| {
            let value = V::load(&plane[here..]);
            mask.map_or(value, |mask| value.mul(mask))
        };
        let (f, gx, gy, g) = (load(reference), load(gradient_x), load(gradient_y), load(target));
        sums[0] = sums[0].add(f);
        sums[1] = sums[1].add(g);
        for (sum, (a, b)) in sums[2..PLAIN].iter_mut().zip([(f, f), (g, g), (f, g)]) {
            *sum = sum.plus_product(a, b);
        }
        for (k, (gradient, at)) in [(gx, 5), (gy, 7)].into_iter().enumerate() {
            sums[at] = sums[at].add(gradient);
            sums[at + 1] = sums[at + 1].add(sums[at]);
            for (level, at) in [(f, 9 + 2 * k), (g, 13 + 2 * k)] {
                sums[at] = sums[at].plus_product(gradient, level);
                sums[at + 1] = sums[at + 1].add(sums[at]);
            }
        }
        for (k, (a, b)) in [(gx, gx), (gx, gy), (gy, gy)].into_iter().enumerate() {
            let at = PLAIN + 2 * PAIRS + 3 * k;
            sums[at] = sums[at].plus_product(a, b);
            sums[at + 1] = sums[at + 1].add(sums[at]);
            sums[at + 2] = sums[at + 2].add(sums[at + 1]);
        }
    }
    *all = sums;
}

/// Computes the sums over the last `rows` rows from the running sums `all` and those `before` these rows.
///
/// `out` receives the index of each sum and its value.
#[inline(always)]
pub(in crate::dic) fn subtract_before<V: Vector>(
    all: &[V; SUMS_PER_COLUMN],
    before: &[f32],
    rows: i32,
    mut out: impl FnMut(usize, V),
) {
    let before = |k: usize| V::load(&before[k * LANES..]);
    for (k, sum) in all.iter().enumerate().take(PLAIN) {
        out(k, sum.sub(before(k)));
    }
    // A running sum grows with every row, and the running sum of a running sum with the triangular numbers.
    let (count, triangle) = (V::splat(-rows as f32), V::splat(-(rows * (rows + 1) / 2) as f32));
    for at in (PLAIN..PLAIN + 2 * PAIRS).step_by(2) {
        let first = before(at);
        out(at, all[at].sub(first));
        out(at + 1, all[at + 1].sub(before(at + 1)).plus_product(first, count));
    }
    for at in (PLAIN + 2 * PAIRS..SUMS_PER_COLUMN).step_by(3) {
        let (first, second) = (before(at), before(at + 1));
        out(at, all[at].sub(first));
        out(at + 1, all[at + 1].sub(second).plus_product(first, count));
        let own = all[at + 2].sub(before(at + 2)).plus_product(second, count);
        out(at + 2, own.plus_product(first, triangle));
    }
}

/// Implements [`sum_window`] on vectors of type `V`.
#[inline(always)]
fn sum_window_with<V: Vector>(layers: Layers<'_>, window: &SubsetMask, at: Pixel, out: &mut [f32]) {
    let stride = out.len() / SUMS_PER_COLUMN;
    for block in &window.blocks {
        let mask = &window.mask[block.start..block.start + block.rows];
        let first = layers.reference.index((at.x + block.dx) as isize, (at.y + block.dy) as isize);
        // Rows left are counted to the last row of the window.
        let rows = (window.extent.bottom - block.dy + 1) as usize;
        let mask = |row: usize| Some(mask.get(row).map_or(V::splat(0.0), V::from_lanes));
        let mut sums = [V::splat(0.0); SUMS_PER_COLUMN];
        add_rows(&mut sums, layers, first, rows, mask);
        let column = (block.dx - window.blocks[0].dx) as usize;
        for (k, sum) in sums.into_iter().enumerate() {
            sum.store(&mut out[k * stride + column..]);
        }
    }
}

/// Combines the column sums of a window to [`Moments`].
///
/// `sums` starts at the first column of the window. `stride` is the distance between the sums of two kinds.
pub(in crate::dic) fn collect_moments(sums: &[f32], stride: usize, window: &SubsetMask) -> Moments {
    let mut totals = [0.0; TOTALS];
    sum_columns(sums, stride, window, &mut totals);
    let (mut out, end) = (Moments::default(), f64::from(window.extent.bottom + 1));
    (out.reference, out.target) = (totals[0], totals[1]);
    out.products.copy_from_slice(&totals[2..PLAIN]);
    let (pairs, triples) = totals[PLAIN..PLAIN + 3 * PAIRS + 6 * TRIPLES].split_at(3 * PAIRS);
    // Rows left, counted from the row after the last.
    for (pair, list) in pairs.as_chunks().0.iter().zip(out.jacobian.as_flattened_mut().as_chunks_mut().0) {
        let [sum, by_x, running] = *pair;
        *list = [sum, by_x, end * sum - running];
    }
    for (triple, list) in triples.as_chunks().0.iter().zip(&mut out.second) {
        let [sum, by_x, by_xx, running, running_x, again] = *triple;
        // The squares of the rows left follow from the triangular numbers.
        let by_yy = end * (end * sum - 2.0 * running) + 2.0 * again - running;
        *list = [sum, by_x, end * sum - running, by_xx, end * by_x - running_x, by_yy];
    }
    out
}

/// Returns `sum` plus the values of some blocks of a row, each times a power (0 to 2) of its x.
///
/// `weights` holds the first column of each block and the powers of x of its lanes.
#[inline(always)]
fn add_weighted<V: Vector>(sum: V, row: &[f32], weights: &[(usize, [V; 3]); BLOCKS], power: usize) -> V {
    weights.iter().fold(sum, |sum, (column, powers)| sum.plus_product(V::load(&row[*column..]), powers[power]))
}

/// Implements [`sum_columns`] on vectors of type `V`.
#[inline(always)]
fn sum_columns_with<V: Vector>(sums: &[f32], stride: usize, window: &SubsetMask, out: &mut [f64; TOTALS]) {
    let (Some(first), right) = (window.blocks.first(), V::splat(window.extent.right as f32)) else { return };
    let mut totals = [V::splat(0.0); TOTALS];
    for blocks in window.blocks.chunks(BLOCKS) {
        // Missing blocks have zero weight.
        let mut weights = [(0, [V::splat(0.0); 3]); BLOCKS];
        for (weights, block) in weights.iter_mut().zip(blocks) {
            let x = V::splat(block.dx as f32).add(V::from_lanes(&Lanes::INDEX));
            let belongs = right.at_least(x);
            let powers = [V::splat(1.0), x, x.mul(x)].map(|power| power.and(belongs));
            *weights = ((block.dx - first.dx) as usize, powers);
        }
        let rows = |at: usize| &sums[at * stride..];
        for (k, total) in totals[..PLAIN].iter_mut().enumerate() {
            *total = add_weighted(*total, rows(k), &weights, 0);
        }
        let (pairs, triples) = totals[PLAIN..].split_at_mut(3 * PAIRS);
        for (k, total) in pairs.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let at = PLAIN + 2 * k;
            for (total, (row, power)) in total.iter_mut().zip([(at, 0), (at, 1), (at + 1, 0)]) {
                *total = add_weighted(*total, rows(row), &weights, power);
            }
        }
        for (k, total) in triples.as_chunks_mut::<6>().0.iter_mut().take(TRIPLES).enumerate() {
            let at = PLAIN + 2 * PAIRS + 3 * k;
            let all = [(at, 0), (at, 1), (at, 2), (at + 1, 0), (at + 1, 1), (at + 2, 0)];
            for (total, (row, power)) in total.iter_mut().zip(all) {
                *total = add_weighted(*total, rows(row), &weights, power);
            }
        }
    }
    for (group, out) in totals.as_chunks().0.iter().zip(out.chunks_exact_mut(LANES)) {
        out.iter_mut().zip(V::sums(group).0).for_each(|(out, sum)| *out = f64::from(sum));
    }
}

#[cfg(test)]
pub(in crate::dic) mod tests {
    use super::*;
    use crate::dic::geometry::WindowShape;
    use crate::numeric::Portable;

    pub(in crate::dic) fn plane(seed: u32) -> PaddedImage {
        plane_of(seed, 60, 50)
    }

    pub(in crate::dic) fn plane_of(seed: u32, width: usize, height: usize) -> PaddedImage {
        let mut plane = PaddedImage::default();
        plane.reshape(width, height);
        let mut state = seed;
        for y in 0..height {
            for value in plane.row_mut(y) {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *value = (state >> 24) as f32 - 128.0;
            }
        }
        plane
    }

    /// The reference implementation, pixel by pixel in double precision.
    pub(in crate::dic) fn slow(planes: &[PaddedImage; 4], window: &SubsetMask, at: Pixel) -> Moments {
        let mut out = Moments::default();
        for (dx, dy) in (-31..=31).flat_map(|dy| (-31..=31).map(move |dx| (dx, dy))) {
            if !window.contains(dx, dy) {
                continue;
            }
            let value = |k: usize| f64::from(planes[k].row((at.y + dy) as usize)[(at.x + dx) as usize]);
            let (f, gx, gy, g, x, y) = (value(0), value(1), value(2), value(3), f64::from(dx), f64::from(dy));
            out.reference += f;
            out.target += g;
            for (sum, value) in out.products.iter_mut().zip([f * f, g * g, f * g]) {
                *sum += value;
            }
            for (sums, factor) in out.jacobian.iter_mut().zip([1.0, f, g]) {
                for (sum, value) in sums.iter_mut().zip([gx, gx * x, gx * y, gy, gy * x, gy * y]) {
                    *sum += factor * value;
                }
            }
            for (sums, product) in out.second.iter_mut().zip([gx * gx, gx * gy, gy * gy]) {
                for (sum, power) in sums.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
                    *sum += product * power;
                }
            }
        }
        out
    }

    pub(in crate::dic) fn all(m: &Moments) -> Vec<f64> {
        let lists = m.jacobian.iter().chain(&m.second).flatten();
        [m.reference, m.target].iter().chain(&m.products).chain(lists).copied().collect()
    }

    #[test]
    fn sums_equal_the_reference_implementation_on_every_machine() {
        let planes = [plane(1), plane(2), plane(3), plane(4)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        for (shape, size) in [(WindowShape::Square, 31), (WindowShape::Circle, 29), (WindowShape::Ring, 21)] {
            let window = SubsetMask::new(shape, size);
            let at = Pixel { x: 30, y: 24 };
            let mut memory = Vec::new();
            let found = Moments::sum(layers, &window, at, &mut memory);
            let mut plain = vec![0.0; memory.len()];
            sum_window_with::<Portable>(layers, &window, at, &mut plain);
            assert!(memory == plain);
            let (count, mut totals) = (plain.len() / SUMS_PER_COLUMN, [[0.0; TOTALS]; 2]);
            sum_columns(&plain, count, &window, &mut totals[0]);
            sum_columns_with::<Portable>(&plain, count, &window, &mut totals[1]);
            assert_eq!(totals[0].map(f64::to_bits), totals[1].map(f64::to_bits));
            for (found, expected) in all(&found).iter().zip(all(&slow(&planes, &window, at))) {
                // With random signs the sums are far smaller than their terms, up to 128^2 15^2 per pixel.
                assert!((found - expected).abs() < 1e-6 * expected.abs() + 60.0, "{found} {expected}");
            }
        }
    }
}
