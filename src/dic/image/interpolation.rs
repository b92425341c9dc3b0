//! Interpolation: the quintic B-spline prefilter and an optimised six-tap kernel on its coefficients.
//!
//! The kernel is not the B-spline itself. Its weights are degree-5 polynomials of the fraction `t`, fitted so that
//! prefilter and kernel together approximate a pure shift `exp(i w t)` at the frequencies of speckle. The fit is by
//! least squares over `t` in 0..1 and `w` in 0..pi, weighted by `exp(-(w / 0.8)^2) + 1e-4`, with the weights summing to
//! one. It has a quarter of the quintic B-spline's bias at the same cost. The prefilter follows M. Unser, A. Aldroubi,
//! M. Eden, IEEE Trans. Signal Process. 41 (1993) 834, <https://doi.org/10.1109/78.193221>.

use super::padded_image::{MARGIN, PaddedImage, mirror_row, reflect_index};
use crate::dic::geometry::Size;
use crate::numeric::{LANES, Vector, vectorized};

/// The interpolation of a target between its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// A quintic prefilter and a six-tap kernel optimised for speckle, with a bias of at most 0.0003 px.
    Optimised,
    /// A cubic B-spline through 4 x 4 pixels, as in OpenCorr, with some thousandths of a pixel of bias on sharp
    /// speckle. For comparisons with OpenCorr.
    Bicubic,
}

impl Interpolation {
    /// The names in configurations and on the command line.
    pub const WORDS: [(&str, Self); 2] = [("optimised", Self::Optimised), ("bicubic", Self::Bicubic)];
}

/// The poles of the quintic B-spline's prefilter.
const POLES: [f64; 2] = [-0.430_575_347_099_973_8, -0.043_096_288_203_264_65];

/// The length of a pole's impulse response (0.43^15 = 3e-6), px.
const REACH: usize = 14;

/// The weights of six taps as polynomials of the fraction.
#[derive(Debug, PartialEq)]
struct Kernel {
    /// The number of taps with non-zero weight: 6 or 4.
    taps: usize,
    /// The even part of the weights of taps 1, 2, 3 (mirrored: 0, -1, -2), by powers of (t - 1/2)^2.
    even: [[f32; 3]; 3],
    /// The odd part, by powers of (t - 1/2)^2, to be multiplied by t - 1/2.
    odd: [[f32; 3]; 3],
}

/// The optimised kernel, for coefficients of the quintic prefilter.
#[expect(clippy::excessive_precision, reason = "the digits of the fit; rounding them would hide where they come from")]
static OPTIMISED: Kernel = Kernel {
    taps: 6,
    even: [
        [4.398_384_2e-1, -2.389_174e-1, 5.168_988_8e-2],
        [5.800_446_4e-2, 2.384_522e-1, -8.206_977e-2],
        [2.157_120_3e-3, 4.651_872_9e-4, 3.037_988_2e-2],
    ],
    odd: [
        [3.957_628_9e-1, -2.678_602_2e-1, 7.267_808_5e-2],
        [1.982_516_8e-1, 4.939_555_5e-2, -3.634_419_5e-2],
        [1.872_997e-3, 2.399_093_3e-2, 7.423_789_7e-3],
    ],
};

/// A cubic B-spline fitted to the four surrounding grey levels in every cell, for unfiltered levels.
///
/// Z. Pan, W. Chen, Z. Jiang, L. Tang, Y. Liu, Z. Liu, Theor. Appl. Mech. Lett. 6 (2016) 126,
/// <https://doi.org/10.1016/j.taml.2016.04.003>.
static BICUBIC: Kernel = Kernel {
    taps: 4,
    even: [[19.0 / 32.0, -3.0 / 8.0, 0.0], [-3.0 / 32.0, 3.0 / 8.0, 0.0], [0.0; 3]],
    odd: [[9.0 / 7.0, -8.0 / 7.0, 0.0], [-3.0 / 28.0, 3.0 / 7.0, 0.0], [0.0; 3]],
};

impl Kernel {
    /// Returns the weights of the taps at -2, -1, 0, 1, 2, 3 px for a position `t` (0 to 1 px) after the tap at 0 px.
    #[inline(always)]
    fn weights(&self, t: f32) -> [f32; 6] {
        let s = t - 0.5;
        let square = s * s;
        let mut weights = [0.0; 6];
        for pair in 0..3 {
            let even = self.even[pair][0] + square * (self.even[pair][1] + square * self.even[pair][2]);
            let odd = s * (self.odd[pair][0] + square * (self.odd[pair][1] + square * self.odd[pair][2]));
            weights[3 + pair] = even + odd;
            weights[2 - pair] = even - odd;
        }
        weights
    }

