//! The level of the paint on one side of an edge, with or without speckles.

use super::level_grid::{LANES, Lane, sum_lanes};
use super::side_levels::{SideBlock, SideLevels};
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
pub(super) const MIN_LEVELS: usize = 12;
/// The number of passes, and how many of them search the densest levels.
const PASSES: usize = 14;
const SEARCH_PASSES: usize = 8;
/// The number of sums over all levels of a side.
const TOTALS: usize = 15;

/// The grey level of one side: a parabola along the edge, a line across.
#[derive(Clone, Copy, Default)]
pub(super) struct Paint {
    /// The coefficients of 1, along, along squared and behind; behind is zero at the edge.
    pub(super) coefficients: [f64; 4],
    /// The standard deviation of a level, DN.
    pub(super) noise: f64,
    /// The standard deviation of the paint at the edge, DN.
    pub(super) sigma: f64,
    /// Whether there are speckles on this side.
    pub(super) is_speckled: bool,
}

/// The start of a fit of the paint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PaintStart {
    /// The first level, DN.
    pub(super) level_dn: f64,
    /// The maximum distance from the paint of the levels that give its noise, DN.
    pub(super) tolerance_dn: f64,
    /// 1 if the outer side of the paint is the lighter one, else -1.
    pub(super) outward: f64,
}

/// The paint around which levels are summed, and the range of those that count.
#[derive(Clone, Copy)]
struct Range {
    /// The coefficients of 1, x, x squared and the row.
    coefficients: [f64; 4],
    /// The maximum distance from the paint of levels that it is fitted to, DN.
    within: f32,
    /// The maximum distance on the outer side of levels that give its noise, DN.
    tolerance: f32,
    /// 1 if the outer side is the lighter one, else -1.
    outward: f32,
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

/// The sums over the levels of each profile that count in a pass.
#[derive(Clone, Copy, Default)]
struct LaneSums {
    count: [u32; LANES],
    level: Lane,
    /// The sums of the row, its square, and the level times the row; zero without a slope across.
    row: [u32; LANES],
    row_row: [u32; LANES],
    level_row: Lane,
    /// The sum of squares and the number of the levels on the outer side of the paint.
    squares: Lane,
    outer: [u32; LANES],
}

impl Paint {
    /// Returns the level at the edge, `along` px from its middle, DN.
    pub(super) fn level_at_edge(&self, along: f64) -> f64 {
        let [c, b, a, _] = self.coefficients;
        c + along * (b + along * a)
    }

