//! Standard uncertainty of a displacement from the pair of images itself.
//!
//! The residual of a match contains the noise of both frames. If it is white, its variance times the inverse Hessian is
//! the variance of the result. With coarsely sampled speckles it is not white: the residual of interpolation alternates
//! in sign and hardly moves the result. The factor `q = sum over short lags of rho_residual rho_gradient`, pooled over
//! windows of the pair, accounts for that. Noise is also not uniform: photon noise is larger on bright paint than on
//! dark speckles, and only noise at grey-level slopes moves the result.

mod misfit;
use super::gradient_gain::GradientGain;
use crate::dic::geometry::{Block, Pixel, SubsetMask};
use crate::dic::image::PaddedImage;
use crate::dic::subset::{Layers, ReferenceSubset};
use crate::numeric::{LANES, Lanes, Vector, vectorized};

/// The largest lag, px.
const REACH: usize = 2;
/// The number of lags of one half plane: (0, 0..=2) and (1..=2, -2..=2).
const LAGS: usize = (REACH + 1) * (2 * REACH + 1);

/// The variance of the difference of two frames from rounding to whole grey levels, DN^2.
pub(in crate::dic) const ROUNDING: f64 = 2.0 / 12.0;

/// The maximum number of pooled windows.
///
/// Half of the rows of one 31 x 31 window determine the factor to some 7 %, those of all to half of that.
pub(in crate::dic) const POOLED: usize = 4;

/// The minimum number of rows of a window for its autocorrelation.
const MIN_ROWS: usize = 16;

/// One sum per lag.
pub(in crate::dic) type Lags = [f64; LAGS];

/// Sums over the windows of one pair.
#[derive(Debug, Clone, Default)]
pub(in crate::dic) struct NoisePool {
    residual: Lags,
    pairs: Lags,
    gradient_x: Lags,
    gradient_y: Lags,
    slopes: GradientNoise,
    gradient_gain: GradientGain,
    dense: Vec<f32>,
    /// The gradients along x and y and the residual of a window in planes.
    layers: [Vec<f32>; 3],
}

/// The noise of all pixels, and of pixels weighted with their slopes.
///
/// Holds the sums of squares of the residual, of the slopes along x and y, and of the products of these squares.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::dic) struct GradientNoise {
    sums: [f64; 5],
    pixels: f64,
}

/// The mean levels of the reference and of the target in a window, and the target's gain.
#[derive(Debug, Clone, Copy)]
pub(in crate::dic) struct GreyLevelFit {
    pub(in crate::dic) means: (f32, f32),
    pub(in crate::dic) gain: f32,
}

/// The quantity whose autocorrelation is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    Residual,
    GradientX,
    GradientY,
}

/// The factor of short-range correlation on the variance along x and y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::dic) struct VarianceFactor {
    /// The factor for the variance of u.
    pub(in crate::dic) x: f64,
    /// The factor for the variance of v.
    pub(in crate::dic) y: f64,
}

impl NoisePool {
    /// Clears all sums, for the next pair of frames.
    pub(in crate::dic) fn clear(&mut self) {
        for sums in [&mut self.residual, &mut self.pairs, &mut self.gradient_x, &mut self.gradient_y] {
            sums.fill(0.0);
        }
        (self.slopes, self.gradient_gain) = (GradientNoise::default(), GradientGain::default());
    }

    /// Adds the texture of one window, and the autocorrelation and slope weights of its residual, packed like the
    /// subset.
    pub(in crate::dic) fn add_window(&mut self, subset: &ReferenceSubset, window: &SubsetMask, residual: &[Lanes]) {
        self.add_texture(subset, window);
        self.add_part(Part::Residual, window, residual);
        self.slopes.add(GradientNoise::from_window(subset, window, residual));
    }

