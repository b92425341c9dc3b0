//! Cross-correlation of a subset with an area of the target by one packed FFT.

use multiversion::multiversion;

use crate::dic::geometry::SubsetMask;
use crate::dic::image::PaddedImage;
use crate::dic::subset::ReferenceSubset;
use crate::numeric::{Complex, LANES, Transform};

/// Plan and memory for cross-correlations of one size.
pub(in crate::dic) struct CrossCorrelation {
    pub(in crate::dic) transform: Transform,
    pub(in crate::dic) data: Complex,
    pub(in crate::dic) product: Complex,
}

impl CrossCorrelation {
    pub(in crate::dic) fn new(size: usize) -> Self {
        let transform = Transform::new(size);
        Self { data: transform.memory(), product: transform.memory(), transform }
    }

    /// Loads the subset into the imaginary part, with the corner of its rectangle at the origin. Pixels that do not fit
    /// are dropped.
    pub(in crate::dic) fn load_subset(&mut self, subset: &ReferenceSubset, window: &SubsetMask) {
        let (stride, size) = (self.transform.stride(), self.transform.size());
        let width = window.extent.sides().0.min(size);
        self.data.im.fill(0.0);
        for block in &window.blocks {
            // Lanes before the rectangle hold no pixel.
            let skipped = (window.extent.left - block.dx).max(0) as usize;
            let x = (block.dx - window.extent.left).max(0) as usize;
            let last = LANES.min(skipped + width.saturating_sub(x)).max(skipped);
            let top = (block.dy - window.extent.top) as usize;
            for row in 0..block.rows.min(size.saturating_sub(top)) {
                let first = (top + row) * stride + x;
                let levels = &subset.levels[block.start + row].0[skipped..last];
                self.data.im[first..first + last - skipped].copy_from_slice(levels);
            }
        }
    }

    /// Loads target pixels into the real part, zero-padded.
    pub(in crate::dic) fn load_area(
        &mut self,
        target: &PaddedImage,
        corner: (isize, isize),
        (columns, rows): (usize, usize),
        mean: f32,
    ) {
        let stride = self.transform.stride();
        for (y, line) in self.data.re.chunks_exact_mut(stride).enumerate() {
            let (inside, outside) = line.split_at_mut(if y < rows { columns } else { 0 });
            if y < rows {
                let first = target.index(corner.0, corner.1 + y as isize);
                let row = &target.data()[first..first + columns];
                inside.iter_mut().zip(row).for_each(|(value, level)| *value = level - mean);
            }
            outside.fill(0.0);
        }
    }

    /// Loads two squares, `area` and `subset`, each with its side length.
    pub(in crate::dic) fn load_squares(
        &mut self,
        (area, area_side): (&[f32], usize),
        (subset, subset_side): (&[f32], usize),
    ) {
        let stride = self.transform.stride();
        for (part, square, side) in [(&mut self.data.re, area, area_side), (&mut self.data.im, subset, subset_side)] {
            part.fill(0.0);
            for (line, row) in part.chunks_exact_mut(stride).zip(square.chunks_exact(side)).take(side) {
                line[..side].copy_from_slice(row);
            }
        }
    }

    /// Computes the cross-correlation of the area with the subset into the real part of `data`.
    pub(in crate::dic) fn run(&mut self) {
        self.transform.forward(&mut self.data);
        multiply(&self.data, &mut self.product, self.transform.size(), self.transform.stride());
        std::mem::swap(&mut self.data, &mut self.product);
        self.transform.inverse(&mut self.data);
    }
}

