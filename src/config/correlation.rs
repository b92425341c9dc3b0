//! `[correlation]`: how displacements are found.

use super::check::{Bounds, Table};
use super::error::ConfigError;
use super::raw::{OneOrMore, RawCorrelation};
use crate::dic::{CorrelationParams, Interpolation, Method, Shape, WindowShape};

/// Most intervals at once.
const MOST_INTERVALS: usize = 4;

/// `interval_frames`: one number, or several that rise.
pub(super) fn intervals(table: &Table<'_>, raw: &RawCorrelation) -> Result<Vec<u32>, ConfigError> {
    let given = match &raw.interval_frames {
        None => return Ok(vec![1]),
        Some(OneOrMore::One(interval)) => vec![*interval],
        Some(OneOrMore::More(intervals)) => intervals.clone(),
    };
    let rises = given.is_sorted_by(|a, b| a < b) && (1..=MOST_INTERVALS).contains(&given.len());
    let intervals: Vec<u32> = given.iter().filter(|i| (1..=255).contains(*i)).map(|i| *i as u32).collect();
    if rises && intervals.len() == given.len() {
        return Ok(intervals);
    }
    Err(table.refuse("interval_frames", "1 to 255 frames, or a rising list of at most 4 such numbers"))
}

pub(super) fn correlation(
    table: &Table<'_>,
    raw: &RawCorrelation,
    image_px: Option<(u32, u32)>,
) -> Result<CorrelationParams, ConfigError> {
    let default = CorrelationParams::default();
    let zncc = Bounds::closed(0.0, 1.0, "");
    let params = CorrelationParams {
        method: table.choice("method", raw.method.as_deref(), &Method::WORDS)?.unwrap_or(default.method),
        shape: table.choice("shape", raw.shape.as_deref(), &Shape::WORDS)?.unwrap_or(default.shape),
        window: table.choice("window", raw.window.as_deref(), &WindowShape::WORDS)?.unwrap_or(default.window),
        subset_size_px: table
            .whole("subset_size_px", raw.subset_size_px, 9..=255, "px, odd")?
            .unwrap_or(default.subset_size_px),
        step_px: table.whole("step_px", raw.step_px, 1..=255, "px")?.unwrap_or(default.step_px),
        spline_points: table.whole("spline_points", raw.spline_points, 0..=20, "")?.unwrap_or(default.spline_points),
        search_px: table.whole("search_px", raw.search_px, 1..=1024, "px")?.unwrap_or(default.search_px),
        min_zncc: table.number("min_zncc", raw.min_zncc, zncc)?.unwrap_or(default.min_zncc),
        interpolation: table
            .choice("interpolation", raw.interpolation.as_deref(), &Interpolation::WORDS)?
            .unwrap_or(default.interpolation),
    };
    if params.subset_size_px.is_multiple_of(2) {
        return Err(table.refuse("subset_size_px", "odd, 9 to 255 px"));
    }
    match image_px.map(|(width, height)| width.min(height)) {
        Some(side_px) if params.subset_size_px > side_px => {
            let left_out = if raw.subset_size_px.is_none() {
                format!("; left out it is {}", default.subset_size_px)
            } else {
                String::new()
            };
            Err(table
                .refuse("subset_size_px", format!("at most {side_px} px, the smaller side of the image{left_out}")))
        }
        _ => Ok(params),
    }
}
