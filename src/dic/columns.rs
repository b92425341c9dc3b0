//! Subsets side by side share most of their columns: what is summed down a column is summed once for all of them.

use super::lanes::LANES;
use super::moments::{DOWN, Layers, Moments, SUMS, down, fold, total};
use super::vector::{Vector, vectorized};
use super::window::Window;

/// Sums down the columns of a row of square subsets.
#[derive(Debug, Clone, Default)]
pub(super) struct Columns {
    /// First column and first row.
    first: (i32, i32),
    /// Columns; none while nothing is summed.
    count: usize,
    /// Of every column one sum after the other.
    sums: Vec<f32>,
}

vectorized! {
    /// Sums down some columns, a multiple of eight, from the pixel `first` on; `size` is how many columns and rows.
    fn sum_down(layers: Layers<'_>, first: (i32, i32), size: (usize, usize), sums: &mut [f32]) = sum_down_with
}

vectorized! {
    /// The sums over a square window; `place` is the number of its first column, and of all columns.
    fn gather(sums: &[f32], window: &Window, place: (usize, usize), out: &mut Moments) = gather_with
}

impl Columns {
    /// Forgets the pictures.
    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// The sums over a square window about `at`, as [`Moments::of`] has them; the last column of the subsets beside it
    /// that will be asked for is `right`.
    pub(super) fn moments(&mut self, layers: Layers<'_>, window: &Window, at: (i32, i32), right: i32) -> Moments {
        let extent = window.extent;
        let (left, top) = (at.0 + extent.left, at.1 + extent.top);
        let end = self.first.0 + self.count as i32;
        if top != self.first.1 || left < self.first.0 || at.0 + extent.right + LANES as i32 > end {
            let columns = (right.max(at.0 + extent.right) - left + 1) as usize;
            // The last block of a window is filled up to eight columns.
            self.count = (columns + LANES).next_multiple_of(LANES);
            self.first = (left, top);
            self.sums.resize(DOWN * self.count, 0.0);
            sum_down(layers, self.first, (self.count, extent.sides().1), &mut self.sums);
        }
        let mut out = Moments::default();
        gather(&self.sums, window, ((left - self.first.0) as usize, self.count), &mut out);
        out
    }
}

#[inline(always)]
fn sum_down_with<V: Vector>(layers: Layers<'_>, first: (i32, i32), (count, rows): (usize, usize), sums: &mut [f32]) {
    let start = layers.reference.index(first.0 as isize, first.1 as isize);
    for column in (0..count).step_by(LANES) {
        let found: [V; DOWN] = down(layers, start + column, rows, |_| V::splat(1.0));
        for (k, sum) in found.into_iter().enumerate() {
            sum.store(&mut sums[k * count + column..]);
        }
    }
}

#[inline(always)]
fn gather_with<V: Vector>(sums: &[f32], window: &Window, (from, count): (usize, usize), out: &mut Moments) {
    let mut folded = [V::splat(0.0); SUMS];
    for block in &window.blocks {
        let mask = V::from_lanes(&window.mask[block.start]);
        let column = from + (block.dx - window.extent.left) as usize;
        let mut found = [V::splat(0.0); DOWN];
        for (k, sum) in found.iter_mut().enumerate() {
            *sum = V::load(&sums[k * count + column..]).mul(mask);
        }
        fold(&found, block, &mut folded);
    }
    total(&folded, out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::WindowShape;
    use crate::dic::moments::tests::plane;
    use crate::dic::vector::Portable;

    #[test]
    fn the_sums_of_every_subset_of_a_row_are_its_own_to_the_bit() {
        let planes = [plane(1), plane(2), plane(3), plane(4)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        for size in [9, 17, 31] {
            let window = Window::new(WindowShape::Square, size);
            assert!(window.is_square());
            let (mut columns, half) = (Columns::default(), size as i32 / 2);
            // Rows that follow one another, one subset alone, and one that was not foretold to be asked for.
            for (y, xs, last) in [(half, 3, 2), (half + 2, 1, 0), (half + 2, 3, 1), (49 - half, 4, 3)] {
                let right = half + 5 * last + half;
                for x in (0..xs).map(|k| half + 5 * k) {
                    assert_eq!(columns.moments(layers, &window, (x, y), right), Moments::of(layers, &window, (x, y)));
                }
            }
        }
        assert!(!Window::new(WindowShape::Circle, 31).is_square());
    }

    #[test]
    fn sums_are_equal_on_every_machine() {
        let planes = [plane(5), plane(6), plane(7), plane(8)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        let window = Window::new(WindowShape::Square, 21);
        let mut sums = [vec![0.0; DOWN * 48], vec![0.0; DOWN * 48]];
        sum_down(layers, (2, 3), (48, 21), &mut sums[0]);
        sum_down_with::<Portable>(layers, (2, 3), (48, 21), &mut sums[1]);
        assert_eq!(sums[0], sums[1]);
        let mut found = [Moments::default(); 2];
        gather(&sums[0], &window, (7, 48), &mut found[0]);
        gather_with::<Portable>(&sums[0], &window, (7, 48), &mut found[1]);
        assert_eq!(found[0], found[1]);
    }
}