    /// Adds texture and residual of one window about `at`, taken from planes, with the grey-level fit of its match.
    ///
    /// `pairs` are those of [`count_pairs`]. All windows added this way must have one shape.
    pub(in crate::dic) fn add_layers(
        &mut self,
        layers: Layers<'_>,
        window: &SubsetMask,
        pairs: &Lags,
        at: Pixel,
        fit: GreyLevelFit,
    ) {
        self.pairs.iter_mut().zip(pairs).for_each(|(sum, pairs)| *sum += pairs);
        let side = side_of(window);
        self.layers.iter_mut().for_each(|dense| dense.resize(dense_len(side), 0.0));
        unpack_layers(layers, window, at, fit, &mut self.layers, &mut self.slopes.sums);
        self.slopes.pixels += window.pixels as f64;
        let [gradient_x, gradient_y, residual] = &self.layers;
        add_lags(gradient_x, side, &mut self.gradient_x);
        add_lags(gradient_y, side, &mut self.gradient_y);
        add_lags(residual, side, &mut self.residual);
    }

    /// Adds the gradient gain of the pixels of one window.
    pub(in crate::dic) fn add_gradient_gain(&mut self, gradient_gain: GradientGain) {
        self.gradient_gain.add(gradient_gain);
    }

    /// Returns the gradient gain of all windows added: the factor on the inverse Hessian's standard uncertainties.
    pub(in crate::dic) fn gradient_gain(&self) -> f64 {
        self.gradient_gain.gain()
    }

    /// Adds the autocorrelation of `rows`, one quantity of a window, packed like the window's mask.
    fn add_part(&mut self, part: Part, window: &SubsetMask, rows: &[Lanes]) {
        unpack_clean(window, rows, &mut self.dense);
        let sums = match part {
            Part::Residual => &mut self.residual,
            Part::GradientX => &mut self.gradient_x,
            Part::GradientY => &mut self.gradient_y,
        };
        add_lags(&self.dense, side_of(window), sums);
    }

    /// Replaces the residual of the one window whose texture was added; an empty one clears it.
    pub(in crate::dic) fn set_residual(&mut self, window: &SubsetMask, residual: &[Lanes]) {
        self.residual.fill(0.0);
        if residual.is_empty() {
            return;
        }
        // Pixels off the window are already zero, from its texture.
        unpack_over(window, residual, &mut self.dense);
        add_lags(&self.dense, side_of(window), &mut self.residual);
    }

    /// Adds the sums of one window that do not depend on the target: pixel pairs and gradients.
    pub(in crate::dic) fn add_texture(&mut self, subset: &ReferenceSubset, window: &SubsetMask) {
        self.pairs.iter_mut().zip(count_pairs(window)).for_each(|(sum, pairs)| *sum += pairs);
        self.add_part(Part::GradientX, window, &subset.gradient_x);
        self.add_part(Part::GradientY, window, &subset.gradient_y);
    }

    /// Returns the variance factors of the windows added; 1 without any.
    ///
    /// They are the `q` of the module, limited to 0.1 to 10, times the correction for noise that depends on the grey
    /// level ([`VarianceFactor::weighted_by_slopes`]).
    pub(in crate::dic) fn factor(&self) -> VarianceFactor {
        let correlated = |gradient: &Lags| {
            let zero = lag_index(0, 0);
            let variance = self.residual[zero] / self.pairs[zero].max(1.0);
            if !(variance > 0.0 && gradient[zero] > 0.0) {
                return 1.0;
            }
            let mut sum = 0.0;
            for lag in 0..LAGS {
                let (dy, dx) = (lag / (2 * REACH + 1), (lag % (2 * REACH + 1)) as isize - REACH as isize);
                if dy == 0 && dx < 0 {
                    continue;
                }
                let both = if lag == zero { 1.0 } else { 2.0 };
                let rho = self.residual[lag] / self.pairs[lag].max(1.0) / variance;
                sum += both * rho * gradient[lag] / gradient[zero];
            }
            sum.clamp(0.1, 10.0)
        };
        VarianceFactor { x: correlated(&self.gradient_x), y: correlated(&self.gradient_y) }
            .weighted_by_slopes(&self.slopes)
    }
}

