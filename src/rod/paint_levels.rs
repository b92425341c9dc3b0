//! The level of the paint on one side of an edge, with or without speckles.

use crate::results::PointStatus;
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

/// A grey level clear of the edge.
pub struct Level {
    /// The distance along the edge from its middle, px.
    pub along: f64,
    /// The distance behind the edge, px; negative before it.
    pub behind: f64,
    /// The grey level, DN.
    pub level: f64,
}

/// The sums of one pass over the levels.
struct Pass {
    normal: SMatrix<f64, 4, 4>,
    right: SVector<f64, 4>,
    kept: usize,
    /// The sum of squares and the number of the levels on the outer side of the paint.
    squares: f64,
    outer: usize,
}

impl Paint {
    /// Returns the level at the edge, `along` px from its middle, DN.
    pub fn level_at_edge(&self, along: f64) -> f64 {
        self.level_at(along, 0.0)
    }

    /// Returns the level `along` px from the middle of the edge and `behind` px behind it, DN.
    fn level_at(&self, along: f64, behind: f64) -> f64 {
        let [c, b, a, d] = self.coefficients;
        c + along * (b + along * a) + d * behind
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
pub fn fit_paint(levels: &[Level], start: f64, tolerance: f64, outward: f64) -> Result<Paint, PointStatus> {
    let mut paint = Paint { coefficients: [start, 0.0, 0.0, 0.0], noise: tolerance / PAINT_SIGMAS, ..Paint::default() };
    let scale = levels.iter().map(|level| level.along.abs()).fold(1.0, f64::max);
    for round in 0..PASSES {
        let is_search = round < SEARCH_PASSES;
        let within = if is_search || paint.is_speckled { DENSE_SIGMAS } else { CLEAN_SIGMAS };
        let mut pass = sum_levels(levels, &paint, within * paint.noise, scale, outward, tolerance);
        if pass.kept < MIN_LEVELS {
            return Err(PointStatus::LowCorrelation);
        }
        // Little bare paint gives one level, but not its variation.
        paint.is_speckled |= round > 0 && is_search && (pass.kept as f64) < BARE_FRACTION * levels.len() as f64;
        let order = if paint.is_speckled { 0 } else { (round / 2).min(3) };
        for free in order + 1..4 {
            pass.normal.fill_row(free, 0.0);
            pass.normal.fill_column(free, 0.0);
            pass.normal[(free, free)] = 1.0;
            pass.right[free] = 0.0;
        }
        let solved = pass.normal.try_inverse().ok_or(PointStatus::LowCorrelation)? * pass.right;
        paint.coefficients = [solved[0], solved[1] / scale, solved[2] / (scale * scale), solved[3] / scale];
        paint.noise = (pass.squares / pass.outer.max(1) as f64).sqrt();
        paint.noise = paint.noise.clamp(MIN_NOISE * tolerance, tolerance / PAINT_SIGMAS);
        // The level at the edge is extrapolated from those clear of it.
        paint.sigma = 2.0 * paint.noise / (pass.kept as f64).sqrt();
    }
    Ok(paint)
}

/// Sums the normal equations over the levels within `within` of the paint, and the squares of those on its outer side
/// up to `tolerance`, DN. Positions along the edge are in units of `scale`, px.
fn sum_levels(levels: &[Level], paint: &Paint, within: f64, scale: f64, outward: f64, tolerance: f64) -> Pass {
    let (normal, right) = (SMatrix::zeros(), SVector::zeros());
    let mut pass = Pass { normal, right, kept: 0, squares: 0.0, outer: 0 };
    for Level { along, behind, level } in levels {
        let residual = level - paint.level_at(*along, *behind);
        if residual * outward > 0.0 && residual.abs() <= tolerance {
            pass.squares += residual * residual;
            pass.outer += 1;
        }
        if residual.abs() > within {
            continue;
        }
        let x = along / scale;
        let row: SVector<f64, 4> = SVector::from([1.0, x, x * x, behind / scale]);
        pass.normal += row * row.transpose();
        pass.right += row * *level;
        pass.kept += 1;
    }
    pass
}