    /// Returns [`Self::weights`] for eight positions.
    #[inline(always)]
    fn lane_weights<V: Vector>(&self, t: V) -> [V; 6] {
        let s = t.sub(V::splat(0.5));
        let square = s.mul(s);
        let even = [
            evaluate_quadratic(&self.even[0], square),
            evaluate_quadratic(&self.even[1], square),
            evaluate_quadratic(&self.even[2], square),
        ];
        let odd = [
            evaluate_quadratic(&self.odd[0], square),
            evaluate_quadratic(&self.odd[1], square),
            evaluate_quadratic(&self.odd[2], square),
        ];
        let odd = [s.mul(odd[0]), s.mul(odd[1]), s.mul(odd[2])];
        [
            even[2].sub(odd[2]),
            even[1].sub(odd[1]),
            even[0].sub(odd[0]),
            even[0].add(odd[0]),
            even[1].add(odd[1]),
            even[2].add(odd[2]),
        ]
    }
}

/// Evaluates c0 + c1 x + c2 x^2.
#[inline(always)]
fn evaluate_quadratic<V: Vector>(c: &[f32; 3], x: V) -> V {
    V::splat(c[0]).plus_product(x, V::splat(c[1]).plus_product(x, V::splat(c[2])))
}

/// An image that can be evaluated between its pixels.
#[derive(Debug, Clone)]
pub(in crate::dic) struct InterpolatedImage {
    /// The values that the kernel is applied to.
    pub(super) plane: PaddedImage,
    kernel: &'static Kernel,
    /// The root mean square of the levels, if known, DN.
    pub(in crate::dic) contrast: f32,
}

impl Default for InterpolatedImage {
    fn default() -> Self {
        Self { plane: PaddedImage::default(), kernel: &OPTIMISED, contrast: 0.0 }
    }
}

impl InterpolatedImage {
    /// Computes the interpolation coefficients of `levels`, reusing memory, and leaves `contrast` as it was.
    ///
    /// The margin of `levels` must be mirrored. For [`Interpolation::Bicubic`] they are the levels themselves.
    pub(in crate::dic) fn fill(&mut self, levels: &PaddedImage, interpolation: Interpolation) {
        match interpolation {
            Interpolation::Optimised => {
                self.kernel = &OPTIMISED;
                self.plane.reshape(levels.width(), levels.height());
                prefilter(levels, &mut self.plane);
            }
            Interpolation::Bicubic => {
                self.kernel = &BICUBIC;
                self.plane.clone_from(levels);
            }
        }
    }

    /// Computes the interpolation coefficients of `levels`. See [`Self::fill`].
    pub(in crate::dic) fn new(levels: &PaddedImage, interpolation: Interpolation) -> Self {
        let mut interpolated = Self::default();
        interpolated.fill(levels, interpolation);
        interpolated
    }

    /// The width, px.
    pub(in crate::dic) fn width(&self) -> usize {
        self.plane.width()
    }

    /// The height, px.
    pub(in crate::dic) fn height(&self) -> usize {
        self.plane.height()
    }

    /// The width and the height, px.
    pub(in crate::dic) fn size(&self) -> Size {
        self.plane.size()
    }

    /// The number of taps of the kernel along each axis: 6, or 4 if the outer weights are zero.
    pub(in crate::dic) fn tap_count(&self) -> usize {
        self.kernel.taps
    }

    /// Returns the coefficients, beginning at the first of the `N` x `N` taps of the cell at (x, y), and the row
    /// stride.
    #[inline(always)]
    pub(in crate::dic) fn taps<const N: usize>(&self, x: isize, y: isize) -> (&[f32], usize) {
        self.taps_from(self.first_tap::<N>(x, y))
    }

    /// Returns the index of the first of `N` x `N` taps of the cell whose upper left pixel is (x, y).
    #[inline(always)]
    pub(in crate::dic) fn first_tap<const N: usize>(&self, x: isize, y: isize) -> usize {
        let before = (N / 2 - 1) as isize;
        self.plane.index(x - before, y - before)
    }

    /// The row stride of the taps.
    #[inline(always)]
    pub(in crate::dic) fn stride(&self) -> usize {
        self.plane.stride()
    }

