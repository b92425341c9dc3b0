//! The level of the paint on one side of an edge, with or without speckles.

use crate::results::PointStatus;
use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};

/// The tolerance of paint levels, in standard deviations of their noise.
pub(super) const PAINT_SIGMAS: f64 = 3.0;
/// The range of levels around speckled and around clean paint, in standard deviations of its noise.
const DENSE_SIGMAS: f64 = 1.5;
const CLEAN_SIGMAS: f64 = 3.0;
/// The fraction of levels in that range below which a side counts as speckled.
const BARE_FRACTION: f64 = 0.6;
/// The minimum noise of paint, as a fraction of the tolerance.
const MIN_NOISE: f64 = 0.02;
/// The minimum number of levels for the paint of a side.
pub const MIN_LEVELS: usize = 12;
/// The number of passes, and how many of them search the densest levels.
const PASSES: usize = 14;
const SEARCH_PASSES: usize = 8;

/// The grey level of one side: a parabola along the edge, a line across.
#[derive(Clone, Copy, Default)]
pub struct Paint {
    /// The coefficients of 1, along, along squared and behind; behind is zero at the edge.
    pub coefficients: [f64; 4],
    /// The standard deviation of a level, DN.
    pub noise: f64,
    /// The standard deviation of the paint at the edge, DN.
    pub sigma: f64,
    /// Whether there are speckles on this side.
    pub is_speckled: bool,
}

/// The grey levels clear of the edge on one side of it.
#[derive(Default)]
pub struct Levels {
    /// The distances along the edge from its middle, px.
    pub along: Vec<f64>,
    /// The distances behind the edge, px; negative before it.
    pub behind: Vec<f64>,
    /// The grey levels, DN.
    pub levels: Vec<f64>,
}

impl Levels {
    /// Returns the number of levels.
    pub fn len(&self) -> usize {
        self.levels.len()
    }
}

/// The number of levels that are summed at a time by vector instructions.
const LANES: usize = 8;

/// One value of each of these levels.
type Lane = [f64; LANES];

/// The levels that count in a pass.
#[derive(Clone, Copy)]
struct Range {
    /// The paint, in units of the scale along and behind.
    coefficients: [f64; 4],
    /// The maximum distance from the paint of levels that it is fitted to, DN.
    within: f64,
    /// The maximum distance on the outer side of levels that give its noise, DN.
    tolerance: f64,
    /// 1 if the outer side is the lighter one, else -1.
    outward: f64,
}

/// The sums of one pass over the levels; x is along and y behind the edge, in units of the scale.
#[derive(Default)]
struct Sums {
    /// The sums of 1, x, x^2, x^3, x^4, y, x y, x^2 y and y^2.
    moments: [f64; 9],
    /// The sums of the level times 1, x, x^2 and y.
    right: [f64; 4],
    /// The sum of squares and the number of the levels on the outer side of the paint.
    squares: f64,
    outer: f64,
}

impl Paint {
    /// Returns the level at the edge, `along` px from its middle, DN.
    pub fn level_at_edge(&self, along: f64) -> f64 {
        let [c, b, a, _] = self.coefficients;
        c + along * (b + along * a)
    }
}

/// Fits the paint to the densest levels by a mean shift, from the level `start`, DN.
///
/// Levels next to a speckle lie between its level and that of the paint. The noise is therefore estimated on the other
/// side of the paint (`outward` is 1 for lighter), up to `tolerance`.
///
/// # Errors
///
/// [`PointStatus::LowCorrelation`] if too few levels agree.
pub fn fit_paint(levels: &Levels, start: f64, tolerance: f64, outward: f64) -> Result<Paint, PointStatus> {
    let mut paint = Paint { coefficients: [start, 0.0, 0.0, 0.0], noise: tolerance / PAINT_SIGMAS, ..Paint::default() };
    let scale = levels.along.iter().map(|along| along.abs()).fold(1.0, f64::max);
    let scaled = |values: &[f64]| values.iter().map(|value| value / scale).collect::<Vec<_>>();
    let (x, y) = (scaled(&levels.along), scaled(&levels.behind));
    let mut solved = [start, 0.0, 0.0, 0.0];
    for round in 0..PASSES {
        let is_search = round < SEARCH_PASSES;
        let within = if is_search || paint.is_speckled { DENSE_SIGMAS } else { CLEAN_SIGMAS };
        let range = Range { coefficients: solved, within: within * paint.noise, tolerance, outward };
        let sums = sum_levels([&x, &y, &levels.levels], range);
        let kept = sums.moments[0];
        if kept < MIN_LEVELS as f64 {
            return Err(PointStatus::LowCorrelation);
        }
        // Little bare paint gives one level, but not its variation.
        paint.is_speckled |= round > 0 && is_search && kept < BARE_FRACTION * levels.len() as f64;
        let free = if paint.is_speckled { 1 } else { (round / 2 + 1).min(4) };
        let before = (solved, paint.noise);
        solved = sums.solve(free).ok_or(PointStatus::LowCorrelation)?;
        paint.noise = (sums.squares / sums.outer.max(1.0)).sqrt();
        paint.noise = paint.noise.clamp(MIN_NOISE * tolerance, tolerance / PAINT_SIGMAS);
        // The level at the edge is extrapolated from those clear of it.
        paint.sigma = 2.0 * paint.noise / kept.sqrt();
        // Order and range of the passes to come are those of this one.
        if (paint.is_speckled || !is_search) && before == (solved, paint.noise) {
            break;
        }
    }
    paint.coefficients = [solved[0], solved[1] / scale, solved[2] / (scale * scale), solved[3] / scale];
    Ok(paint)
}