/// Returns the index of a lag (dx along the row, dy rows down).
fn lag_index(dx: isize, dy: usize) -> usize {
    dy * (2 * REACH + 1) + (dx + REACH as isize) as usize
}

/// Returns the number of pixel pairs of a window at each lag, counted in the rows that [`add_lags`] visits.
pub(in crate::dic) fn count_pairs(window: &SubsetMask) -> Lags {
    let (mut dense, mut pairs) = (Vec::new(), [0.0; LAGS]);
    unpack_clean(window, &window.mask, &mut dense);
    add_lags(&dense, side_of(window), &mut pairs);
    pairs
}

/// Returns the side of the square around a window, px.
fn side_of(window: &SubsetMask) -> usize {
    2 * window.half as usize + 1
}

/// Returns the row stride of a square, a multiple of eight: each row is followed by zeros, as far as lags reach.
fn stride_of(side: usize) -> usize {
    (side + REACH).next_multiple_of(LANES)
}

/// Returns the length of a square with the zeros of its rows, and as many rows of zeros as lags reach.
fn dense_len(side: usize) -> usize {
    (side + REACH) * stride_of(side) + 2 * LANES
}

/// Unpacks values packed like a window's mask into its square, which is cleared first.
fn unpack_clean(window: &SubsetMask, packed: &[Lanes], dense: &mut Vec<f32>) {
    dense.clear();
    unpack_over(window, packed, dense);
}

/// Unpacks like [`unpack_clean`], over a square that is empty or holds values of the same window.
fn unpack_over(window: &SubsetMask, packed: &[Lanes], dense: &mut Vec<f32>) {
    let side = side_of(window);
    dense.resize(dense_len(side), 0.0);
    for block in &window.blocks {
        let rows = &packed[block.start..block.start + block.rows];
        for (lanes, first) in rows.iter().zip((block_start(window, block)..).step_by(stride_of(side))) {
            dense[first..first + LANES].copy_from_slice(&lanes.0);
        }
    }
}

/// Returns the index in the square of the first pixel of a block. A last block may extend beyond the square into the
/// zeros, where its mask has zeros too.
fn block_start(window: &SubsetMask, block: &Block) -> usize {
    let (left, top) = ((window.half as i32 + block.dx) as usize, (window.half as i32 + block.dy) as usize);
    top * stride_of(side_of(window)) + left
}

vectorized! {
    /// Unpacks the gradients and the residual of a window in planes into squares and adds the sums of [`add_squares`].
    fn unpack_layers(
        layers: Layers<'_>,
        window: &SubsetMask,
        at: Pixel,
        fit: GreyLevelFit,
        dense: &mut [Vec<f32>; 3],
        sums: &mut [f64; 5],
    ) = unpack_layers_with
}

/// Implements [`unpack_layers`] on vectors of type `V`.
#[inline(always)]
fn unpack_layers_with<V: Vector>(
    layers: Layers<'_>,
    window: &SubsetMask,
    at: Pixel,
    fit: GreyLevelFit,
    dense: &mut [Vec<f32>; 3],
    sums: &mut [f64; 5],
) {
    let (stride, dense_stride) = (layers.reference.stride(), stride_of(side_of(window)));
    let (means, gain) = ((V::splat(fit.means.0), V::splat(fit.means.1)), V::splat(fit.gain));
    let mut totals = [V::splat(0.0); 5];
    for block in &window.blocks {
        let mut from = layers.reference.index((at.x + block.dx) as isize, (at.y + block.dy) as isize);
        let mut to = block_start(window, block);
        for mask in &window.mask[block.start..block.start + block.rows] {
            let load = |plane: &PaddedImage| V::load(&plane.data()[from..]);
            let mask = V::from_lanes(mask);
            let (gx, gy) = (load(layers.gradient_x).mul(mask), load(layers.gradient_y).mul(mask));
            let (level, value) = (load(layers.reference).sub(means.0), load(layers.target).sub(means.1));
            let residual = level.sub(gain.mul(value)).mul(mask);
            add_lane_squares(gx, gy, residual, &mut totals);
            for (dense, value) in dense.iter_mut().zip([gx, gy, residual]) {
                value.store(&mut dense[to..]);
            }
            (from, to) = (from + stride, to + dense_stride);
        }
    }
    for (sum, total) in sums.iter_mut().zip(totals) {
        *sum += total.to_lanes().sum();
    }
}