    /// Returns the coefficients from the tap of this index on, and the row stride.
    #[inline(always)]
    pub(in crate::dic) fn taps_from(&self, first: usize) -> (&[f32], usize) {
        (&self.plane.data()[first..], self.plane.stride())
    }

    /// Returns the weights of the six taps for a position `t` (0 to 1) after the third.
    #[inline(always)]
    pub(in crate::dic) fn weights(&self, t: f32) -> [f32; 6] {
        self.kernel.weights(t)
    }

    /// Returns the inner `N` of [`Self::weights`] for eight positions.
    #[inline(always)]
    pub(in crate::dic) fn lane_weights<V: Vector, const N: usize>(&self, t: V) -> [V; N] {
        let weights = self.kernel.lane_weights(t);
        let mut inner = [weights[0]; N];
        inner.copy_from_slice(&weights[(6 - N) / 2..][..N]);
        inner
    }

    /// Returns the interpolated level at (x, y) px, DN; inside the image or at most 12 px outside, where it is
    /// mirrored.
    ///
    /// # Panics
    ///
    /// If the taps reach beyond the memory of the image and its margin.
    #[inline(always)]
    pub(in crate::dic) fn value_at(&self, x: f64, y: f64) -> f32 {
        let (cell_x, cell_y) = (x.floor(), y.floor());
        let (weights_x, weights_y) = (self.weights((x - cell_x) as f32), self.weights((y - cell_y) as f32));
        let (taps, stride) = self.taps::<6>(cell_x as isize, cell_y as isize);
        let mut sum = 0.0;
        for (row, weight) in weights_y.iter().enumerate() {
            let taps = &taps[row * stride..row * stride + 6];
            sum += weight * taps.iter().zip(&weights_x).map(|(c, w)| c * w).sum::<f32>();
        }
        sum
    }
}

/// Computes quintic-spline coefficients from grey levels, margin included.
///
/// Both planes have one shape. The margin of `levels` and the edges are mirrored.
fn prefilter(levels: &PaddedImage, coefficients: &mut PaddedImage) {
    filter_rows(levels, coefficients);
    if levels.height() > 1 {
        filter_columns(coefficients);
    }
    coefficients.mirror_margin();
}

/// The prefilter as a cascade of three symmetric filters, with weights at distances 0, 1, 2; 0, 2, 4 and 0, 4, 8, 12
/// px.
///
/// 1 / (1 - p z) = (1 + p z) (1 + p^2 z^2) (1 + p^4 z^4) ..., and the same backwards: each pair of factors has three
/// taps. The truncation error is the larger pole to the power of 16, 1e-6, and the smaller to the power of 4, 3e-6.
struct Cascade {
    near: [f32; 3],
    middle: [f32; 3],
    far: [f32; 4],
}

impl Cascade {
    /// Multiplies the factors of both [`POLES`] to three filters and includes the prefilter's gain in the first.
    fn new() -> Self {
        let [a, b] = POLES;
        let mut gain = 120.0 * a * b;
        // The outer taps of a pair of factors whose middle tap is 1.
        let mut outer = |pole: f64, distance: i32| {
            let factor = pole.powi(distance);
            gain *= 1.0 + factor * factor;
            factor / (1.0 + factor * factor)
        };
        let [a1, a2, a4, a8] = [1, 2, 4, 8].map(|distance| outer(a, distance));
        let [b1, b2] = [1, 2].map(|distance| outer(b, distance));
        let near = convolve_symmetric([1.0, a1, 0.0], [1.0, b1, 0.0]);
        let middle = convolve_symmetric([1.0, a2, 0.0], [1.0, b2, 0.0]);
        let far = convolve_symmetric([1.0, a4, 0.0, 0.0], [1.0, 0.0, a8, 0.0]);
        Self {
            near: near.map(|weight| (gain * weight) as f32),
            middle: middle.map(|weight| weight as f32),
            far: far.map(|weight| weight as f32),
        }
    }
}

/// Convolves two symmetric filters, given by their weights at distances 0, 1, 2 and so on; drops distances beyond `N`.
fn convolve_symmetric<const N: usize>(one: [f64; N], other: [f64; N]) -> [f64; N] {
    let at = |filter: &[f64; N], distance: isize| filter.get(distance.unsigned_abs()).copied().unwrap_or(0.0);
    let reach = N as isize;
    std::array::from_fn(|d| (-reach..=reach).map(|k| at(&one, k) * at(&other, d as isize - k)).sum())
}

