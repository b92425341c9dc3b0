//! The paint of one side of an edge, from the levels clear of it and from its paint in the frame before.

use super::paint_levels::{
    LANES, Lane, Levels, MIN_LEVELS, OUT_OF_RANGE, PASSES, Paint, limit_noise, outermost, paint_sigma, refit_paint,
    widest_noise,
};
use crate::image::ImageView;
use multiversion::multiversion;

/// The pixels next to an edge: a rectangle, and the distances of its pixels along and behind the edge.
#[derive(Clone, Copy)]
pub(super) struct ClearPixels {
    /// First and one past the last.
    pub(super) columns: [usize; 2],
    pub(super) rows: [usize; 2],
    /// The distance along the edge from its middle, px: at the first pixel, per column and per row.
    pub(super) along: [f64; 3],
    /// The same behind the edge; negative before it.
    pub(super) behind: [f64; 3],
    /// The minimum and the maximum distance behind the edge of the levels that count, px.
    pub(super) range: [f64; 2],
}

/// The sums of one pass over the levels.
#[derive(Default)]
struct Sums {
    /// The number and the sum of those within the range of the paint.
    kept: f64,
    sum: f64,
    /// The sum of squares and the number on the outer side of the paint.
    squares: f64,
    outer: f64,
}

/// The levels that count in a pass.
#[derive(Clone, Copy)]
struct Range {
    /// The level of the paint, DN.
    level: f64,
    /// The maximum distance from the paint, DN, and the same on its outer side for its noise.
    within: f64,
    tolerance: f64,
    /// 1 if the outer side is the lighter one, else -1.
    outward: f64,
}

/// Returns the paint of one side in this frame, of which `before` is that in an earlier frame.
///
/// It is that of [`fit_paint`](super::paint_levels::fit_paint), from `before` on where it is clean. `None` if too few levels
/// agree.
pub(super) fn update_paint(
    image: ImageView<'_>,
    pixels: &ClearPixels,
    before: &Paint,
    tolerance: f64,
    outward: f64,
) -> Option<Paint> {
    let is_inside = pixels.columns[1] <= image.width() && pixels.rows[1] <= image.height();
    if !is_inside || pixels.columns[0] >= pixels.columns[1] {
        return None;
    }
    let mut clear = Levels::default();
    for y in pixels.rows[0]..pixels.rows[1] {
        let levels = &image.row(y)[pixels.columns[0]..pixels.columns[1]];
        append_row(levels, (y - pixels.rows[0]) as f64, pixels, &mut clear);
    }
    match before.is_speckled {
        true => search_level(clear.levels, before, tolerance, outward),
        false => refit_paint(&clear, before, tolerance, outward),
    }
}

/// Appends the levels of a row with their places; those that do not count are out of any range. `down` is the number of the
/// row in its rectangle.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn append_row(levels: &[f32], down: f64, pixels: &ClearPixels, clear: &mut Levels) {
    let [along, along_right, along_down] = pixels.along;
    let [behind, behind_right, behind_down] = pixels.behind;
    let (along, behind) = (along + along_down * down, behind + behind_down * down);
    let [from, to] = pixels.range;
    let start = clear.levels.len();
    let end = start + levels.len();
    clear.along.resize(end, 0.0);
    clear.behind.resize(end, 0.0);
    clear.levels.resize(end, OUT_OF_RANGE);
    let places = clear.along[start..].iter_mut().zip(&mut clear.behind[start..]);
    for (((x, y), clear), (level, right)) in places.zip(&mut clear.levels[start..]).zip(levels.iter().zip(0_i32..)) {
        let right = f64::from(right);
        *x = along + along_right * right;
        *y = behind + behind_right * right;
        *clear = if (*y >= from) & (*y <= to) { f64::from(*level) } else { OUT_OF_RANGE };
    }
}

/// Searches the level of speckled paint from the outermost one: the densest level of a frame may be far from that of the
/// frame before.
fn search_level(mut levels: Vec<f64>, before: &Paint, tolerance: f64, outward: f64) -> Option<Paint> {
    levels.retain(|level| *level < OUT_OF_RANGE);
    let mut level = outermost(&mut levels, outward)?;
    let (mut paint, mut kept) = (Paint { noise: widest_noise(tolerance), ..*before }, 0.0);
    levels.resize(levels.len().next_multiple_of(LANES), OUT_OF_RANGE);
    for _ in 0..PASSES {
        let range = Range { level, within: paint.within_dn(), tolerance, outward };
        let sums = sum_levels(levels.as_chunks::<LANES>().0, range);
        kept = sums.kept;
        if kept < MIN_LEVELS as f64 {
            return None;
        }
        let last = (level, paint.noise);
        level = sums.sum / kept;
        paint.noise = limit_noise(sums.squares, sums.outer, tolerance);
        if last == (level, paint.noise) {
            break;
        }
    }
    paint.sigma = paint_sigma(paint.noise, kept);
    paint.coefficients = [level, 0.0, 0.0, 0.0];
    Some(paint)
}

/// Sums over the levels in the range.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2+fma"))]
fn sum_levels(levels: &[Lane], range: Range) -> Sums {
    let (mut kept, mut sum, mut squares, mut outer) = ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for lane in levels {
        for i in 0..LANES {
            let residual = lane[i] - range.level;
            let size = residual.abs();
            // Branches would prevent vectorization.
            let is_outer = (residual * range.outward > 0.0) & (size <= range.tolerance);
            squares[i] += if is_outer { residual * residual } else { 0.0 };
            outer[i] += if is_outer { 1.0 } else { 0.0 };
            kept[i] += if size <= range.within { 1.0 } else { 0.0 };
            sum[i] += if size <= range.within { lane[i] } else { 0.0 };
        }
    }
    let total = |lanes: Lane| lanes.iter().sum::<f64>();
    Sums { kept: total(kept), sum: total(sum), squares: total(squares), outer: total(outer) }
}