/// Returns the row step of the autocorrelation: half of the rows of a 31 px window suffice, and a smaller fraction of a
/// larger one.
fn row_step(rows: usize) -> usize {
    rows.div_ceil(MIN_ROWS)
}

vectorized! {
    /// Adds the products of pixel pairs at each lag, of values laid out by [`unpack_over`].
    ///
    /// Every row is followed by zeros, so a lag is one shift of the whole square.
    fn add_lags(dense: &[f32], side: usize, sums: &mut Lags) = add_lags_with
}

/// Implements [`add_lags`] on vectors of type `V`.
#[inline(always)]
fn add_lags_with<V: Vector>(dense: &[f32], side: usize, sums: &mut Lags) {
    const WIDTH: usize = 2 * REACH + 1;
    let stride = stride_of(side);
    let mut totals = [V::splat(0.0); LAGS];
    for row in (0..side).step_by(row_step(side)) {
        for first in (row * stride..row * stride + side).step_by(LANES) {
            let own = V::load(&dense[first..]);
            for dx in 0..=REACH {
                let total = &mut totals[REACH + dx];
                *total = total.plus_product(own, V::load(&dense[first + dx..]));
            }
            for dy in 1..=REACH {
                let row = &dense[first + dy * stride - REACH..][..WIDTH - 1 + LANES];
                for dx in 0..WIDTH {
                    let total = &mut totals[dy * WIDTH + dx];
                    *total = total.plus_product(own, V::load(&row[dx..]));
                }
            }
        }
    }
    for (sum, total) in sums.iter_mut().zip(totals) {
        *sum += total.to_lanes().sum();
    }
}

vectorized! {
    /// Adds the sums over all pixels of r^2, gx^2, gy^2, gx^2 r^2 and gy^2 r^2 to `sums`, with the residual r in DN and
    /// the gradients gx and gy in DN/px.
    ///
    /// Pixels outside the window must be zero.
    fn add_squares(gradients: [&[Lanes]; 2], residual: &[Lanes], sums: &mut [f64; 5]) = add_squares_with
}

/// Implements [`add_squares`] on vectors of type `V`.
#[inline(always)]
fn add_squares_with<V: Vector>(gradients: [&[Lanes]; 2], residual: &[Lanes], sums: &mut [f64; 5]) {
    let [along_x, along_y] = gradients;
    let mut totals = [V::splat(0.0); 5];
    for ((x, y), left) in along_x.iter().zip(along_y).zip(residual) {
        add_lane_squares(V::from_lanes(x), V::from_lanes(y), V::from_lanes(left), &mut totals);
    }
    for (sum, total) in sums.iter_mut().zip(totals) {
        *sum += total.to_lanes().sum();
    }
}

/// Adds r^2, gx^2, gy^2, gx^2 r^2 and gy^2 r^2 of eight pixels to `totals`, with r = `left`, gx = `x` and gy = `y`.
#[inline(always)]
fn add_lane_squares<V: Vector>(x: V, y: V, left: V, totals: &mut [V; 5]) {
    let (x_squared, y_squared, squared) = (x.mul(x), y.mul(y), left.mul(left));
    totals[0] = totals[0].add(squared);
    totals[1] = totals[1].add(x_squared);
    totals[2] = totals[2].add(y_squared);
    totals[3] = totals[3].plus_product(x_squared, squared);
    totals[4] = totals[4].plus_product(y_squared, squared);
}

