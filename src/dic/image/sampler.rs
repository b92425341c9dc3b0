//! Samples eight pixels of the warped target at a time.

use super::interpolation::InterpolatedImage;
use crate::numeric::{LANES, Lanes, Vector};

/// Returns the levels of the target, DN, at (x + lane (1 + ux), y + lane vx) px for the eight lanes.
///
/// In a mildly deformed subset neighbouring pixels read neighbouring cells. Each lane lies in the cell next to its left
/// neighbour's, or one further along x or y. One contiguous load per tap therefore serves all lanes, and lanes one cell
/// further get their weights shifted by one tap. Stronger deformation (8 degrees and more) is sampled lane by lane.
///
/// `N` is the number of taps of the target's kernel, `M` is `N` + 1.
#[inline(always)]
pub(in crate::dic) fn sample_lanes<V: Vector, const N: usize, const M: usize>(
    target: &InterpolatedImage,
    x: f64,
    y: f64,
    ux: f64,
    vx: f64,
) -> V {
    let last = (LANES - 1) as f64;
    if (last * ux).abs() >= 1.0 || (last * vx).abs() >= 1.0 {
        return V::from_lanes(&sample_scattered(target, x, y, ux, vx));
    }
    let (end_x, end_y) = (x + last * ux, y + last * vx);
    let (cell_x, cell_y) = (x.min(end_x).floor(), y.min(end_y).floor());
    let (along_x, along_y) = (lane_positions::<V>(x - cell_x, ux), lane_positions::<V>(y - cell_y, vx));
    let (rows, stride) = target.taps::<N>(cell_x as isize, cell_y as isize);
    let taps = Taps { rows, stride };
    // Slightly early: a lane that rounds up to 1 must find its second cell.
    let (wide_x, wide_y) = (x.max(end_x) - cell_x >= 0.999_999, y.max(end_y) - cell_y >= 0.999_999);
    match (wide_x, wide_y) {
        (false, false) => {
            taps.weighted_sum(&target.lane_weights::<V, N>(along_x), &target.lane_weights::<V, N>(along_y))
        }
        (false, true) => {
            taps.weighted_sum(&target.lane_weights::<V, N>(along_x), &widened_weights::<V, N, M>(target, along_y))
        }
        (true, false) => {
            taps.weighted_sum(&widened_weights::<V, N, M>(target, along_x), &target.lane_weights::<V, N>(along_y))
        }
        (true, true) => taps
            .weighted_sum(&widened_weights::<V, N, M>(target, along_x), &widened_weights::<V, N, M>(target, along_y)),
    }
}

/// Returns the positions `start` + lane x `drift` of the eight lanes.
#[inline(always)]
pub(in crate::dic) fn lane_positions<V: Vector>(start: f64, drift: f64) -> V {
    V::splat(start as f32).add(V::from_lanes(&Lanes::INDEX).mul(V::splat(drift as f32)))
}

/// Samples at the positions of [`sample_lanes`] lane by lane, for any deformation.
///
/// Positions outside the image, which lanes off the mask may have, are clamped to its edge.
#[inline(never)]
fn sample_scattered(target: &InterpolatedImage, x: f64, y: f64, ux: f64, vx: f64) -> Lanes {
    let (right, bottom) = (target.width() as f64 - 1.0, target.height() as f64 - 1.0);
    let mut lanes = Lanes::splat(0.0);
    for (lane, value) in lanes.0.iter_mut().enumerate() {
        let (x, y) = (x + lane as f64 * (1.0 + ux), y + lane as f64 * vx);
        *value = target.value_at(x.clamp(0.0, right), y.clamp(0.0, bottom));
    }
    lanes
}

/// The coefficients from the first tap of a block of lanes on.
pub(in crate::dic) struct Taps<'a> {
    rows: &'a [f32],
    stride: usize,
}

impl<'a> Taps<'a> {
    /// Starts at the tap of this index in the coefficients of `target`.
    #[inline(always)]
    pub(in crate::dic) fn starting_at(target: &'a InterpolatedImage, first: usize) -> Self {
        let (rows, stride) = target.taps_from(first);
        Self { rows, stride }
    }

    /// Returns the interpolated levels: the sum of the taps times the weights of each lane along x and along y.
    #[inline(always)]
    pub(in crate::dic) fn weighted_sum<V: Vector, const X: usize, const Y: usize>(
        &self,
        weights_x: &[V; X],
        weights_y: &[V; Y],
    ) -> V {
        let mut total = V::splat(0.0);
        for (row, weight) in weights_y.iter().enumerate() {
            let taps = &self.rows[row * self.stride..][..2 * LANES];
            let mut sum = V::splat(0.0);
            for (column, weight) in weights_x.iter().enumerate() {
                sum = sum.plus_product(*weight, V::load(&taps[column..]));
            }
            total = total.plus_product(*weight, sum);
        }
        total
    }
}

/// The number of filtered rows that are kept: at least the number of taps, and a power of two.
const RING: usize = 8;

/// A column of blocks of a shifted target, where all pixels share their weights.
///
/// Each row is filtered along x once and kept for the `N` rows that need it.
pub(in crate::dic) struct ShiftedRows<'a, V, const N: usize> {
    rows: &'a [f32],
    stride: usize,
    weights_x: [V; N],
    weights_y: [V; N],
    /// The last rows, filtered along x, in a ring buffer. Moving rows would wait for their own stores.
    filtered: [V; RING],
    /// The number of rows filtered so far.
    count: usize,
}

