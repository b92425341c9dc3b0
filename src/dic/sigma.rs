//! Standard uncertainty of a displacement, from the pair of images itself.
//!
//! The residual of a match holds the noise of both frames, so its variance times
//! the inverse Hessian is the variance of the answer if the residual is white.
//! It is not when speckles are sampled coarsely: what interpolation leaves then
//! alternates in sign and hardly moves the answer. The factor
//! `q = sum over short lags of rho_residual rho_gradient` weighs that, pooled
//! over windows of the pair.

use super::lanes::{LANES, Lanes};
use super::subset::Subset;
use super::vector::{Vector, vectorized};
use super::window::Window;

/// Largest lag, px.
const REACH: usize = 2;

/// Lags of one half plane: (0, 0..=2) and (1..=2, -2..=2).
const LAGS: usize = (REACH + 1) * (2 * REACH + 1);

/// Variance that rounding to whole grey levels leaves in the difference of two frames, DN^2.
pub(super) const ROUNDING: f64 = 2.0 / 12.0;

/// Windows pooled at most.
///
/// One of 31 x 31 pixels alone knows the factor to 5 %.
pub(super) const POOLED: usize = 8;

/// Sums over the windows of one pair.
#[derive(Debug, Clone, Default)]
pub(super) struct Pool {
    residual: [f64; LAGS],
    pairs: [f64; LAGS],
    gradient_x: [f64; LAGS],
    gradient_y: [f64; LAGS],
    dense: Vec<f32>,
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
    }

    /// Adds one window with its residual (packed like the subset).
    pub(super) fn add(&mut self, subset: &Subset, window: &Window, residual: &[Lanes]) {
        self.add_texture(subset, window);
        let side = unpack(window, residual, &mut self.dense);
        add_lags(&self.dense, side, &mut self.residual);
    }

    /// Another residual of the one window whose texture was added; none when it is empty.
    pub(super) fn set_residual(&mut self, window: &Window, residual: &[Lanes]) {
        self.residual.fill(0.0);
        if residual.is_empty() {
            return;
        }
        let side = unpack(window, residual, &mut self.dense);
        add_lags(&self.dense, side, &mut self.residual);
    }

    /// Adds what does not depend on the target.
    pub(super) fn add_texture(&mut self, subset: &Subset, window: &Window) {
        let Self { pairs, gradient_x, gradient_y, dense, .. } = self;
        for (sums, values) in
            [(pairs, &window.mask[..]), (gradient_x, &subset.gradient_x[..]), (gradient_y, &subset.gradient_y[..])]
        {
            let side = unpack(window, values, dense);
            add_lags(dense, side, sums);
        }
    }

    /// The factors of the windows added; one where there were none.
    pub(super) fn factor(&self) -> Factor {
        let correlated = |gradient: &[f64; LAGS]| {
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
        Factor { x: correlated(&self.gradient_x), y: correlated(&self.gradient_y) }
    }
}

/// Index of a lag (dx along the row, dy rows down).
fn lag_index(dx: isize, dy: usize) -> usize {
    dy * (2 * REACH + 1) + (dx + REACH as isize) as usize
}

/// Spreads packed values over the window's square, rows of [`LANES`] more than its width; gives that width.
fn unpack(window: &Window, packed: &[Lanes], dense: &mut Vec<f32>) -> usize {
    let side = 2 * window.half as usize + 1;
    let stride = side + LANES;
    dense.clear();
    dense.resize(side * stride, 0.0);
    for block in &window.blocks {
        for row in 0..block.rows {
            let y = (window.half as i32 + block.dy) as usize + row;
            let first = y * stride + (window.half as i32 + block.dx) as usize;
            dense[first..first + LANES].copy_from_slice(&packed[block.start + row].0);
        }
    }
    stride
}

/// Adds the products of all pairs of pixels at each lag.
///
/// Every row is followed by zeros, so a lag is one shift of the whole square.
fn add_lags(dense: &[f32], stride: usize, sums: &mut [f64; LAGS]) {
    for dy in 0..=REACH {
        for dx in -(REACH as isize)..=REACH as isize {
            if let Some(shift) = (dy * stride).checked_add_signed(dx) {
                sums[lag_index(dx, dy)] += f64::from(dot(dense, &dense[shift..]));
            }
        }
    }
}

vectorized! {
    /// Sum of products, eight running sums side by side.
    fn dot(a: &[f32], b: &[f32]) -> f32 = dot_with
}

#[inline(always)]
fn dot_with<V: Vector>(a: &[f32], b: &[f32]) -> f32 {
    let (a, rest_a) = a[..b.len()].as_chunks();
    let (b, rest_b) = b.as_chunks();
    let mut sums = [V::splat(0.0); 2];
    let (pairs_a, pairs_b) = (a.chunks_exact(2), b.chunks_exact(2));
    let odd = pairs_a.remainder().iter().zip(pairs_b.remainder());
    for (a, b) in pairs_a.zip(pairs_b) {
        sums[0] = sums[0].add(V::from_eight(&a[0]).mul(V::from_eight(&b[0])));
        sums[1] = sums[1].add(V::from_eight(&a[1]).mul(V::from_eight(&b[1])));
    }
    for (a, b) in odd {
        sums[0] = sums[0].add(V::from_eight(a).mul(V::from_eight(b)));
    }
    let rest: f32 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums[0].add(sums[1]).to_lanes().0.iter().sum::<f32>() + rest
}

impl Factor {
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
