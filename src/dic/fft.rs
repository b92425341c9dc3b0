//! Whole-pixel search: cross-correlation by fast Fourier transform (FFT),
//! zero-mean and divided by the contrast of what each shift covers, so that no
//! shift is favoured for its overlap.

use std::sync::Arc;

use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use super::lanes::LANES;
use super::peak::{Peak, Surface};
use super::plane::Plane;
use super::subset::Subset;
use super::window::Window;

/// What a search found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Found {
    /// The highest peak.
    pub(super) best: Peak,
    /// The next one, if there is one.
    pub(super) second: Option<Peak>,
    /// Displacement that belongs to column 0, row 0 of the surface, px.
    pub(super) origin: (i32, i32),
    /// Whether the edge of the image cut the range.
    pub(super) clipped: bool,
}

impl Found {
    /// Displacement at the top of a peak, px.
    pub(super) fn displacement(&self, peak: &Peak) -> (f64, f64) {
        let (column, row) = (peak.column as i32 + self.origin.0, peak.row as i32 + self.origin.1);
        (f64::from(column) + peak.dx, f64::from(row) + peak.dy)
    }
}

/// Plans and memory for searches of one size.
pub(super) struct Search {
    range: usize,
    size: usize,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
    work: Vec<Complex32>,
    turned: Vec<Complex32>,
    scratch: Vec<Complex32>,
    /// Running sums of the target area and of its square, one more each way.
    sums: Vec<f64>,
    squares: Vec<f64>,
    surface: Vec<f32>,
}

impl Search {
    /// Plans searches of subsets up to `window_px` wide, `range_px` to each side.
    pub(super) fn new(window_px: usize, range_px: usize) -> Self {
        let size = fast_size(window_px + 2 * range_px);
        let mut planner = FftPlanner::new();
        let (forward, inverse) = (planner.plan_fft_forward(size), planner.plan_fft_inverse(size));
        let scratch = forward.get_inplace_scratch_len().max(inverse.get_inplace_scratch_len());
        let zero = Complex32::new(0.0, 0.0);
        let area = window_px + 2 * range_px + 1;
        let shifts = 2 * range_px + 1;
        Self {
            range: range_px,
            size,
            forward,
            inverse,
            work: vec![zero; size * size],
            turned: vec![zero; size * size],
            scratch: vec![zero; scratch],
            sums: vec![0.0; area * area],
            squares: vec![0.0; area * area],
            surface: vec![0.0; shifts * shifts],
        }
    }

    /// Looks for `subset`, centred at `at` in the reference, around `at + around` in the target.
    ///
    /// `None` when no shift keeps the subset in the target.
    pub(super) fn find(
        &mut self,
        subset: &Subset,
        window: &Window,
        target: &Plane,
        at: (u32, u32),
        around: (i32, i32),
    ) -> Option<Found> {
        let (half, range) = (i64::from(window.half), self.range as i64);
        let shifts = |center: i64, extent: usize| {
            let low = (center - range).max(half);
            let high = (center + range).min(extent as i64 - 1 - half);
            (low <= high).then_some((low, high))
        };
        let center = (i64::from(at.0) + i64::from(around.0), i64::from(at.1) + i64::from(around.1));
        let (left, right) = shifts(center.0, target.width())?;
        let (top, bottom) = shifts(center.1, target.height())?;
        let corner = ((left - half) as isize, (top - half) as isize);
        let (columns, rows) = ((right - left + 1) as usize, (bottom - top + 1) as usize);
        let edge = 2 * window.half as usize;
        self.load(subset, window, target, corner, (columns + edge, rows + edge));
        self.correlate();
        self.normalise(subset, window, (columns, rows));
        let surface = Surface { data: &self.surface[..columns * rows], columns };
        let highest = surface.highest()?;
        let origin = ((left - i64::from(at.0)) as i32, (top - i64::from(at.1)) as i32);
        let clipped = columns.min(rows) < 2 * self.range + 1;
        Some(Found { best: surface.top(highest.0, highest.1), second: surface.second(highest), origin, clipped })
    }

