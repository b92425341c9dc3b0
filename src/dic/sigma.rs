//! Standard uncertainty of a displacement, from the pair of images itself.
//!
//! The residual of a match holds the noise of both frames, so its variance times
//! the inverse Hessian is the variance of the answer if the residual is white.
//! It is not when speckles are sampled coarsely: what interpolation leaves then
//! alternates in sign and hardly moves the answer. The factor
//! `q = sum over short lags of rho_residual rho_gradient` weighs that, pooled
//! over windows of the pair. Nor is it alike everywhere: photons make bright paint
//! noisier than dark speckles, and only the noise where grey levels slope moves the answer.

use super::lanes::{LANES, Lanes};
use super::moments::Layers;
use super::plane::Plane;
use super::share::Sharpness;
use super::subset::Subset;
use super::vector::{Vector, vectorized};
use super::window::{Block, Window};

/// Largest lag, px.
const REACH: usize = 2;

/// Lags of one half plane: (0, 0..=2) and (1..=2, -2..=2).
const LAGS: usize = (REACH + 1) * (2 * REACH + 1);

/// Variance that rounding to whole grey levels leaves in the difference of two frames, DN^2.
pub(super) const ROUNDING: f64 = 2.0 / 12.0;

/// Windows pooled at most.
///
/// Half of the rows of one of 31 x 31 pixels know the factor to some 7 %, those of all to half of that.
pub(super) const POOLED: usize = 4;

/// Rows of a window that tell how its pixels correlate.
const ENOUGH_ROWS: usize = 16;

/// A sum for every lag.
pub(super) type Lags = [f64; LAGS];

/// Sums over the windows of one pair.
#[derive(Debug, Clone, Default)]
pub(super) struct Pool {
    residual: Lags,
    pairs: Lags,
    gradient_x: Lags,
    gradient_y: Lags,
    slopes: Slopes,
    sharpness: Sharpness,
    dense: Vec<f32>,
    /// Gradients along x and y and residual of a window that planes hold.
    layers: [Vec<f32>; 3],
}

/// How noisy the pixels are that have the slopes, and all of them.
///
/// Sums of squares of the residual, of those of the slopes along x and y, and of these times the former.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slopes {
    sums: [f64; 5],
    pixels: f64,
}

/// Mean levels of the reference and of the target in a window, and the target's gain.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    pub(super) means: (f32, f32),
    pub(super) gain: f32,
}

/// What is correlated with itself.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    Residual,
    GradientX,
    GradientY,
}

/// By how much short-range correlation changes the variance along x and y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Factor {
    /// Factor for the variance of u.
    pub(super) x: f64,
    /// Factor for the variance of v.
    pub(super) y: f64,
}

impl Pool {
    /// Forgets all windows.
    pub(super) fn clear(&mut self) {
        for sums in [&mut self.residual, &mut self.pairs, &mut self.gradient_x, &mut self.gradient_y] {
            sums.fill(0.0);
        }
        (self.slopes, self.sharpness) = (Slopes::default(), Sharpness::default());
    }

    /// Adds one window with its residual (packed like the subset).
    pub(super) fn add(&mut self, subset: &Subset, window: &Window, residual: &[Lanes]) {
        self.add_texture(subset, window);
        self.add_part(Part::Residual, window, residual);
        self.slopes.add(Slopes::of(subset, window, residual));
    }

    /// The same of a window in planes about `at`, as it fits; `pairs` are those of [`pairs_of`]. All windows that a pool
    /// is given so are alike.
    pub(super) fn add_layers(
        &mut self,
        layers: Layers<'_>,
        window: &Window,
        pairs: &Lags,
        (at, fit): ((i32, i32), Fit),
    ) {
        self.pairs.iter_mut().zip(pairs).for_each(|(sum, pairs)| *sum += pairs);
        let side = side_of(window);
        self.layers.iter_mut().for_each(|dense| dense.resize(dense_len(side), 0.0));
        spread_layers(layers, window, (at, fit), &mut self.layers, &mut self.slopes.sums);
        self.slopes.pixels += window.pixels as f64;
        let [gradient_x, gradient_y, residual] = &self.layers;
        add_lags(gradient_x, side, &mut self.gradient_x);
        add_lags(gradient_y, side, &mut self.gradient_y);
        add_lags(residual, side, &mut self.residual);
    }

    /// Adds how far the gradients of the pixels of one window are to be trusted.
    pub(super) fn add_sharpness(&mut self, sharpness: Sharpness) {
        self.sharpness.add(sharpness);
    }

    /// The share of the inverse Hessian's standard uncertainties that is right.
    pub(super) fn share(&self) -> f64 {
        self.sharpness.share()
    }

