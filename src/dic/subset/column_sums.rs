//! Column sums shared by overlapping subsets.
//!
//! Sums run down each column from the first row of the first subset. The sum over a subset is the difference between
//! the running sums after its last and before its first row.

use super::normal_equations::{Layers, Moments, SUMS_PER_COLUMN, add_rows, collect_moments, subtract_before};
use crate::dic::geometry::{Pixel, Size, SubsetMask};
use crate::numeric::{LANES, Vector, vectorized};
use std::ops::Range;

/// The number of subset rows that are summed at a time, which bounds the memory.
const BAND: usize = 16;

/// A range of rows of eight columns, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::dic) struct Strip {
    /// The first column.
    pub(in crate::dic) left: i32,
    /// The first row.
    pub(in crate::dic) top: i32,
    /// The row after the last.
    pub(in crate::dic) end: i32,
}

/// Column sums of subsets of one shape.
#[derive(Debug, Clone, Default)]
pub(in crate::dic) struct ColumnSums {
    /// The first column of all subsets.
    left: i32,
    /// The number of columns, a multiple of eight, which is the distance between the sums of two kinds.
    stride: usize,
    /// The first rows of the subsets, ascending.
    tops: Vec<i32>,
    /// The columns and rows of a subset.
    size: Size,
    /// Whether a subset covers each group of eight columns, by first row.
    needed: Vec<bool>,
    strips: Vec<Strip>,
    /// The first rows whose subsets are summed.
    summed: Range<usize>,
    /// The sums of every column, one kind after the other, by first row of a subset.
    sums: Vec<f32>,
    /// The running sums before the first row of each subset.
    before: Vec<f32>,
}

/// The first rows of the subsets that cover eight columns, and the number of rows of each subset.
struct NeededRows<'a> {
    tops: &'a [i32],
    is_needed: &'a [bool],
    rows: i32,
}

vectorized! {
    /// Sums eight columns from `left` on over the rows of each needed subset.
    ///
    /// `out` holds the sums by first row and kind, each `stride` columns wide. `before` is scratch memory for the
    /// running sums.
    fn sum_down(
        layers: Layers<'_>,
        left: i32,
        needed: &NeededRows<'_>,
        before: &mut [f32],
        out: &mut [f32],
        stride: usize,
    ) = sum_down_with
}

impl ColumnSums {
    /// Plans the sums over subsets of the shape of `window` about these centres, px. Forgets earlier sums.
    ///
    /// Without a centre there are no strips.
    pub(in crate::dic) fn plan(&mut self, window: &SubsetMask, centers: impl Iterator<Item = Pixel> + Clone) {
        let extent = window.extent;
        self.size = extent.size();
        self.tops.clear();
        self.tops.extend(centers.clone().map(|at| at.y + extent.top));
        self.tops.sort_unstable();
        self.tops.dedup();
        let lefts = centers.clone().map(|at| at.x + extent.left);
        let (first, last) = lefts.fold((i32::MAX, i32::MIN), |ends, x| (ends.0.min(x), ends.1.max(x)));
        self.left = first;
        self.strips.clear();
        self.needed.clear();
        self.summed = 0..0;
        if first > last {
            return;
        }
        // The last block of a window is padded to eight columns.
        self.stride = ((last - first) as usize + self.size.width + LANES - 1).next_multiple_of(LANES);
        self.needed.resize(self.stride / LANES * self.tops.len(), false);
        for Pixel { x, y } in centers {
            let (from, top) = ((x + extent.left - first) as usize, self.row_of_top(y + extent.top));
            for block in from / LANES..=(from + self.size.width - 1) / LANES {
                self.needed[block * self.tops.len() + top] = true;
            }
        }
        self.merge_strips();
    }

    /// Returns the index in `tops` of the subsets whose first row is `top`.
    fn row_of_top(&self, top: i32) -> usize {
        self.tops.partition_point(|other| *other < top)
    }

    /// Merges the rows of overlapping subsets into strips.
    fn merge_strips(&mut self) {
        for (block, needed) in self.needed.chunks_exact(self.tops.len()).enumerate() {
            let left = self.left + (block * LANES) as i32;
            for (top, _) in self.tops.iter().zip(needed).filter(|(_, needed)| **needed) {
                let end = top + self.size.height as i32;
                match self.strips.last_mut() {
                    Some(strip) if strip.left == left && strip.end >= *top => strip.end = end,
                    _ => self.strips.push(Strip { left, top: *top, end }),
                }
            }
        }
    }