/// Computes the cross spectrum of two real images transformed as one complex image.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn multiply(data: &Complex, out: &mut Complex, size: usize, stride: usize) {
    for y in 0..size {
        let (here, there) = (y * stride, (size - y) % size * stride);
        let (a, b) = (&data.re[here..here + size], &data.im[here..here + size]);
        let (c, d) = (&data.re[there..there + size], &data.im[there..there + size]);
        let (re, im) = (&mut out.re[here..here + size], &mut out.im[here..here + size]);
        (re[0], im[0]) = product_of(a[0], b[0], c[0], d[0]);
        let opposite = c[1..].iter().rev().zip(d[1..].iter().rev());
        let outputs = re[1..].iter_mut().zip(&mut im[1..]);
        for (((re, im), (a, b)), (c, d)) in outputs.zip(a[1..].iter().zip(&b[1..])).zip(opposite) {
            (*re, *im) = product_of(*a, *b, *c, *d);
        }
    }
}

/// Multiplies the area by the conjugate subset, from the packed values at a frequency (a, b) and at its opposite (c,
/// d).
#[inline(always)]
fn product_of(a: f32, b: f32, c: f32, d: f32) -> (f32, f32) {
    let (area_re, area_im, subset_re, subset_im) = (a + c, b - d, b + d, a - c);
    (0.25 * (area_re * subset_re - area_im * subset_im), 0.25 * (area_re * subset_im + area_im * subset_re))
}

/// The range of shifts of a normalised correlation surface.
pub(in crate::dic) struct Shifts {
    /// The width and height of the subset's rectangle.
    pub(in crate::dic) sides: (usize, usize),
    /// The number of shifts along x.
    pub(in crate::dic) columns: usize,
    /// The number of shifts along y.
    pub(in crate::dic) rows: usize,
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

    #[cfg(test)]
    pub(in crate::dic) fn spoil(&mut self) {
        self.sums.fill(f64::NAN);
        self.squares.fill(f64::NAN);
    }

    /// Fills the tables from the area that `correlation` holds. Call before it runs.
    pub(in crate::dic) fn add_up(&mut self, correlation: &CrossCorrelation, area: (usize, usize)) {
        let (line_length, stride) = (correlation.transform.stride(), area.0 + 1);
        self.sums[..stride].fill(0.0);
        self.squares[..stride].fill(0.0);
        for y in 0..area.1 {
            let (mut sum, mut square) = (0.0_f64, 0.0_f64);
            let line = (y + 1) * stride;
            self.sums[line] = 0.0;
            self.squares[line] = 0.0;
            for (x, level) in correlation.data.re[y * line_length..][..area.0].iter().enumerate() {
                let level = f64::from(*level);
                sum += level;
                square += level * level;
                self.sums[line + x + 1] = self.sums[line - stride + x + 1] + sum;
                self.squares[line + x + 1] = self.squares[line - stride + x + 1] + square;
            }
        }
    }

    /// Divides the correlation at each shift by the local contrast of the target.
    ///
    /// `energy` is the subset's sum of squares. `share` is the ratio of its rectangle's area to its own: a round subset
    /// is normalised by the contrast of its square.
    pub(in crate::dic) fn normalise(
        &self,
        correlation: &CrossCorrelation,
        shifts: &Shifts,
        (energy, share): (f64, f64),
        surface: &mut [f32],
    ) {
        let Shifts { sides: (width, height), columns, rows } = *shifts;
        let (size, line_length) = (correlation.transform.size(), correlation.transform.stride());
        let stride = columns + width;
        let pixels = (width * height) as f64;
        let scale = share / (size * size) as f64;
        for y in 0..rows {
            for x in 0..columns {
                let over = |sums: &[f64]| {
                    let (above, below) = (y * stride + x, (y + height) * stride + x);
                    sums[below + width] - sums[above + width] - sums[below] + sums[above]
                };
                let sum = over(&self.sums);
                let contrast = over(&self.squares) - sum * sum / pixels;
                let product = f64::from(correlation.data.re[y * line_length + x]) * scale;
                surface[y * columns + x] =
                    if contrast > 0.01 * pixels { (product / (contrast * energy * share).sqrt()) as f32 } else { 0.0 };
            }
        }
    }
}