    /// Adds one part of a window, packed like the window's mask.
    fn add_part(&mut self, part: Part, window: &Window, rows: &[Lanes]) {
        unpack(window, rows, &mut self.dense);
        let sums = match part {
            Part::Residual => &mut self.residual,
            Part::GradientX => &mut self.gradient_x,
            Part::GradientY => &mut self.gradient_y,
        };
        add_lags(&self.dense, side_of(window), sums);
    }

    /// Another residual of the one window whose texture was added; none when it is empty.
    pub(super) fn set_residual(&mut self, window: &Window, residual: &[Lanes]) {
        self.residual.fill(0.0);
        if residual.is_empty() {
            return;
        }
        // What the window does not hold is zero already, from its texture.
        spread(window, residual, &mut self.dense);
        add_lags(&self.dense, side_of(window), &mut self.residual);
    }

    /// Adds what does not depend on the target.
    pub(super) fn add_texture(&mut self, subset: &Subset, window: &Window) {
        self.pairs.iter_mut().zip(pairs_of(window)).for_each(|(sum, pairs)| *sum += pairs);
        self.add_part(Part::GradientX, window, &subset.gradient_x);
        self.add_part(Part::GradientY, window, &subset.gradient_y);
    }

    /// The factors of the windows added; one where there were none.
    pub(super) fn factor(&self) -> Factor {
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
        Factor { x: correlated(&self.gradient_x), y: correlated(&self.gradient_y) }.where_it_slopes(&self.slopes)
    }
}

/// Index of a lag (dx along the row, dy rows down).
fn lag_index(dx: isize, dy: usize) -> usize {
    dy * (2 * REACH + 1) + (dx + REACH as isize) as usize
}

/// The pairs of pixels at each lag of a window.
pub(super) fn pairs_of(window: &Window) -> Lags {
    let (mut dense, mut pairs) = (Vec::new(), [0.0; LAGS]);
    unpack(window, &window.mask, &mut dense);
    add_lags(&dense, side_of(window), &mut pairs);
    pairs
}

/// Side of the square around a window, px.
fn side_of(window: &Window) -> usize {
    2 * window.half as usize + 1
}

/// From one row of a square to the next: each is followed by zeros, as far as lags reach.
fn stride_of(side: usize) -> usize {
    (side + REACH).next_multiple_of(LANES)
}

/// Values of a square of rows with their zeros, and as many rows of zeros as lags reach.
fn dense_len(side: usize) -> usize {
    (side + REACH) * stride_of(side) + 2 * LANES
}

/// Spreads values packed like a window's mask over its square.
fn unpack(window: &Window, packed: &[Lanes], dense: &mut Vec<f32>) {
    dense.clear();
    spread(window, packed, dense);
}

/// As [`unpack`], into memory that is empty or of the same window.
fn spread(window: &Window, packed: &[Lanes], dense: &mut Vec<f32>) {
    let side = side_of(window);
    dense.resize(dense_len(side), 0.0);
    for block in &window.blocks {
        let rows = &packed[block.start..block.start + block.rows];
        for (lanes, first) in rows.iter().zip((first_of(window, block)..).step_by(stride_of(side))) {
            dense[first..first + LANES].copy_from_slice(&lanes.0);
        }
    }
}

/// Where the first row of a block begins in the square. A last block may reach over the square into the zeros, where its
/// mask has zeros too.
fn first_of(window: &Window, block: &Block) -> usize {
    let (left, top) = ((window.half as i32 + block.dx) as usize, (window.half as i32 + block.dy) as usize);
    top * stride_of(side_of(window)) + left
}

vectorized! {
    /// Spreads the gradients and the residual of a window in planes over squares; adds what [`add_squares`] adds.
    fn spread_layers(
        layers: Layers<'_>,
        window: &Window,
        fit: ((i32, i32), Fit),
        dense: &mut [Vec<f32>; 3],
        sums: &mut [f64; 5],
    ) = spread_layers_with
}

