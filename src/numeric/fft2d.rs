//! Two-dimensional fast Fourier transforms of small squares over `rustfft`.
//!
//! Rows, a blocked transpose, rows. `rustfft` chooses the instructions at run time, so last bits differ between
//! processors with and without AVX.

use std::sync::Arc;

use multiversion::multiversion;
pub use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

/// Numbers along each side of the blocks that are transposed at a time.
const BLOCK: usize = 4;

/// The plan and the memory of transforms of `size` x `size` numbers.
#[derive(Clone)]
pub struct Fft2d {
    size: usize,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
    transposed: Vec<Complex32>,
    scratch: Vec<Complex32>,
}

impl Fft2d {
    /// Plans transforms of a size; [`fast_size`] returns one that is fast.
    pub fn new(size: usize) -> Self {
        let mut planner = FftPlanner::new();
        let (forward, inverse) = (planner.plan_fft_forward(size), planner.plan_fft_inverse(size));
        let scratch = forward.get_inplace_scratch_len().max(inverse.get_inplace_scratch_len());
        let zero = Complex32::default();
        Self { size, forward, inverse, transposed: vec![zero; size * size], scratch: vec![zero; scratch] }
    }

    /// The number of rows and columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Allocates the data of one transform: `size` x `size` zeros.
    pub fn memory(&self) -> Vec<Complex32> {
        vec![Complex32::default(); self.size * self.size]
    }

    /// Transforms `data`; the result is transposed.
    ///
    /// # Panics
    ///
    /// If `data` does not have the size of the plan.
    pub fn forward(&mut self, data: &mut Vec<Complex32>) {
        let forward = Arc::clone(&self.forward);
        self.transform(forward.as_ref(), data);
    }

    /// Inverts [`Self::forward`], including the transpose, without the factor 1 / `size` squared.
    ///
    /// # Panics
    ///
    /// If `data` does not have the size of the plan.
    pub fn inverse(&mut self, data: &mut Vec<Complex32>) {
        let inverse = Arc::clone(&self.inverse);
        self.transform(inverse.as_ref(), data);
    }

    /// Transforms the rows of `data` by `line`, transposes them, and transforms the rows again.
    fn transform(&mut self, line: &dyn Fft<f32>, data: &mut Vec<Complex32>) {
        assert_eq!(data.len(), self.transposed.len(), "the size of the data differs from the plan");
        line.process_with_scratch(data, &mut self.scratch);
        transpose(data, &mut self.transposed, self.size);
        std::mem::swap(data, &mut self.transposed);
        line.process_with_scratch(data, &mut self.scratch);
    }
}

/// Transposes a square of `size` x `size` numbers in blocks.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn transpose(from: &[Complex32], to: &mut [Complex32], size: usize) {
    let whole = size / BLOCK * BLOCK;
    for top in (0..whole).step_by(BLOCK) {
        for left in (0..whole).step_by(BLOCK) {
            let mut rows = [[Complex32::default(); BLOCK]; BLOCK];
            for (row, line) in rows.iter_mut().enumerate() {
                line.copy_from_slice(&from[(top + row) * size + left..][..BLOCK]);
            }
            for column in 0..BLOCK {
                let mut line = [Complex32::default(); BLOCK];
                for (value, row) in line.iter_mut().zip(&rows) {
                    *value = row[column];
                }
                to[(left + column) * size + top..][..BLOCK].copy_from_slice(&line);
            }
        }
    }
    for k in whole..size {
        for other in 0..size {
            to[k * size + other] = from[other * size + k];
            to[other * size + k] = from[k * size + other];
        }
    }
}

/// Returns the smallest size that is fast to transform: at least `min` and 8, without a prime factor above 5.
pub fn fast_size(min: usize) -> usize {
    let smooth = |size: usize| {
        let mut rest = size;
        for factor in [2, 3, 5] {
            while rest.is_multiple_of(factor) {
                rest /= factor;
            }
        }
        rest == 1
    };
    (min.max(8)..).find(|size| smooth(*size)).unwrap_or(min)
}

/// Returns the size of the transform for the circular correlation of a window `window` pixels wide.
///
/// It is the smallest multiple of eight without a prime factor above 5 that is at least `window` - 2 and 8. If it is
/// smaller than the window, the outermost pixels are left out.
pub fn circular_size(window: usize) -> usize {
    let is_fast = |size: &usize| size.is_multiple_of(8) && fast_size(*size) == *size;
    (window.saturating_sub(2).max(8)..).find(is_fast).unwrap_or(window)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The plain double sum.
    fn slow(data: &[Complex32], size: usize) -> Vec<(f64, f64)> {
        let mut out = Vec::new();
        for kx in 0..size {
            for ky in 0..size {
                let mut sum = (0.0, 0.0);
                for (k, value) in data.iter().enumerate() {
                    let (x, y) = (k % size, k / size);
                    let angle = -std::f64::consts::TAU * ((kx * x + ky * y) % size) as f64 / size as f64;
                    let ((sin, cos), re, im) = (angle.sin_cos(), f64::from(value.re), f64::from(value.im));
                    sum.0 += re * cos - im * sin;
                    sum.1 += re * sin + im * cos;
                }
                out.push(sum);
            }
        }
        out
    }

    fn noise(size: usize) -> Vec<Complex32> {
        let mut state = size as u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        (0..size * size).map(|_| Complex32::new(random(), random())).collect()
    }

    #[test]
    fn the_fast_transform_equals_the_double_sum_at_every_mix_of_factors_with_dirty_memory() {
        for size in [8, 9, 10, 12, 15, 16, 24, 25, 32, 36] {
            let mut data = noise(size);
            let expected = slow(&data, size);
            let mut fft = Fft2d::new(size);
            fft.transposed.fill(Complex32::new(f32::NAN, f32::NAN));
            fft.forward(&mut data);
            for (k, (value, (re, im))) in data.iter().zip(expected).enumerate() {
                let error = (f64::from(value.re) - re).abs().max((f64::from(value.im) - im).abs());
                assert!(error < 1e-5 * (size * size) as f64, "size {size}, {k}: {error}");
            }
        }
    }

    #[test]
    fn the_inverse_restores_the_data() {
        for size in [20, 32, 45, 64] {
            let original = noise(size);
            let (mut data, mut fft) = (original.clone(), Fft2d::new(size));
            fft.forward(&mut data);
            fft.inverse(&mut data);
            let scale = 1.0 / (size * size) as f32;
            for (found, expected) in data.iter().zip(&original) {
                assert!((found * scale - expected).norm() < 1e-5, "size {size}");
            }
        }
    }

    #[test]
    fn fast_sizes_have_no_large_factor() {
        assert_eq!([1, 63, 64, 65, 67, 97].map(fast_size), [8, 64, 64, 72, 72, 100]);
        assert_eq!([9, 21, 31, 33, 35, 41, 51].map(circular_size), [8, 24, 32, 32, 40, 40, 64]);
    }
}
