//! Cross-correlation of a subset with an area of the target by one packed FFT.

use multiversion::multiversion;

use crate::dic::geometry::{Pixel, Size, SubsetMask};
use crate::dic::image::PaddedImage;
use crate::dic::subset::ReferenceSubset;
use crate::numeric::{Complex32, Fft2d, LANES};

/// Plan and memory for cross-correlations of one size.
pub(in crate::dic) struct CrossCorrelation {
    fft: Fft2d,
    /// The area in the real parts and the subset in the imaginary parts; after [`Self::run`] the correlation.
    pub(in crate::dic) data: Vec<Complex32>,
    product: Vec<Complex32>,
}

impl CrossCorrelation {
    /// Plans correlations of `size` x `size` pixels, zero-padding included.
    pub(in crate::dic) fn new(size: usize) -> Self {
        let fft = Fft2d::new(size);
        Self { data: fft.memory(), product: fft.memory(), fft }
    }

    /// The number of rows and columns.
    pub(in crate::dic) fn size(&self) -> usize {
        self.fft.size()
    }

    /// Loads an area of the target, zero-padded, into the real parts and the subset into the imaginary parts, with the
    /// corners of both at the origin. The subset's mean is subtracted from both; its pixels that do not fit are
    /// dropped.
    ///
    /// The area starts at the pixel `corner` of the target and has the size `area`, at most that of the plan.
    pub(in crate::dic) fn load(
        &mut self,
        subset: &ReferenceSubset,
        window: &SubsetMask,
        target: &PaddedImage,
        corner: Pixel,
        area: Size,
    ) {
        let size = self.size();
        for (y, line) in self.data.chunks_exact_mut(size).enumerate() {
            let (inside, outside) = line.split_at_mut(if y < area.height { area.width } else { 0 });
            if !inside.is_empty() {
                let first = target.index(corner.x as isize, corner.y as isize + y as isize);
                let row = &target.data()[first..first + area.width];
                for (value, level) in inside.iter_mut().zip(row) {
                    *value = Complex32::new(level - subset.mean, 0.0);
                }
            }
            outside.fill(Complex32::default());
        }
        let width = window.extent.size().width.min(size);
        for block in &window.blocks {
            // Lanes before the rectangle hold no pixel.
            let skipped = (window.extent.left - block.dx).max(0) as usize;
            let x = (block.dx - window.extent.left).max(0) as usize;
            let last = LANES.min(skipped + width.saturating_sub(x)).max(skipped);
            let top = (block.dy - window.extent.top) as usize;
            let lines = self.data.chunks_exact_mut(size).skip(top);
            for (line, levels) in lines.zip(&subset.levels[block.start..block.start + block.rows]) {
                for (value, level) in line[x..].iter_mut().zip(&levels.0[skipped..last]) {
                    value.im = *level;
                }
            }
        }
    }

    /// Loads the square `area` into the real parts and the square `subset` into the imaginary parts, zero-padded.
    ///
    /// Both are row-major and at most as wide as the plan. The rest of `data` is 0.
    pub(in crate::dic) fn load_squares(&mut self, area: &[f32], area_side: usize, subset: &[f32], subset_side: usize) {
        let size = self.size();
        self.data.fill(Complex32::default());
        for (line, row) in self.data.chunks_exact_mut(size).zip(area.chunks_exact(area_side)) {
            line.iter_mut().zip(row).for_each(|(value, level)| value.re = *level);
        }
        for (line, row) in self.data.chunks_exact_mut(size).zip(subset.chunks_exact(subset_side)) {
            line.iter_mut().zip(row).for_each(|(value, level)| value.im = *level);
        }
    }

    /// Computes the cross-correlation of the loaded area with the loaded subset into the real parts of `data`.
    ///
    /// The value at (x, y) belongs to the shift (x, y), modulo the size. It is [`Self::size`] squared times the sum of
    /// products.
    pub(in crate::dic) fn run(&mut self) {
        self.fft.forward(&mut self.data);
        cross_spectra(&self.data, &mut self.product, self.fft.size());
        std::mem::swap(&mut self.data, &mut self.product);
        self.fft.inverse(&mut self.data);
    }

    /// Fills the memory with NaN, so that a test finds whatever is read before it is written.
    #[cfg(test)]
    pub(in crate::dic) fn spoil(&mut self) {
        for plane in [&mut self.data, &mut self.product] {
            plane.fill(Complex32::new(f32::NAN, f32::NAN));
        }
    }
}

