//! Cross-correlation of windows at the same place, zero-padded, without normalisation.
//!
//! This is Eq. 4 of *Collision measurements using digital image correlation techniques* (Int. J. Mech. Sci., 2017).
//! The more a window is shifted, the smaller the overlap and the sum, which biases the peak towards zero. This module
//! shows by how much; measurements normalise by the overlap.

use super::film::FramePair;
use super::spline_surface::SplineSurface;
use crate::dic::{CenterVector, GridPoint};
use crate::image::{Image, ImageView};
use crate::results::Circle;

/// Maximum shift along each axis, px.
const REACH_PX: usize = 6;

/// Number of shifts along each axis.
const SIDE: usize = 2 * REACH_PX + 1;

/// The plan of the correlation and its buffers.
#[derive(Debug)]
pub(super) struct PlainCorrelator {
    subset_size_px: usize,
    /// Grid points per px on the splined peak.
    per_px: u32,
    windows: [Vec<f32>; 2],
    surface: Image,
}

impl PlainCorrelator {
    /// Returns a plan for windows of this size with a number of spline points between two samples of the peak.
    pub(super) fn new(subset_size_px: u32, spline_points: u32) -> Self {
        Self {
            subset_size_px: subset_size_px as usize,
            per_px: spline_points + 1,
            windows: Default::default(),
            surface: Image::new(SIDE, SIDE),
        }
    }

    /// Returns the displacement of the window centred at `center`, with its position relative to the ball's centre.
    ///
    /// `None` when the window exceeds the image or the peak lies at the maximum shift.
    pub(super) fn displacement(
        &mut self,
        pair: FramePair<'_>,
        center: GridPoint,
        circle: &Circle,
    ) -> Option<CenterVector> {
        for (window, image) in self.windows.iter_mut().zip([pair.before, pair.after]) {
            copy_window(image, center, self.subset_size_px, window)?;
        }
        self.correlate();
        let [u_px, v_px] = self.peak()?;
        let (x_px, y_px) = (f64::from(center.x) - circle.x_px, f64::from(center.y) - circle.y_px);
        Some(CenterVector { x_px, y_px, u_px, v_px, sigma_px: 0.0 })
    }

    /// Computes the sum of products of both windows at every shift up to [`REACH_PX`], over their overlap (Eq. 4).
    fn correlate(&mut self) {
        let (size, reach) = (self.subset_size_px as isize, REACH_PX as isize);
        let [before, after] = &self.windows;
        // The overlap of two rows at a shift.
        let overlap = |shift: isize| (-shift).max(0)..size - shift.max(0);
        for (row, sums) in self.surface.rows_mut().enumerate() {
            let dy = row as isize - reach;
            for (column, sum) in sums.iter_mut().enumerate() {
                let dx = column as isize - reach;
                let across = overlap(dx);
                let products = overlap(dy).map(|y| {
                    let line = |y: isize, from: isize| {
                        let start = (y * size + from) as usize;
                        start..start + across.len()
                    };
                    let pair = before[line(y, across.start)].iter().zip(&after[line(y + dy, across.start + dx)]);
                    pair.map(|(a, b)| a * b).sum::<f32>()
                });
                *sum = products.sum();
            }
        }
    }

    /// Returns the displacement of the highest grid point of the splined surface around its highest sample, px; `None`
    /// at the maximum shift.
    fn peak(&self) -> Option<[f64; 2]> {
        let data = self.surface.view().data();
        let best = (0..data.len()).fold(0, |best, index| if data[index] > data[best] { index } else { best });
        let (column, row) = (best % SIDE, best / SIDE);
        let inside = 1..SIDE - 1;
        if !(inside.contains(&column) && inside.contains(&row)) {
            return None;
        }
        let surface = SplineSurface::new(self.surface.view());
        let fine = i32::try_from(self.per_px).ok()?;
        let (mut highest, mut top) = (f64::NEG_INFINITY, [0.0; 2]);
        for j in -fine..=fine {
            for i in -fine..=fine {
                let place = |sample: usize, step: i32| sample as f64 + f64::from(step) / f64::from(fine);
                let (x, y) = (place(column, i), place(row, j));
                let height = surface.level_at(x, y);
                if height > highest {
                    (highest, top) = (height, [x - REACH_PX as f64, y - REACH_PX as f64]);
                }
            }
        }
        Some(top)
    }
}

/// Copies a window of `size` px about `center` and subtracts its mean; returns `None` when it exceeds the image.
fn copy_window(image: ImageView<'_>, center: GridPoint, size: usize, window: &mut Vec<f32>) -> Option<()> {
    let corner = |place: u32| (place as usize).checked_sub(size / 2);
    let (left, top) = (corner(center.x)?, corner(center.y)?);
    if left + size > image.width() || top + size > image.height() {
        return None;
    }
    window.clear();
    (top..top + size).for_each(|row| window.extend_from_slice(&image.row(row)[left..left + size]));
    let mean = window.iter().sum::<f32>() / window.len() as f32;
    window.iter_mut().for_each(|level| *level -= mean);
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth pattern, shifted by whole pixels.
    fn pattern(shift: usize) -> Image {
        let mut image = Image::new(64, 64);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let (x, y) = ((x + 64 - shift) as f64, y as f64);
                *level = (100.0 + 40.0 * (0.7 * x + 0.3 * y).sin() * (0.2 * x - 0.5 * y).cos()) as f32;
            }
        }
        image
    }

    #[test]
    fn every_sum_is_that_of_its_overlap() {
        let (before, after) = (pattern(0), pattern(1));
        let mut plain = PlainCorrelator::new(9, 5);
        let at = GridPoint { x: 30, y: 31 };
        for (window, image) in plain.windows.iter_mut().zip([&before, &after]) {
            copy_window(image.view(), at, 9, window).unwrap();
        }
        plain.correlate();
        let [f, g] = &plain.windows;
        for (dx, dy) in [(0_i32, 0_i32), (1, 0), (-2, 3), (6, -6)] {
            let mut sum = 0.0;
            for y in 0..9_i32 {
                for x in 0..9_i32 {
                    if (0..9).contains(&(x + dx)) && (0..9).contains(&(y + dy)) {
                        sum += f64::from(f[(9 * y + x) as usize]) * f64::from(g[(9 * (y + dy) + x + dx) as usize]);
                    }
                }
            }
            let found = plain.surface.view().at((dx + 6) as usize, (dy + 6) as usize).unwrap();
            assert!((f64::from(found) - sum).abs() < 1e-3 * sum.abs().max(100.0), "({dx}, {dy}): {found} {sum}");
        }
    }

    #[test]
    fn a_resting_window_reads_zero_and_one_at_the_edge_has_no_answer() {
        let image = pattern(0);
        let circle = Circle {
            x_px: 30.0,
            y_px: 30.0,
            radius_px: 20.0,
            sigma_center_px: 0.0,
            sigma_radius_px: 0.0,
            visible_fraction: 1.0,
        };
        let mut plain = PlainCorrelator::new(25, 5);
        let still = plain
            .displacement(FramePair { before: image.view(), after: image.view() }, GridPoint { x: 32, y: 29 }, &circle)
            .unwrap();
        assert!(still.u_px.abs() < 1e-9 && still.v_px.abs() < 1e-9, "{still:?}");
        assert!((still.x_px - 2.0).abs() < 1e-9 && (still.y_px + 1.0).abs() < 1e-9, "{still:?}");
        assert!(
            plain
                .displacement(
                    FramePair { before: image.view(), after: image.view() },
                    GridPoint { x: 11, y: 29 },
                    &circle
                )
                .is_none()
        );
    }
}