impl<'a, V: Vector, const N: usize> ShiftedRows<'a, V, N> {
    /// Starts at the position (x, y) px in the target of the first lane in the first row.
    #[inline(always)]
    pub(in crate::dic) fn new(target: &'a InterpolatedImage, x: f64, y: f64) -> Self {
        let (cell_x, cell_y) = (x.floor(), y.floor());
        let (rows, stride) = target.taps::<N>(cell_x as isize, cell_y as isize);
        let weights_x = target.lane_weights(V::splat((x - cell_x) as f32));
        let weights_y = target.lane_weights(V::splat((y - cell_y) as f32));
        let mut column = Self { rows, stride, weights_x, weights_y, filtered: [V::splat(0.0); RING], count: 0 };
        for _ in 1..N {
            column.filter_next();
        }
        column
    }

    /// Filters the next row along x.
    #[inline(always)]
    fn filter_next(&mut self) {
        let taps = &self.rows[..2 * LANES];
        let mut sum = V::splat(0.0);
        for (column, weight) in self.weights_x.iter().enumerate() {
            sum = sum.plus_product(*weight, V::load(&taps[column..]));
        }
        self.rows = &self.rows[self.stride..];
        self.filtered[self.count % RING] = sum;
        self.count += 1;
    }

    /// Returns the eight interpolated levels of the next row.
    #[inline(always)]
    pub(in crate::dic) fn next_row(&mut self) -> V {
        self.filter_next();
        let first = self.count - N;
        let mut total = V::splat(0.0);
        for (tap, weight) in self.weights_y.iter().enumerate() {
            total = total.plus_product(*weight, self.filtered[(first + tap) % RING]);
        }
        total
    }
}

/// Returns the weights of `M` = `N` + 1 taps for lanes at fractions of 0 to 2, shifted by one tap for those in the
/// second cell.
#[inline(always)]
pub(in crate::dic) fn widened_weights<V: Vector, const N: usize, const M: usize>(
    target: &InterpolatedImage,
    fraction: V,
) -> [V; M] {
    let one = V::splat(1.0);
    let second = fraction.at_least(one);
    let weights = target.lane_weights::<V, N>(fraction.sub(one.and(second)));
    let none = V::splat(0.0);
    // Not a closure, which would not be compiled for the instruction set of its caller.
    let mut wide = [V::select(second, none, weights[0]); M];
    for tap in 1..N {
        wide[tap] = V::select(second, weights[tap - 1], weights[tap]);
    }
    wide[N] = V::select(second, weights[N - 1], none);
    wide
}

#[cfg(test)]
mod tests {
    use super::super::padded_image::PaddedImage;
    use super::*;
    use crate::dic::image::Interpolation;
    use crate::numeric::Portable;

    fn waves() -> InterpolatedImage {
        let mut plane = PaddedImage::default();
        plane.reshape(60, 50);
        for y in 0..50 {
            for (x, value) in plane.row_mut(y).iter_mut().enumerate() {
                let (x, y) = (x as f32, y as f32);
                *value = 100.0 * (x * x * 0.02 + y).sin() + 80.0 * (x * 1.1 - y * 0.4).cos();
            }
        }
        plane.mirror_margin();
        InterpolatedImage::new(&plane, Interpolation::Optimised)
    }

    #[test]
    fn eight_at_a_time_equals_one_at_a_time_at_any_deformation_and_on_any_machine() {
        let target = waves();
        for case in 0..400 {
            let (ux, vx) = (f64::from(case % 20 - 10) * 0.017, f64::from(case / 20 - 10) * 0.016);
            let at = (20.0 + f64::from(case) * 0.013, 22.0 - f64::from(case) * 0.017);
            let found = sample_lanes::<Portable, 6, 7>(&target, at.0, at.1, ux, vx).to_lanes();
            for lane in 0..LANES {
                let offset = lane as f64;
                let expected = target.value_at(at.0 + offset * (1.0 + ux), at.1 + offset * vx);
                assert!((found.0[lane] - expected).abs() < 2e-3, "{ux} {vx} {at:?} lane {lane}");
            }
        }
    }

    #[test]
    fn lanes_far_outside_the_image_do_not_spoil_those_inside() {
        let target = waves();
        for (at, ux, vx) in [((50.0, 45.0), 0.9, 1.4), ((3.0, 2.0), -2.5, -1.7), ((58.0, 48.0), 3.0, 3.0)] {
            let found = sample_lanes::<Portable, 6, 7>(&target, at.0, at.1, ux, vx).to_lanes();
            assert!((found.0[0] - target.value_at(at.0, at.1)).abs() < 1e-3, "{at:?}: {found:?}");
            assert!(found.0.iter().all(|value| value.is_finite()));
        }
    }

    #[test]
    fn the_column_of_a_pure_shift_equals_the_warped_one() {
        let target = waves();
        for case in 0..50 {
            let (x, y) = (17.0 + f64::from(case) * 0.173, 15.0 - f64::from(case) * 0.091);
            let mut column = ShiftedRows::<Portable, 6>::new(&target, x, y);
            for row in 0..9 {
                let expected = sample_lanes::<Portable, 6, 7>(&target, x, y + f64::from(row), 0.0, 0.0).to_lanes();
                let found = column.next_row().to_lanes();
                for lane in 0..LANES {
                    assert!((found.0[lane] - expected.0[lane]).abs() < 1e-3, "{x} {y} row {row} lane {lane}");
                }
            }
        }
    }
}