    /// The strips that the sums cover.
    pub(in crate::dic) fn strips(&self) -> &[Strip] {
        &self.strips
    }

    /// Returns the sums over a planned square subset centred at `at`.
    ///
    /// Sums its columns first, with those of up to [`BAND`] rows of subsets, unless they are summed. Access in row
    /// order is therefore fastest. `layers` must be the same since [`Self::plan`].
    ///
    /// # Panics
    ///
    /// If the centre lies beyond the planned columns or rows. Another centre that was not planned has wrong sums.
    pub(in crate::dic) fn moments(&mut self, layers: Layers<'_>, window: &SubsetMask, at: Pixel) -> Moments {
        let (left, top) = (at.x + window.extent.left, at.y + window.extent.top);
        let place = self.row_of_top(top);
        if !self.summed.contains(&place) {
            self.sum_band(layers, place..self.tops.len().min(place + BAND));
        }
        let sums =
            &self.sums[(place - self.summed.start) * SUMS_PER_COLUMN * self.stride..][..SUMS_PER_COLUMN * self.stride];
        collect_moments(&sums[(left - self.left) as usize..], self.stride, window)
    }

    /// Sums the columns of all subsets whose first rows have the indices `band` in `tops`.
    fn sum_band(&mut self, layers: Layers<'_>, band: Range<usize>) {
        self.sums.resize(self.sums.len().max(band.len() * SUMS_PER_COLUMN * self.stride), 0.0);
        self.before.resize(self.before.len().max(band.len() * SUMS_PER_COLUMN * LANES), 0.0);
        let (tops, rows) = (&self.tops[band.clone()], self.size.height as i32);
        for (block, is_needed) in self.needed.chunks_exact(self.tops.len()).enumerate() {
            let needed = NeededRows { tops, is_needed: &is_needed[band.clone()], rows };
            let left = self.left + (block * LANES) as i32;
            sum_down(layers, left, &needed, &mut self.before, &mut self.sums[block * LANES..], self.stride);
        }
        self.summed = band;
    }
}