    /// Target area into the real part, subset into the imaginary part, and the running sums.
    fn load(&mut self, subset: &Subset, window: &Window, target: &Plane, corner: (isize, isize), area: (usize, usize)) {
        self.work.fill(Complex32::new(0.0, 0.0));
        let stride = area.0 + 1;
        self.sums[..stride].fill(0.0);
        self.squares[..stride].fill(0.0);
        let mean = subset.mean;
        for y in 0..area.1 {
            let first = target.index(corner.0, corner.1 + y as isize);
            let row = &target.data()[first..first + area.0];
            let (mut sum, mut square) = (0.0_f64, 0.0_f64);
            let line = (y + 1) * stride;
            self.sums[line] = 0.0;
            self.squares[line] = 0.0;
            for (x, pixel) in row.iter().enumerate() {
                let level = pixel - mean;
                self.work[y * self.size + x].re = level;
                sum += f64::from(level);
                square += f64::from(level) * f64::from(level);
                self.sums[line + x + 1] = self.sums[line - stride + x + 1] + sum;
                self.squares[line + x + 1] = self.squares[line - stride + x + 1] + square;
            }
        }
        let half = window.half as i32;
        for block in &window.blocks {
            for row in 0..block.rows {
                let y = (half + block.dy + row as i32) as usize;
                let x = (half + block.dx) as usize;
                let lanes = subset.levels[block.start + row].0;
                let last = LANES.min(2 * window.half as usize + 1 - x);
                for (lane, level) in lanes.iter().take(last).enumerate() {
                    self.work[y * self.size + x + lane].im = *level;
                }
            }
        }
    }

    /// Turns `work` into its transform, transposed.
    fn transform(&mut self, inverse: bool) {
        let plan = if inverse { &self.inverse } else { &self.forward };
        for _ in 0..2 {
            plan.process_with_scratch(&mut self.work, &mut self.scratch);
            for y in 0..self.size {
                for x in 0..self.size {
                    self.turned[x * self.size + y] = self.work[y * self.size + x];
                }
            }
            std::mem::swap(&mut self.work, &mut self.turned);
        }
    }

    /// Cross-correlation of the two real images packed in `work`, into its real part.
    fn correlate(&mut self) {
        self.transform(false);
        let size = self.size;
        for y in 0..size {
            for x in 0..size {
                let here = self.work[y * size + x];
                let there = self.work[(size - y) % size * size + (size - x) % size].conj();
                // Spectra of the target area and of the subset.
                let area = (here + there) * 0.5;
                let subset = (here - there) * Complex32::new(0.0, -0.5);
                self.turned[y * size + x] = area * subset.conj();
            }
        }
        std::mem::swap(&mut self.work, &mut self.turned);
        self.transform(true);
    }

    /// Divides each shift's correlation by the contrast of what it covers.
    fn normalise(&mut self, subset: &Subset, window: &Window, (columns, rows): (usize, usize)) {
        let side = 2 * window.half as usize + 1;
        let stride = columns + side;
        let pixels = (side * side) as f64;
        let scale = 1.0 / (self.size * self.size) as f64;
        // A round subset is judged by the contrast of its square.
        let energy = subset.energy * pixels / window.pixels as f64;
        for y in 0..rows {
            for x in 0..columns {
                let over = |sums: &[f64]| {
                    sums[(y + side) * stride + x + side] - sums[y * stride + x + side] - sums[(y + side) * stride + x]
                        + sums[y * stride + x]
                };
                let sum = over(&self.sums);
                let contrast = over(&self.squares) - sum * sum / pixels;
                let product = f64::from(self.work[y * self.size + x].re) * scale * pixels / window.pixels as f64;
                self.surface[y * columns + x] =
                    if contrast > 0.01 * pixels { (product / (contrast * energy).sqrt()) as f32 } else { 0.0 };
            }
        }
    }
}