    /// Returns the same paint for an edge that lies `by_px` farther behind, and is steeper by `by_slope`.
    pub(super) fn moved(&self, by_px: f64, by_slope: f64) -> Self {
        let [c, b, a, across] = self.coefficients;
        Self { coefficients: [c + across * by_px, b + across * by_slope, a, across], ..*self }
    }
}

/// Fits the paint to the densest levels by a mean shift.
///
/// Levels next to a speckle lie between its level and that of the paint. The noise is therefore estimated on the outer
/// side of the paint.
///
/// # Errors
///
/// [`PointStatus::LowCorrelation`] if too few levels agree.
pub(super) fn fit_paint(levels: &SideLevels, start: PaintStart) -> Result<Paint, PointStatus> {
    let PaintStart { level_dn, tolerance_dn: tolerance, outward } = start;
    let mut paint = Paint { noise: tolerance / PAINT_SIGMAS, ..Paint::default() };
    let scale = levels.scale_px();
    let mut solved = [level_dn, 0.0, 0.0, 0.0];
    for round in 0..PASSES {
        let is_search = round < SEARCH_PASSES;
        let within = if is_search || paint.is_speckled { DENSE_SIGMAS } else { CLEAN_SIGMAS };
        let [c0, c1, c2, c3] = solved;
        let range = Range {
            coefficients: [c0, c1, c2, c3 / scale],
            within: (within * paint.noise) as f32,
            tolerance: tolerance as f32,
            outward: outward as f32,
        };
        let free = |is_speckled: bool| if is_speckled { 1 } else { (round / 2 + 1).min(4) };
        let sums = sum_levels(levels, range, free(paint.is_speckled));
        let kept = sums.moments[0];
        if kept < MIN_LEVELS as f64 {
            return Err(PointStatus::LowCorrelation);
        }
        // Little bare paint gives one level, but not its variation.
        paint.is_speckled |= round > 0 && is_search && kept < BARE_FRACTION * levels.count() as f64;
        let before = (solved, paint.noise);
        solved = sums.solve(free(paint.is_speckled)).ok_or(PointStatus::LowCorrelation)?;
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
        if free == 1 {
            return (n > 0.0).then(|| [self.right[0] / n, 0.0, 0.0, 0.0]);
        }
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

/// Sums over the levels in a range, for the first `free` of the coefficients.
fn sum_levels(levels: &SideLevels, range: Range, free: usize) -> Sums {
    if free == 1 && range.coefficients[1..].iter().all(|part| part.abs() <= 0.0) {
        return sum_level(levels, range);
    }
    let mut totals = [[0.0; LANES]; TOTALS];
    for (block, rows) in levels.blocks() {
        let mut sums = LaneSums::default();
        match free < 4 && range.coefficients[3].abs() <= 0.0 {
            true => sum_flat(rows, block, range, &mut sums),
            false => sum_rows(rows, block, range, &mut sums),
        }
        add_block(&mut totals, &sums, block, levels.scale_px());
    }
    let [n, x, x2, x3, x4, y, xy, x2y, y2, l, lx, lx2, ly, squares, outer] =
        std::array::from_fn(|k| sum_lanes(&totals[k]));
    Sums { moments: [n, x, x2, x3, x4, y, xy, x2y, y2], right: [l, lx, lx2, ly], squares, outer }
}

/// Sums over the levels in a range around one level, regardless of their places.
fn sum_level(levels: &SideLevels, range: Range) -> Sums {
    let mut sums = LaneSums::default();
    for (block, rows) in levels.blocks() {
        sum_flat(rows, block, range, &mut sums);
    }
    let LaneSums { count, level, squares, outer, .. } = sums;
    let [count, outer] = [count, outer].map(|lanes| f64::from(sum_lanes(&lanes)));
    let [level, squares] = [level, squares].map(|lanes| f64::from(sum_lanes(&lanes)));
    let (mut moments, mut right) = ([0.0; 9], [0.0; 4]);
    (moments[0], right[0]) = (count, level);
    Sums { moments, right, squares, outer }
}

/// Sums over the rows of a block around one level per profile.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn sum_flat(rows: &[Lane], block: &SideBlock, range: Range, sums: &mut LaneSums) {
    let base = level_at_first_row(block, &range);
    for levels in rows {
        for i in 0..LANES {
            let residual = levels[i] - base[i];
            let size = residual.abs();
            // Branches would prevent vectorization.
            let is_outer = (residual * range.outward > 0.0) & (size <= range.tolerance);
            let is_kept = size <= range.within;
            let outer = masked(residual, is_outer);
            sums.squares[i] += outer * outer;
            sums.outer[i] += u32::from(is_outer);
            sums.count[i] += u32::from(is_kept);
            sums.level[i] += masked(levels[i], is_kept);
        }
    }
}

/// Sums over the rows of a block around levels that change by `across` from row to row.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn sum_rows(rows: &[Lane], block: &SideBlock, range: Range, sums: &mut LaneSums) {
    let base = level_at_first_row(block, &range);
    let across = range.coefficients[3] as f32;
    for (row, levels) in (0_u32..).zip(rows) {
        let row_dn = across * row as f32;
        for i in 0..LANES {
            let residual = levels[i] - (base[i] + row_dn);
            let size = residual.abs();
            let is_outer = (residual * range.outward > 0.0) & (size <= range.tolerance);
            let is_kept = size <= range.within;
            let (outer, level) = (masked(residual, is_outer), masked(levels[i], is_kept));
            let one = u32::from(is_kept);
            sums.squares[i] += outer * outer;
            sums.outer[i] += u32::from(is_outer);
            sums.count[i] += one;
            sums.row[i] += one * row;
            sums.row_row[i] += one * row * row;
            sums.level[i] += level;
            sums.level_row[i] += level * row as f32;
        }
    }
}

/// Returns the paint of each profile at the first row of a block, DN.
#[inline(always)]
fn level_at_first_row(block: &SideBlock, range: &Range) -> Lane {
    let [c0, c1, c2, by_row] = range.coefficients;
    let mut base = [0.0; LANES];
    for (base, (x, edge)) in base.iter_mut().zip(block.x.iter().zip(&block.edge)) {
        *base = (c0 + x * (c1 + x * c2) - by_row * edge) as f32;
    }
    base
}

/// Returns the value if it counts, else zero.
#[inline(always)]
fn masked(value: f32, counts: bool) -> f32 {
    f32::from_bits(value.to_bits() & 0_u32.wrapping_sub(u32::from(counts)))
}

/// Adds the sums of the profiles of a block, in the order of the fields of [`Sums`].
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn add_block(totals: &mut [[f64; LANES]; TOTALS], sums: &LaneSums, block: &SideBlock, scale: f64) {
    let LaneSums { count, level, row, row_row, level_row, squares, outer } = sums;
    let SideBlock { x, edge } = block;
    for i in 0..LANES {
        let (x, edge) = (x[i], edge[i]);
        let (n, l) = (f64::from(count[i]), f64::from(level[i]));
        let (row, row_row) = (f64::from(row[i]), f64::from(row_row[i]));
        // y is the distance of the row from the edge.
        let y = (row - edge * n) / scale;
        let y2 = (row_row - 2.0 * edge * row + edge * edge * n) / (scale * scale);
        let ly = (f64::from(level_row[i]) - edge * l) / scale;
        let x2 = x * x;
        totals[0][i] += n;
        totals[1][i] += n * x;
        totals[2][i] += n * x2;
        totals[3][i] += n * x2 * x;
        totals[4][i] += n * x2 * x2;
        totals[5][i] += y;
        totals[6][i] += x * y;
        totals[7][i] += x2 * y;
        totals[8][i] += y2;
        totals[9][i] += l;
        totals[10][i] += l * x;
        totals[11][i] += l * x2;
        totals[12][i] += ly;
        totals[13][i] += f64::from(squares[i]);
        totals[14][i] += f64::from(outer[i]);
    }
}