#[inline(always)]
fn spread_layers_with<V: Vector>(
    layers: Layers<'_>,
    window: &Window,
    ((x, y), fit): ((i32, i32), Fit),
    dense: &mut [Vec<f32>; 3],
    sums: &mut [f64; 5],
) {
    let (stride, dense_stride) = (layers.reference.stride(), stride_of(side_of(window)));
    let (means, gain) = ((V::splat(fit.means.0), V::splat(fit.means.1)), V::splat(fit.gain));
    let mut totals = [V::splat(0.0); 5];
    for block in &window.blocks {
        let mut from = layers.reference.index((x + block.dx) as isize, (y + block.dy) as isize);
        let mut to = first_of(window, block);
        for mask in &window.mask[block.start..block.start + block.rows] {
            let load = |plane: &Plane| V::load(&plane.data()[from..]);
            let mask = V::from_lanes(mask);
            let (gx, gy) = (load(layers.gradient_x).mul(mask), load(layers.gradient_y).mul(mask));
            let (level, value) = (load(layers.reference).sub(means.0), load(layers.target).sub(means.1));
            let left = level.sub(gain.mul(value)).mul(mask);
            add_row([gx, gy, left], &mut totals);
            for (dense, value) in dense.iter_mut().zip([gx, gy, left]) {
                value.store(&mut dense[to..]);
            }
            (from, to) = (from + stride, to + dense_stride);
        }
    }
    for (sum, total) in sums.iter_mut().zip(totals) {
        *sum += total.to_lanes().sum();
    }
}

/// From one row to the next of those whose pixels are paired with those beside and below: half of the rows of a window of
/// 31 px say enough, and fewer of a larger one.
fn row_step(rows: usize) -> usize {
    rows.div_ceil(ENOUGH_ROWS)
}

vectorized! {
    /// Adds the products of pairs of pixels at each lag, of values that [`spread`] laid out.
    ///
    /// Every row is followed by zeros, so a lag is one shift of the whole square.
    fn add_lags(dense: &[f32], side: usize, sums: &mut Lags) = add_lags_with
}

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
    /// Adds the squares of a residual, those of the slopes along x and y, and these times the former.
    fn add_squares(gradients: [&[Lanes]; 2], residual: &[Lanes], sums: &mut [f64; 5]) = add_squares_with
}

#[inline(always)]
fn add_squares_with<V: Vector>(gradients: [&[Lanes]; 2], residual: &[Lanes], sums: &mut [f64; 5]) {
    let [along_x, along_y] = gradients;
    let mut totals = [V::splat(0.0); 5];
    for ((x, y), left) in along_x.iter().zip(along_y).zip(residual) {
        add_row([V::from_lanes(x), V::from_lanes(y), V::from_lanes(left)], &mut totals);
    }
    for (sum, total) in sums.iter_mut().zip(totals) {
        *sum += total.to_lanes().sum();
    }
}

/// The squares of eight pixels' slopes along x and y and of what is left of them.
#[inline(always)]
fn add_row<V: Vector>([x, y, left]: [V; 3], totals: &mut [V; 5]) {
    let (x_squared, y_squared, squared) = (x.mul(x), y.mul(y), left.mul(left));
    totals[0] = totals[0].add(squared);
    totals[1] = totals[1].add(x_squared);
    totals[2] = totals[2].add(y_squared);
    totals[3] = totals[3].plus_product(x_squared, squared);
    totals[4] = totals[4].plus_product(y_squared, squared);
}

impl Slopes {
    /// Of one window with its residual.
    pub(super) fn of(subset: &Subset, window: &Window, residual: &[Lanes]) -> Self {
        let mut slopes = Self { sums: [0.0; 5], pixels: window.pixels as f64 };
        add_squares([&subset.gradient_x, &subset.gradient_y], residual, &mut slopes.sums);
        slopes
    }

    /// Adds those of other pixels.
    fn add(&mut self, other: Self) {
        self.sums.iter_mut().zip(other.sums).for_each(|(sum, other)| *sum += other);
        self.pixels += other.pixels;
    }

    /// By how much noisier than all the pixels those are that slope along x and along y.
    fn noisier(&self) -> (f64, f64) {
        let [squares, x_squared, y_squared, x_noisy, y_noisy] = self.sums;
        let noisier = |noisy: f64, squared: f64| {
            let ratio = noisy * self.pixels / (squared * squares);
            if ratio.is_finite() { ratio.clamp(0.25, 4.0) } else { 1.0 }
        };
        (noisier(x_noisy, x_squared), noisier(y_noisy, y_squared))
    }
}

impl Factor {
    /// The same where light is not everywhere as noisy. Photons make bright paint noisier than dark speckles, and the slopes
    /// lie between them.
    pub(super) fn where_it_slopes(self, slopes: &Slopes) -> Self {
        let (x, y) = slopes.noisier();
        Self { x: self.x * x, y: self.y * y }
    }