impl GradientNoise {
    /// Computes the sums of one window with its residual.
    pub(in crate::dic) fn from_window(subset: &ReferenceSubset, window: &SubsetMask, residual: &[Lanes]) -> Self {
        let mut slopes = Self { sums: [0.0; 5], pixels: window.pixels as f64 };
        add_squares([&subset.gradient_x, &subset.gradient_y], residual, &mut slopes.sums);
        slopes
    }

    /// Adds the sums of other pixels.
    fn add(&mut self, other: Self) {
        self.sums.iter_mut().zip(other.sums).for_each(|(sum, other)| *sum += other);
        self.pixels += other.pixels;
    }

    /// Returns the ratios, for x and y, of the noise variance weighted with the squared slopes to that of all pixels.
    ///
    /// They are limited to 0.25 to 25, and 1 without slopes or noise.
    fn noise_ratios(&self) -> (f64, f64) {
        let [squares, x_squared, y_squared, x_noisy, y_noisy] = self.sums;
        let noise_ratios = |noisy: f64, squared: f64| {
            let ratio = noisy * self.pixels / (squared * squares);
            if ratio.is_finite() { ratio.clamp(0.25, 25.0) } else { 1.0 }
        };
        (noise_ratios(x_noisy, x_squared), noise_ratios(y_noisy, y_squared))
    }
}

impl VarianceFactor {
    /// Returns the factor corrected for non-uniform noise. Photon noise is larger on bright paint than on dark
    /// speckles, and the slopes lie between them.
    pub(in crate::dic) fn weighted_by_slopes(self, slopes: &GradientNoise) -> Self {
        let (x, y) = slopes.noise_ratios();
        Self { x: self.x * x, y: self.y * y }
    }