vectorized! {
    /// Applies the quintic prefilter along the rows of `levels` into `out`, by convolution.
    ///
    /// A recursion would proceed one pixel at a time. The margin of `out` is unspecified afterwards.
    fn filter_rows(levels: &PaddedImage, out: &mut PaddedImage) = filter_rows_with
}

/// Implements [`filter_rows`] on vectors of type `V`.
#[inline(always)]
fn filter_rows_with<V: Vector>(levels: &PaddedImage, out: &mut PaddedImage) {
    let (width, cascade) = (levels.width(), Cascade::new());
    let (near, middle, far) = (cascade.near.map(V::splat), cascade.middle.map(V::splat), cascade.far.map(V::splat));
    // Rows with their margins. The last vector may extend over the end.
    let (mut first, mut second) = (vec![0.0; levels.stride() + LANES], vec![0.0; levels.stride() + LANES]);
    for y in 0..levels.height() {
        let row = &levels.data()[levels.index(-(MARGIN as isize), y as isize)..];
        filter_symmetric::<V, 3, 1>(row, &near, &mut first, MARGIN - LANES, width + 2 * LANES);
        filter_symmetric::<V, 3, 2>(&first, &middle, &mut second, MARGIN, width);
        // A mirrored row stays mirrored under a symmetric filter.
        mirror_row(&mut second[..levels.stride()], width);
        // Writes into the margin, which is filled later.
        filter_symmetric::<V, 4, 4>(&second, &far, out.padded_row_mut(y), MARGIN, width);
    }
}

/// Applies a filter with `N` weights at distances 0, `STEP`, 2 `STEP` and so on to both sides, to `count` values from
/// `first` on.
#[inline(always)]
fn filter_symmetric<V: Vector, const N: usize, const STEP: usize>(
    from: &[f32],
    weights: &[V; N],
    to: &mut [f32],
    first: usize,
    count: usize,
) {
    for x in (first..first + count).step_by(LANES) {
        let near = &from[x - (N - 1) * STEP..][..2 * (N - 1) * STEP + LANES];
        let mut sum = V::load(&near[(N - 1) * STEP..]).mul(weights[0]);
        for (k, weight) in weights.iter().enumerate().skip(1) {
            let (left, right) = (V::load(&near[(N - 1 - k) * STEP..]), V::load(&near[(N - 1 + k) * STEP..]));
            sum = sum.plus_product(left.add(right), *weight);
        }
        sum.store(&mut to[x..]);
    }
}

vectorized! {
    /// Applies the quintic prefilter down the columns in place, by recursion, in strips of adjacent columns.
    ///
    /// `plane` has at least two rows. Its margin is unspecified afterwards.
    fn filter_columns(plane: &mut PaddedImage) = filter_columns_with
}

/// Implements [`filter_columns`] on vectors of type `V`.
#[inline(always)]
fn filter_columns_with<V: Vector>(plane: &mut PaddedImage) {
    let (width, height, stride) = (plane.width(), plane.height(), plane.stride());
    let first = plane.index(0, 0);
    let tail: [Vec<(usize, f32)>; 2] = POLES
        .map(|pole| (0..=REACH).map(|k| (reflect_index(k as isize, height), pole.powi(k as i32) as f32)).collect());
    let mut x = 0;
    while x < width {
        let rows = &mut plane.data_mut()[first + x..];
        if width - x >= 4 * LANES {
            filter_strip::<V, 4>(rows, stride, height, &tail);
            x += 4 * LANES;
        } else {
            filter_strip::<V, 1>(rows, stride, height, &tail);
            x += LANES;
        }
    }
}

/// Applies the recursive filters of both [`POLES`], down and up, to `8 N` columns.
///
/// `rows` starts at the first pixel of the strip. `tail` holds, for each pole, the rows and factors whose sum starts
/// the downward recursion of a mirrored column.
#[inline(always)]
fn filter_strip<V: Vector, const N: usize>(
    rows: &mut [f32],
    stride: usize,
    height: usize,
    tail: &[Vec<(usize, f32)>; 2],
) {
    let mut gain = 1.0;
    for (pole, tail) in POLES.into_iter().zip(tail) {
        gain *= (1.0 - pole) * (1.0 - 1.0 / pole);
        let z = V::splat(pole as f32);
        // The first causal value of a mirrored column is the sum of its tail.
        let mut state = [V::splat(0.0); N];
        for (y, factor) in tail {
            for (k, state) in state.iter_mut().enumerate() {
                *state = state.plus_product(V::load(&rows[y * stride + k * LANES..]), V::splat(*factor));
            }
        }
        let mut before = state;
        for y in 0..height {
            for k in 0..N {
                let at = &mut rows[y * stride + k * LANES..];
                if y > 0 {
                    before[k] = state[k];
                    state[k] = V::load(at).plus_product(z, state[k]);
                }
                state[k].store(at);
            }
        }
        let last = V::splat((pole / (pole * pole - 1.0)) as f32);
        let scale = V::splat(if pole.to_bits() == POLES[1].to_bits() { gain as f32 } else { 1.0 });
        for k in 0..N {
            state[k] = last.mul(state[k].add(z.mul(before[k])));
            state[k].mul(scale).store(&mut rows[(height - 1) * stride + k * LANES..]);
        }
        for y in (0..height - 1).rev() {
            for (k, state) in state.iter_mut().enumerate() {
                let at = &mut rows[y * stride + k * LANES..];
                *state = z.mul(state.sub(V::load(at)));
                state.mul(scale).store(at);
            }
        }
    }
}