/// Implements [`sum_down`] on vectors of type `V`.
#[inline(always)]
fn sum_down_with<V: Vector>(
    layers: Layers<'_>,
    left: i32,
    needed: &NeededRows<'_>,
    before: &mut [f32],
    out: &mut [f32],
    stride: usize,
) {
    const SIZE: usize = SUMS_PER_COLUMN * LANES;
    let NeededRows { tops, is_needed, rows } = *needed;
    let (mut sums, mut row) = ([V::splat(0.0); SUMS_PER_COLUMN], i32::MIN);
    let next = |from: usize| (from..tops.len()).find(|k| is_needed[*k]).unwrap_or(tops.len());
    let (mut opens, mut closes) = (next(0), next(0));
    while closes < tops.len() {
        let end = tops[closes] + rows;
        let begins = tops.get(opens).filter(|top| **top < end).copied();
        let to = begins.unwrap_or(end);
        if opens == closes {
            // No subset is open: start again.
            sums.fill(V::splat(0.0));
            row = to;
        }
        let first = layers.reference.index(left as isize, row as isize);
        add_rows(&mut sums, layers, first, (to - row) as usize, |_| None);
        row = to;
        if begins.is_some() {
            for (sum, kept) in sums.iter().zip(before[opens * SIZE..].chunks_exact_mut(LANES)) {
                sum.store(kept);
            }
            opens = next(opens + 1);
        } else {
            subtract_before(&sums, &before[closes * SIZE..][..SIZE], rows, |k, own| {
                own.store(&mut out[(closes * SUMS_PER_COLUMN + k) * stride..]);
            });
            closes = next(closes + 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::normal_equations::tests::{all, plane, plane_of, slow};
    use super::*;
    use crate::dic::geometry::WindowShape;
    use crate::numeric::Portable;

    #[test]
    fn the_sums_of_every_subset_equal_the_reference_implementation() {
        let planes = [plane(1), plane(2), plane(3), plane(4)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        for (size, step) in [(9, 4), (17, 5), (9, 14), (31, 6), (21, 1)] {
            let window = SubsetMask::new(WindowShape::Square, size);
            let half = size as i32 / 2;
            // First rows and columns differ, and some subsets are left out.
            let places = |side: i32| (half..side - half).step_by(step);
            let centers = places(50).flat_map(|y| places(60).map(move |x| (x + y % 2, y)));
            let centers = centers.filter(|(x, y)| (x + 3 * y) % 4 != 0 && x + half < 60);
            let centers = centers.map(|(x, y)| Pixel { x, y });
            let mut columns = ColumnSums::default();
            columns.plan(&window, centers.clone());
            for at in centers {
                let found = all(&columns.moments(layers, &window, at));
                let expected = all(&slow(&planes, &window, at));
                for (found, expected) in found.iter().zip(expected) {
                    let error = (found - expected).abs();
                    assert!(error < 1e-5 * expected.abs() + 600.0, "{size} {at:?}: {found} {expected}");
                }
            }
        }
    }

    /// Sixteen rows of subsets of 61 px that overlap by a third: the sums run on over 661 rows.
    #[test]
    fn long_running_sums_do_not_change_the_displacement() {
        let planes = [1, 2, 3, 4].map(|seed| plane_of(seed, 80, 662));
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        let window = SubsetMask::new(WindowShape::Square, 61);
        let centers = (0..16).map(|k| Pixel { x: 32, y: 30 + 40 * k });
        let mut columns = ColumnSums::default();
        columns.plan(&window, centers.clone());
        for at in centers {
            let (found, exact) = (columns.moments(layers, &window, at), slow(&planes, &window, at));
            // Errors of u, ux and uy (px, px/px) that follow from errors of the right-hand side, through the sums of
            // squares of gx, gx dx and gx dy.
            let squares = [0, 3, 5].map(|k| exact.second[0][k]);
            for k in 0..3 {
                let error = (found.jacobian[2][k] - exact.jacobian[2][k]).abs() / squares[k];
                assert!(error < 1e-6, "{at:?}: {k} off by {error}");
                let share = found.second[0][[0, 3, 5][k]] / squares[k] - 1.0;
                assert!(share.abs() < 1e-4, "{at:?}: {k} {share}");
            }
        }
    }

    #[test]
    fn strips_cover_every_needed_pixel_and_no_row_between() {
        let window = SubsetMask::new(WindowShape::Square, 9);
        let centers = [(10, 10), (30, 12), (12, 40), (11, 19)].map(|(x, y)| Pixel { x, y });
        let mut columns = ColumnSums::default();
        columns.plan(&window, centers.into_iter());
        for (x, y) in (0..60).flat_map(|y| (0..60).map(move |x| (x, y))) {
            let holds =
                |strip: &Strip| (strip.left..strip.left + 8).contains(&x) && (strip.top..strip.end).contains(&y);
            let found = columns.strips().iter().filter(|strip| holds(strip)).count();
            let needed = centers.iter().any(|center| window.contains(x - center.x, y - center.y));
            let row = centers.iter().any(|center| (center.y - y).abs() <= 4);
            assert!(found <= 1 && (found == 1 || !needed) && (found == 0 || row), "{x} {y}");
        }
        columns.plan(&window, [].into_iter());
        assert!(columns.strips().is_empty());
    }

    #[test]
    fn sums_are_equal_on_every_machine() {
        let planes = [plane(5), plane(6), plane(7), plane(8)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        let needed = NeededRows { tops: &[2, 5, 11, 40], is_needed: &[true, false, true, true], rows: 9 };
        let mut sums = [vec![0.0; 4 * SUMS_PER_COLUMN * 8], vec![0.0; 4 * SUMS_PER_COLUMN * 8]];
        let mut before = vec![0.0; 4 * SUMS_PER_COLUMN * 8];
        sum_down(layers, 3, &needed, &mut before, &mut sums[0], 8);
        sum_down_with::<Portable>(layers, 3, &needed, &mut before, &mut sums[1], 8);
        assert_eq!(sums[0], sums[1]);
    }
}