    /// Returns the variances of u and v from the variance of the residual and the diagonal of the inverse Hessian.
    ///
    /// `residual` is its variance, DN^2, which counts with the factor as at least [`ROUNDING`]. A factor below 0.44 is
    /// a sign of an aliased pair, for which no single formula is correct. The standard uncertainty is then multiplied
    /// by 1 to 1.5, reached at 0.25.
    pub(in crate::dic) fn variances(&self, residual: f64, inverse_u: f64, inverse_v: f64) -> (f64, f64) {
        let along = |factor: f64, inverse: f64| {
            let naive = 1.0 / factor.sqrt();
            let doubt = 1.0 + ((naive - 1.5) / 0.5).clamp(0.0, 1.0) * 0.5;
            (residual * factor * doubt * doubt).max(ROUNDING) * inverse
        };
        (along(self.x, inverse_u), along(self.y, inverse_v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::geometry::WindowShape;
    use crate::dic::subset::normal_equations::tests::plane;
    use crate::numeric::Portable;

    /// Returns slopes and residual of a window in `planes` about (30, 24), packed like its mask.
    fn packed<'a>(
        [reference, gradient_x, gradient_y, target]: &[PaddedImage; 4],
        window: &'a SubsetMask,
        fit: GreyLevelFit,
    ) -> [Vec<Lanes>; 3] {
        let of = |value: &dyn Fn(usize) -> f32| -> Vec<Lanes> {
            let row = |(block, row): (&Block, usize)| {
                let first = reference.index((30 + block.dx) as isize, (24 + block.dy) as isize + row as isize);
                Lanes(std::array::from_fn(|lane| value(first + lane))) * window.mask[block.start + row]
            };
            let rows = |block: &'a Block| (0..block.rows).map(move |row| (block, row));
            window.blocks.iter().flat_map(rows).map(row).collect()
        };
        let residual = |at| (reference.data()[at] - fit.means.0) - fit.gain * (target.data()[at] - fit.means.1);
        [of(&|at| gradient_x.data()[at]), of(&|at| gradient_y.data()[at]), of(&residual)]
    }

    #[test]
    fn a_window_in_planes_equals_the_packed_window() {
        let planes = [plane(1), plane(2), plane(3), plane(4)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        let fit = GreyLevelFit { means: (3.0, -2.0), gain: 0.9 };
        for (shape, size) in [(WindowShape::Square, 31), (WindowShape::Circle, 29), (WindowShape::Square, 13)] {
            let window = SubsetMask::new(shape, size);
            let [gradient_x, gradient_y, residual] = packed(&planes, &window, fit);
            let subset = ReferenceSubset { gradient_x, gradient_y, ..ReferenceSubset::default() };
            let (mut one, mut other) = (NoisePool::default(), NoisePool::default());
            for _ in 0..2 {
                one.add_window(&subset, &window, &residual);
                other.add_layers(layers, &window, &count_pairs(&window), Pixel { x: 30, y: 24 }, fit);
            }
            let (one, other) = (one.factor(), other.factor());
            assert!((one.x - 1.0).abs() > 1e-4 && (one.x / other.x - 1.0).abs() < 1e-5, "{one:?} {other:?}");
            assert!((one.y - 1.0).abs() > 1e-4 && (one.y / other.y - 1.0).abs() < 1e-5, "{one:?} {other:?}");
        }
    }

    #[test]
    fn sums_are_equal_on_every_machine() {
        let planes = [plane(1), plane(2), plane(3), plane(4)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        let (at, fit) = (Pixel { x: 30, y: 24 }, GreyLevelFit { means: (3.0, -2.0), gain: 0.9 });
        for (shape, size) in [(WindowShape::Square, 31), (WindowShape::Circle, 29)] {
            let window = SubsetMask::new(shape, size);
            let side = side_of(&window);
            let memory: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; dense_len(side)]);
            let (mut one, mut other) = ((memory.clone(), [0.0; 5]), (memory, [0.0; 5]));
            unpack_layers(layers, &window, at, fit, &mut one.0, &mut one.1);
            unpack_layers_with::<Portable>(layers, &window, at, fit, &mut other.0, &mut other.1);
            assert_eq!(one, other);
            let mut lags = [[0.0; LAGS]; 2];
            add_lags(&one.0[2], side, &mut lags[0]);
            add_lags_with::<Portable>(&one.0[2], side, &mut lags[1]);
            assert_eq!(lags[0].map(f64::to_bits), lags[1].map(f64::to_bits));
        }
    }

    #[test]
    fn noise_is_weighted_by_the_slopes() {
        // Slopes along x where the residual is 1 DN, along y where it is 3 DN, none where it is 5 DN.
        let rows = |a: f32, b: f32, c: f32| vec![Lanes::splat(a), Lanes::splat(b), Lanes::splat(c)];
        let subset = ReferenceSubset {
            gradient_x: rows(7.0, 0.0, 0.0),
            gradient_y: rows(0.0, 4.0, 0.0),
            ..ReferenceSubset::default()
        };
        let mean = (1.0 + 9.0 + 25.0) / 3.0;
        let mut window = SubsetMask::new(WindowShape::Square, 3);
        window.pixels = 3 * LANES;
        let slopes =
            |subset: &ReferenceSubset, residual: &[Lanes]| GradientNoise::from_window(subset, &window, residual);
        let factor = VarianceFactor { x: 2.0, y: 1.0 }.weighted_by_slopes(&slopes(&subset, &rows(1.0, -3.0, 5.0)));
        assert!((factor.x - 2.0 * 0.25_f64.max(1.0 / mean)).abs() < 1e-6 && (factor.y - 9.0 / mean).abs() < 1e-6);
        let flat = ReferenceSubset {
            gradient_x: rows(0.0, 0.0, 0.0),
            gradient_y: rows(0.0, 0.0, 0.0),
            ..ReferenceSubset::default()
        };
        let factor = VarianceFactor { x: 0.7, y: 1.3 };
        assert_eq!(factor.weighted_by_slopes(&slopes(&flat, &rows(1.0, 1.0, 1.0))), factor);
    }
}