    /// Variance of u and v from the variance of the residual and the diagonal of the inverse Hessian.
    ///
    /// Not less than rounding leaves. Where the factor is so small that the pair
    /// must be called aliased, no single formula is right and the uncertainty is
    /// raised by up to 1.5.
    pub(super) fn variances(&self, residual: f64, inverse: (f64, f64)) -> (f64, f64) {
        let along = |factor: f64, inverse: f64| {
            let naive = 1.0 / factor.sqrt();
            let doubt = 1.0 + ((naive - 1.5) / 0.5).clamp(0.0, 1.0) * 0.5;
            (residual * factor * doubt * doubt).max(ROUNDING) * inverse
        };
        (along(self.x, inverse.0), along(self.y, inverse.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::WindowShape;
    use crate::dic::moments::tests::plane;
    use crate::dic::vector::Portable;

    /// Slopes and residual of a window in `planes` about (30, 24), packed like its mask.
    fn packed<'a>(
        [reference, gradient_x, gradient_y, target]: &[Plane; 4],
        window: &'a Window,
        fit: Fit,
    ) -> [Vec<Lanes>; 3] {
        let of = |value: &dyn Fn(usize) -> f32| -> Vec<Lanes> {
            let row = |(block, row): (&Block, usize)| {
                let first = reference.index((30 + block.dx) as isize, (24 + block.dy) as isize + row as isize);
                Lanes(std::array::from_fn(|lane| value(first + lane))) * window.mask[block.start + row]
            };
            let rows = |block: &'a Block| (0..block.rows).map(move |row| (block, row));
            window.blocks.iter().flat_map(rows).map(row).collect()
        };
        let left = |at| (reference.data()[at] - fit.means.0) - fit.gain * (target.data()[at] - fit.means.1);
        [of(&|at| gradient_x.data()[at]), of(&|at| gradient_y.data()[at]), of(&left)]
    }

    #[test]
    fn a_window_in_planes_adds_what_the_same_packed_does() {
        let planes = [plane(1), plane(2), plane(3), plane(4)];
        let [reference, gradient_x, gradient_y, target] = &planes;
        let layers = Layers { reference, gradient_x, gradient_y, target };
        let fit = Fit { means: (3.0, -2.0), gain: 0.9 };
        for (shape, size) in [(WindowShape::Square, 31), (WindowShape::Circle, 29), (WindowShape::Square, 13)] {
            let window = Window::new(shape, size);
            let [gradient_x, gradient_y, residual] = packed(&planes, &window, fit);
            let subset = Subset { gradient_x, gradient_y, ..Subset::default() };
            let (mut one, mut other) = (Pool::default(), Pool::default());
            for _ in 0..2 {
                one.add(&subset, &window, &residual);
                other.add_layers(layers, &window, &pairs_of(&window), ((30, 24), fit));
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
        let at = ((30, 24), Fit { means: (3.0, -2.0), gain: 0.9 });
        for (shape, size) in [(WindowShape::Square, 31), (WindowShape::Circle, 29)] {
            let window = Window::new(shape, size);
            let side = side_of(&window);
            let memory: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; dense_len(side)]);
            let (mut one, mut other) = ((memory.clone(), [0.0; 5]), (memory, [0.0; 5]));
            spread_layers(layers, &window, at, &mut one.0, &mut one.1);
            spread_layers_with::<Portable>(layers, &window, at, &mut other.0, &mut other.1);
            assert_eq!(one, other);
            let mut lags = [[0.0; LAGS]; 2];
            add_lags(&one.0[2], side, &mut lags[0]);
            add_lags_with::<Portable>(&one.0[2], side, &mut lags[1]);
            assert_eq!(lags[0].map(f64::to_bits), lags[1].map(f64::to_bits));
        }
    }

    #[test]
    fn noise_counts_where_the_slopes_are() {
        // Slopes along x where the residual is 1 DN, along y where it is 3 DN, nowhere at all where it is 5 DN.
        let rows = |a: f32, b: f32, c: f32| vec![Lanes::splat(a), Lanes::splat(b), Lanes::splat(c)];
        let subset = Subset { gradient_x: rows(7.0, 0.0, 0.0), gradient_y: rows(0.0, 4.0, 0.0), ..Subset::default() };
        let mean = (1.0 + 9.0 + 25.0) / 3.0;
        let mut window = Window::new(WindowShape::Square, 3);
        window.pixels = 3 * LANES;
        let slopes = |subset: &Subset, residual: &[Lanes]| Slopes::of(subset, &window, residual);
        let factor = Factor { x: 2.0, y: 1.0 }.where_it_slopes(&slopes(&subset, &rows(1.0, -3.0, 5.0)));
        assert!((factor.x - 2.0 * 0.25_f64.max(1.0 / mean)).abs() < 1e-6 && (factor.y - 9.0 / mean).abs() < 1e-6);
        let flat = Subset { gradient_x: rows(0.0, 0.0, 0.0), gradient_y: rows(0.0, 0.0, 0.0), ..Subset::default() };
        let factor = Factor { x: 0.7, y: 1.3 };
        assert_eq!(factor.where_it_slopes(&slopes(&flat, &rows(1.0, 1.0, 1.0))), factor);
    }
}
