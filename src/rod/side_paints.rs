//! The paints on both sides of an edge.

use super::edge_model::EdgeModel;
use super::level_grid::{EdgeLine, LevelGrid};
use super::paint_levels::{MIN_LEVELS, PAINT_SIGMAS, Paint, PaintStart, fit_paint};
use super::profiles::ExpectedEdge;
use super::side_levels::{SideLevels, SideRows};
use crate::results::PointStatus;

/// The quantile of the levels of a side at its paint; speckles lie closer to the level of the other side.
const PAINT_QUANTILE: f64 = 0.85;
/// The margin to the edge of levels that show the paint: in px, and in standard deviations of the blur.
const PAINT_MARGIN_PX: f64 = 2.0;
const PAINT_MARGIN_SIGMAS: f64 = 3.2;
/// The minimum tolerance of paint levels, as a fraction of the contrast.
const PAINT_TOLERANCE: f64 = 0.1;
/// The uncertainty of the level of speckled paint, as a fraction of the contrast.
///
/// The smaller one is added to that of a clean tape of about the same level, if there is one. The last is the range in
/// which the clean level may lie farther out.
const FREE_PAINT_SIGMA: f64 = 0.05;
const SAME_PAINT_SIGMA: f64 = 0.006;
const SAME_PAINT_RANGE: std::ops::RangeInclusive<f64> = -0.03..=0.12;

/// The estimates of the paints on both sides of an edge, from those of the fit before.
///
/// The same levels have the same paint. It is fitted again only where the edge has moved past a level.
#[derive(Default)]
pub(super) struct PaintEstimator {
    sides: [Option<SideEstimate>; 2],
}

/// The estimate of the paint on one side.
struct SideEstimate {
    rows: SideRows,
    quantiles: [f64; 3],
    start: PaintStart,
    paint: Paint,
    /// The edge to which the paint belongs.
    edge: EdgeLine,
}

impl PaintEstimator {
    /// Estimates the paint of both sides from the levels clear of the edge, before it and behind it.
    ///
    /// Speckles are closer in level to the other side of the edge than the paint around them. The paint of a side is
    /// therefore the outermost level. The side without speckles gives its variation. A speckled side takes the paint of
    /// clean edges if that has about the same level.
    ///
    /// # Errors
    ///
    /// [`PointStatus::OutOfFrame`] for too few levels, [`PointStatus::Lost`] if the contrast has the wrong sign, and the
    /// errors of [`fit_paint`].
    pub(super) fn estimate(
        &mut self,
        grid: &LevelGrid,
        model: &EdgeModel,
        expected: &ExpectedEdge<'_>,
    ) -> Result<[Paint; 2], PointStatus> {
        let margin = PAINT_MARGIN_PX.max(PAINT_MARGIN_SIGMAS * model.blur);
        let rows = [0, 1].map(|side| SideRows::new(grid, model.line(), side, margin));
        if rows.iter().any(|rows| rows.count() < MIN_LEVELS) {
            return Err(PointStatus::OutOfFrame);
        }
        // With sign 1 it is dark before the edge and light behind it.
        let sign = expected.sign;
        let outward = [-sign, sign];
        let mut levels = [None, None];
        let read = |rows: &SideRows| SideLevels::new(grid, model.line(), rows);
        let quantiles: [[f64; 3]; 2] = std::array::from_fn(|k| match &self.sides[k] {
            Some(last) if last.rows == rows[k] => last.quantiles,
            last => {
                let paint = if outward[k] > 0.0 { PAINT_QUANTILE } else { 1.0 - PAINT_QUANTILE };
                let guess = last.as_ref().map(|last| last.quantiles);
                levels[k].get_or_insert_with(|| read(&rows[k])).quantiles([paint, 0.25, 0.75], guess)
            }
        });
        let contrast = sign * (quantiles[1][0] - quantiles[0][0]);
        if contrast <= 0.0 {
            return Err(PointStatus::Lost);
        }
        let noise = quantiles.map(|[_, low, high]| 0.7413 * (high - low));
        let tolerance_dn = (PAINT_TOLERANCE * contrast).max(PAINT_SIGMAS * noise[0].min(noise[1]));
        let mut paints = [Paint::default(); 2];
        for (k, rows) in rows.into_iter().enumerate() {
            let start = PaintStart { level_dn: quantiles[k][0], tolerance_dn, outward: outward[k] };
            let paint = match &self.sides[k] {
                Some(last) if last.rows == rows && last.start == start => {
                    last.paint.moved(model.at - last.edge.at, model.slope - last.edge.slope)
                }
                _ => fit_paint(levels[k].get_or_insert_with(|| read(&rows)), start)?,
            };
            self.sides[k] = Some(SideEstimate { rows, quantiles: quantiles[k], start, paint, edge: model.line() });
            paints[k] = with_clean_paint(paint, outward[k], contrast, expected);
        }
        Ok(paints)
    }
}

/// Returns the paint of a side, that of clean edges if it is speckled and has about the same level.
fn with_clean_paint(paint: Paint, outward: f64, contrast: f64, expected: &ExpectedEdge<'_>) -> Paint {
    let Some(clean) = expected.clean.filter(|_| paint.is_speckled) else { return paint };
    let other = clean.paints_dn[usize::from(outward > 0.0)];
    let further = outward * (other.value - paint.level_at_edge(0.0)) / contrast;
    // Speckles pull the observed paint towards the other side. Otherwise it is another paint.
    if SAME_PAINT_RANGE.contains(&further) {
        let sigma = other.sigma.hypot(SAME_PAINT_SIGMA * contrast);
        Paint { coefficients: [other.value, 0.0, 0.0, 0.0], sigma, ..paint }
    } else {
        Paint { sigma: paint.sigma.max(FREE_PAINT_SIGMA * contrast), ..paint }
    }
}