/// The next size that is fast to transform: no prime factor above 5, at least 8.
fn fast_size(least: usize) -> usize {
    let smooth = |size: usize| {
        let mut rest = size;
        for factor in [2, 3, 5] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    (least.max(8)..).find(|size| smooth(*size)).unwrap_or(least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::prepared::Prepared;
    use crate::dic::speckle::{Speckle, record};
    use crate::dic::{Shape, WindowShape, zncc};
    use crate::image::{Image, ImageView};

    fn cut(image: &Image, x: i32, y: i32, half: i32) -> Image {
        let pixel = |k: i32| {
            let (dx, dy) = (k % (2 * half + 1) - half, k / (2 * half + 1) - half);
            image.view().at((x + dx) as usize, (y + dy) as usize).unwrap()
        };
        let side = (2 * half + 1) as usize;
        Image::from_vec((0..(side * side) as i32).map(pixel).collect(), side, side).unwrap()
    }

    /// The slow twin: the coefficient computed afresh at every shift.
    fn slow_surface(reference: &Image, target: &Image, at: (i32, i32), half: i32, range: i32) -> Vec<f32> {
        let subset = cut(reference, at.0, at.1, half);
        let mut surface = Vec::new();
        for v in -range..=range {
            for u in -range..=range {
                let other = cut(target, at.0 + u, at.1 + v, half);
                let view = |image: &Image| -> Vec<f32> { image.view().data().to_vec() };
                let (a, b) = (view(&subset), view(&other));
                let side = (2 * half + 1) as usize;
                let pair = (ImageView::new(&a, side, side).unwrap(), ImageView::new(&b, side, side).unwrap());
                surface.push(zncc(pair.0, pair.1).unwrap() as f32);
            }
        }
        surface
    }

    #[test]
    fn the_surface_equals_the_statistical_correlation_at_every_shift_with_dirty_memory() {
        let speckle = Speckle::standard(5, 90.0);
        let reference = record(&speckle.draw(90, 80), 2.0, 1);
        let target = record(&speckle.moved(|_, _| (3.4, -2.2)).draw(90, 80), 2.0, 2);
        let (mut f, mut g) = (Prepared::default(), Prepared::default());
        f.fill(reference.view());
        g.fill(target.view());
        let window = Window::new(WindowShape::Square, 21);
        let mut search = Search::new(21, 7);
        search.work.fill(Complex32::new(f32::NAN, 3.0));
        search.turned.fill(Complex32::new(f32::NAN, 3.0));
        for sums in [&mut search.sums, &mut search.squares] {
            sums.fill(f64::NAN);
        }
        let mut subset = Subset::default();
        let at = (44, 40);
        subset.fill(&f, &window, Shape::Translation, at).unwrap();
        let found = search.find(&subset, &window, &g.levels, at, (0, 0)).unwrap();
        let slow = slow_surface(&reference, &target, (44, 40), 10, 7);
        let difference = slow.iter().zip(&search.surface).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(difference < 2e-5, "largest difference {difference}");
        let (u, v) = found.displacement(&found.best);
        assert!((u - 3.4).abs() < 0.05 && (v + 2.2).abs() < 0.05, "{u} {v}");
    }

    #[test]
    fn searches_keep_to_the_image() {
        let speckle = Speckle::standard(6, 60.0);
        let mut frame = Prepared::default();
        frame.fill(record(&speckle.draw(60, 60), 1.0, 1).view());
        let window = Window::new(WindowShape::Square, 31);
        let (mut search, mut subset) = (Search::new(31, 16), Subset::default());
        subset.fill(&frame, &window, Shape::Affine, (15, 44)).unwrap();
        let found = search.find(&subset, &window, &frame.levels, (15, 44), (0, 0)).unwrap();
        assert_eq!(found.origin, (0, -16));
        assert_eq!((found.best.column, found.best.row), (0, 16));
        assert!(search.find(&subset, &window, &frame.levels, (15, 44), (200, 0)).is_none());
    }

    #[test]
    fn fast_sizes_have_no_large_factor() {
        assert_eq!([1, 63, 64, 65, 67, 97].map(fast_size), [8, 64, 64, 72, 72, 100]);
    }
}