impl Sums {
    /// Solves the normal equations for the first `free` of the coefficients of 1, x, x^2 and y; the others are zero. `None`
    /// if they are singular.
    fn solve(&self, free: usize) -> Option<[f64; 4]> {
        let [n, x, x2, x3, x4, y, xy, x2y, y2] = self.moments;
        let mut normal =
            SMatrix::<f64, 4, 4>::from([[n, x, x2, y], [x, x2, x3, xy], [x2, x3, x4, x2y], [y, xy, x2y, y2]]);
        let mut right = SVector::from(self.right);
        for fixed in free..4 {
            normal.fill_row(fixed, 0.0);
            normal.fill_column(fixed, 0.0);
            normal[(fixed, fixed)] = 1.0;
            right[fixed] = 0.0;
        }
        Some((normal.try_inverse()? * right).into())
    }
}

/// Sums over the levels in the range: `samples` are x, y and the levels.
fn sum_levels(samples: [&[f64]; 3], range: Range) -> Sums {
    let [x, y, levels] = samples.map(|values| values.as_chunks::<LANES>());
    let mut sums = sum_lanes(x.0, y.0, levels.0, range);
    // The rest, filled up with levels out of any range.
    let (mut rest_x, mut rest_y, mut rest) = ([0.0; LANES], [0.0; LANES], [f64::MAX; LANES]);
    rest_x[..x.1.len()].copy_from_slice(x.1);
    rest_y[..y.1.len()].copy_from_slice(y.1);
    rest[..levels.1.len()].copy_from_slice(levels.1);
    let last = sum_lanes(&[rest_x], &[rest_y], &[rest], range);
    sums.moments.iter_mut().zip(last.moments).for_each(|(sum, more)| *sum += more);
    sums.right.iter_mut().zip(last.right).for_each(|(sum, more)| *sum += more);
    Sums { squares: sums.squares + last.squares, outer: sums.outer + last.outer, ..sums }
}

/// Sums over whole groups of levels in the range.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn sum_lanes(x: &[Lane], y: &[Lane], levels: &[Lane], range: Range) -> Sums {
    let [c0, c1, c2, c3] = range.coefficients;
    let (mut moments, mut right) = ([[0.0; LANES]; 9], [[0.0; LANES]; 4]);
    let (mut squares, mut outer) = ([0.0; LANES], [0.0; LANES]);
    for ((x, y), levels) in x.iter().zip(y).zip(levels) {
        let (mut one, mut level) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let residual = levels[i] - (c0 + x[i] * (c1 + x[i] * c2) + c3 * y[i]);
            let size = residual.abs();
            // Branches would prevent vectorization.
            let is_outer = (residual * range.outward > 0.0) & (size <= range.tolerance);
            squares[i] += if is_outer { residual * residual } else { 0.0 };
            outer[i] += if is_outer { 1.0 } else { 0.0 };
            one[i] = if size <= range.within { 1.0 } else { 0.0 };
            level[i] = if size <= range.within { levels[i] } else { 0.0 };
        }
        let (x1, y1) = (product(&one, x), product(&one, y));
        let (x2, level_x) = (product(&x1, x), product(&level, x));
        let terms =
            [one, x1, x2, product(&x2, x), product(&x2, &x2), y1, product(&x1, y), product(&x2, y), product(&y1, y)];
        for (sum, term) in moments.iter_mut().zip(&terms) {
            add(sum, term);
        }
        for (sum, term) in right.iter_mut().zip(&[level, level_x, product(&level_x, x), product(&level, y)]) {
            add(sum, term);
        }
    }
    let total = |lanes: Lane| lanes.iter().sum::<f64>();
    Sums { moments: moments.map(total), right: right.map(total), squares: total(squares), outer: total(outer) }
}

/// Returns the products of eight pairs.
#[inline(always)]
fn product(a: &Lane, b: &Lane) -> Lane {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = a[i] * b[i];
    }
    out
}

/// Adds eight terms to eight sums.
#[inline(always)]
fn add(sum: &mut Lane, term: &Lane) {
    for i in 0..LANES {
        sum[i] += term[i];
    }
}