const _: () = assert!(MARGIN >= 12, "the six taps, one cell of widening and eight lanes need room");

#[cfg(test)]
mod tests {
    use super::*;

    fn noise_plane(width: usize, height: usize) -> PaddedImage {
        let mut plane = PaddedImage::default();
        plane.reshape(width, height);
        let mut state = 12_345_u32;
        for y in 0..height {
            for value in plane.row_mut(y) {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                *value = (state >> 24) as f32 - 128.0;
            }
        }
        plane.mirror_margin();
        plane
    }

    /// The quintic B-spline at whole pixels is 1, 26, 66, 26, 1 over 120.
    #[test]
    fn coefficients_weighted_with_the_b_spline_reproduce_the_pixels_at_every_size() {
        for (width, height) in [(1, 1), (2, 3), (3, 2), (5, 40), (64, 33)] {
            let original = noise_plane(width, height);
            let mut filtered = noise_plane(width, height);
            prefilter(&original, &mut filtered);
            let weights = [1.0, 26.0, 66.0, 26.0, 1.0];
            for y in 0..height {
                for x in 0..width {
                    let mut sum = 0.0;
                    for (j, wy) in weights.iter().enumerate() {
                        for (i, wx) in weights.iter().enumerate() {
                            let index = filtered.index(x as isize + i as isize - 2, y as isize + j as isize - 2);
                            sum += wx * wy / 14_400.0 * filtered.data()[index];
                        }
                    }
                    let error = (sum - original.row(y)[x]).abs();
                    assert!(error < 0.02, "{width} x {height} at {x}, {y}: off by {error}");
                }
            }
        }
    }

    #[test]
    fn the_bicubic_kernel_reproduces_the_pixels() {
        let levels = noise_plane(9, 8);
        let interpolated = InterpolatedImage::new(&levels, Interpolation::Bicubic);
        for (x, y) in (0..72).map(|k| (k % 9, k / 9)) {
            assert!((interpolated.value_at(x as f64, y as f64) - levels.row(y)[x]).abs() < 1e-4, "{x}, {y}");
        }
    }

    #[test]
    fn the_weights_sum_to_one_and_mirror() {
        for step in 0..=100 {
            let t = step as f32 / 100.0;
            for kernel in [&OPTIMISED, &BICUBIC] {
                let (forward, mut backward) = (kernel.weights(t), kernel.weights(1.0 - t));
                backward.reverse();
                let sum: f32 = forward.iter().sum();
                assert!((sum - 1.0).abs() < 1e-6, "{t}: {sum}");
                assert!(forward.iter().zip(&backward).all(|(a, b)| (a - b).abs() < 1e-6), "{t}");
            }
        }
    }

    /// Prefilter and kernel together shift a wave by exactly `t`, which keeps the bias small.
    #[test]
    fn waves_longer_than_six_pixels_are_shifted_to_within_0_0003_px() {
        for step in 0..=20 {
            let t = f64::from(step) / 20.0;
            let weights = OPTIMISED.weights(t as f32);
            for frequency in [0.2_f64, 0.5, 0.8, 1.0] {
                let (re, im) = weights.iter().enumerate().fold((0.0, 0.0), |(re, im), (tap, weight)| {
                    let phase = frequency * (tap as f64 - 2.0);
                    (re + f64::from(*weight) * phase.cos(), im + f64::from(*weight) * phase.sin())
                });
                let shift = im.atan2(re) / frequency;
                assert!((shift - t).abs() < 3e-4, "t {t}, {frequency} rad/px: {shift}");
            }
        }
    }
}