/// Computes the cross spectrum of two real images of side `size` transformed as one complex image.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn cross_spectra(data: &[Complex32], out: &mut [Complex32], size: usize) {
    for (y, line) in out.chunks_exact_mut(size).enumerate() {
        let (own, opposite) = (&data[y * size..][..size], &data[(size - y) % size * size..][..size]);
        line[0] = cross_spectrum(own[0], opposite[0]);
        for (value, (own, opposite)) in line[1..].iter_mut().zip(own[1..].iter().zip(opposite[1..].iter().rev())) {
            *value = cross_spectrum(*own, *opposite);
        }
    }
}

/// Returns the spectrum of the area times the conjugate one of the subset, from the packed values at a frequency
/// (`own`) and at its negative (`opposite`).
#[inline(always)]
fn cross_spectrum(own: Complex32, opposite: Complex32) -> Complex32 {
    let (area_re, area_im) = (own.re + opposite.re, own.im - opposite.im);
    let (subset_re, subset_im) = (own.im + opposite.im, own.re - opposite.re);
    let (re, im) = (area_re * subset_re - area_im * subset_im, area_re * subset_im + area_im * subset_re);
    Complex32::new(0.25 * re, 0.25 * im)
}

/// The range of shifts of a normalised correlation surface.
pub(in crate::dic) struct Shifts {
    /// The size of the subset's rectangle.
    pub(in crate::dic) subset: Size,
    /// The number of shifts along x.
    pub(in crate::dic) columns: usize,
    /// The number of shifts along y.
    pub(in crate::dic) rows: usize,
    /// The subset's sum of squares.
    pub(in crate::dic) energy: f64,
    /// The ratio of the area of the rectangle to that of the subset: a round subset is normalised by the contrast of
    /// its square.
    pub(in crate::dic) area_ratio: f64,
}

/// Local contrast of the target at each shift, from summed-area tables.
pub(in crate::dic) struct LocalContrast {
    /// Sums of all values above and to the left, with one more row and column.
    sums: Vec<f64>,
    /// The same of the squares.
    squares: Vec<f64>,
}

impl LocalContrast {
    /// Allocates the tables for areas up to `side` x `side`.
    pub(in crate::dic) fn new(side: usize) -> Self {
        let count = (side + 1) * (side + 1);
        Self { sums: vec![0.0; count], squares: vec![0.0; count] }
    }

    /// Fills the memory with NaN, so that a test finds whatever is read before it is written.
    #[cfg(test)]
    pub(in crate::dic) fn spoil(&mut self) {
        self.sums.fill(f64::NAN);
        self.squares.fill(f64::NAN);
    }

    /// Fills the tables from the area that `correlation` holds. Call before [`CrossCorrelation::run`].
    pub(in crate::dic) fn fill_tables(&mut self, correlation: &CrossCorrelation, area: Size) {
        let (size, stride) = (correlation.size(), area.width + 1);
        self.sums[..stride].fill(0.0);
        self.squares[..stride].fill(0.0);
        for y in 0..area.height {
            let (mut sum, mut square) = (0.0_f64, 0.0_f64);
            let line = (y + 1) * stride;
            self.sums[line] = 0.0;
            self.squares[line] = 0.0;
            for (x, value) in correlation.data[y * size..][..area.width].iter().enumerate() {
                let level = f64::from(value.re);
                sum += level;
                square += level * level;
                self.sums[line + x + 1] = self.sums[line - stride + x + 1] + sum;
                self.squares[line + x + 1] = self.squares[line - stride + x + 1] + square;
            }
        }
    }

    /// Computes the normalised correlation at each shift into `surface`, row by row: the correlation divided by the
    /// local contrast of the target. It is 0 where the variance of the target is at most 0.01 DN^2.
    ///
    /// `correlation` has been [run](CrossCorrelation::run), after [`Self::fill_tables`] for the same area.
    ///
    /// J. P. Lewis, Fast template matching, Vision Interface (1995) 120.
    pub(in crate::dic) fn normalise(&self, correlation: &CrossCorrelation, shifts: &Shifts, surface: &mut [f32]) {
        let Shifts { subset: Size { width, height }, columns, rows, energy, area_ratio } = *shifts;
        let size = correlation.size();
        let stride = columns + width;
        let pixels = (width * height) as f64;
        let scale = area_ratio / (size * size) as f64;
        for y in 0..rows {
            for x in 0..columns {
                let over = |sums: &[f64]| {
                    let (above, below) = (y * stride + x, (y + height) * stride + x);
                    sums[below + width] - sums[above + width] - sums[below] + sums[above]
                };
                let sum = over(&self.sums);
                let contrast = over(&self.squares) - sum * sum / pixels;
                let product = f64::from(correlation.data[y * size + x].re) * scale;
                surface[y * columns + x] = if contrast > 0.01 * pixels {
                    (product / (contrast * energy * area_ratio).sqrt()) as f32
                } else {
                    0.0
                };
            }
        }
    }
}
