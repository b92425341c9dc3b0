//! The grey level of the paint on one side of an edge, with speckles on it or not.

use super::PAINT_SIGMAS;
use crate::results::PointStatus;
use nalgebra::{SMatrix, SVector};

/// Speckled paint is where levels within so many times its noise are densest; of a clean side nearly all levels count.
const DENSE_SIGMAS: f64 = 1.5;
const CLEAN_SIGMAS: f64 = 3.0;
/// With fewer of its levels there than this share, a side is speckled.
const BARE_SHARE: f64 = 0.6;
/// Paint varies by at least this share of the tolerance.
const LEAST_NOISE: f64 = 0.02;
/// Fewest levels that the paint of a side is known from.
pub(super) const LEAST_PAINT: usize = 12;
/// Passes, and how many of them look for where levels are densest.
const PASSES: usize = 14;
const SEARCHING: usize = 8;

/// The grey level of one side: a parabola along the edge, a line across.
#[derive(Clone, Copy, Default)]
pub(super) struct Paint {
    /// Of 1, along, along squared and behind; at the edge the last is nought.
    pub(super) coefficients: [f64; 4],
    /// Standard deviation of a level, and of the paint at the edge.
    pub(super) noise: f64,
    pub(super) sigma: f64,
    pub(super) is_speckled: bool,
}

/// A grey level clear of the edge.
pub(super) struct Level {
    pub(super) along: f64,
    pub(super) behind: f64,
    pub(super) level: f64,
}

/// What one pass over the levels adds up to.
struct Pass {
    normal: SMatrix<f64, 4, 4>,
    right: SVector<f64, 4>,
    kept: usize,
    /// Squares and number of those on the outer side of the paint.
    squares: f64,
    beyond: usize,
}

impl Paint {
    pub(super) fn at(&self, along: f64) -> f64 {
        self.level(along, 0.0)
    }

    fn level(&self, along: f64, behind: f64) -> f64 {
        let [c, b, a, d] = self.coefficients;
        c + along * (b + along * a) + d * behind
    }
}

/// The level that this share of all of them is under.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// The paint around which the levels are densest: a mean shift over levels near it.
///
/// Levels beside a speckle lie between its shade and the paint's, so the noise is told by those on the other side of
/// the paint (`outward` 1 for lighter), up to `tolerance`.
///
/// # Errors
///
/// [`PointStatus::LowCorrelation`] where too few levels agree.
pub(super) fn one_paint(levels: &[Level], start: f64, tolerance: f64, outward: f64) -> Result<Paint, PointStatus> {
    let mut paint = Paint { coefficients: [start, 0.0, 0.0, 0.0], noise: tolerance / PAINT_SIGMAS, ..Paint::default() };
    let scale = levels.iter().map(|level| level.along.abs()).fold(1.0, f64::max);
    for round in 0..PASSES {
        let is_searching = round < SEARCHING;
        let within = if is_searching || paint.is_speckled { DENSE_SIGMAS } else { CLEAN_SIGMAS };
        let mut pass = over(levels, &paint, within * paint.noise, scale, (outward, tolerance));
        if pass.kept < LEAST_PAINT {
            return Err(PointStatus::LowCorrelation);
        }
        // Little of it is bare: that shows one level, and not how it changes.
        paint.is_speckled |= round > 0 && is_searching && (pass.kept as f64) < BARE_SHARE * levels.len() as f64;
        let order = if paint.is_speckled { 0 } else { (round / 2).min(3) };
        for free in order + 1..4 {
            pass.normal.fill_row(free, 0.0);
            pass.normal.fill_column(free, 0.0);
            pass.normal[(free, free)] = 1.0;
            pass.right[free] = 0.0;
        }
        let solved = pass.normal.try_inverse().ok_or(PointStatus::LowCorrelation)? * pass.right;
        paint.coefficients = [solved[0], solved[1] / scale, solved[2] / (scale * scale), solved[3] / scale];
        paint.noise = (pass.squares / pass.beyond.max(1) as f64).sqrt();
        paint.noise = paint.noise.clamp(LEAST_NOISE * tolerance, tolerance / PAINT_SIGMAS);
        // The level at the edge is an extrapolation from those clear of it.
        paint.sigma = 2.0 * paint.noise / (pass.kept as f64).sqrt();
    }
    Ok(paint)
}

fn over(levels: &[Level], paint: &Paint, within: f64, scale: f64, (outward, tolerance): (f64, f64)) -> Pass {
    let (normal, right) = (SMatrix::zeros(), SVector::zeros());
    let mut pass = Pass { normal, right, kept: 0, squares: 0.0, beyond: 0 };
    for Level { along, behind, level } in levels {
        let off = level - paint.level(*along, *behind);
        if off * outward > 0.0 && off.abs() <= tolerance {
            pass.squares += off * off;
            pass.beyond += 1;
        }
        if off.abs() > within {
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
