//! `[correlation]`: the measurement of displacements.

use super::check::{Bounds, Table};
use super::error::ConfigError;
use super::raw::{OneOrMore, RawCorrelation};
use crate::dic::{CorrelationParams, Interpolation, Method, Shape, WindowShape};

/// The maximum number of intervals.
const MAX_INTERVALS: usize = 4;

/// Checks `interval_frames`: one number, or a rising list.
pub(super) fn check_intervals(table: &Table<'_>, raw: &RawCorrelation) -> Result<Vec<u32>, ConfigError> {
    let given: &[i64] = match &raw.interval_frames {
        None => &[1],
        Some(OneOrMore::One(interval)) => std::slice::from_ref(interval),
        Some(OneOrMore::More(intervals)) => intervals,
    };
    let is_rising = given.is_sorted_by(|a, b| a < b) && (1..=MAX_INTERVALS).contains(&given.len());
    if is_rising && given.iter().all(|interval| (1..=255).contains(interval)) {
        return Ok(given.iter().map(|interval| *interval as u32).collect());
    }
    Err(table.refuse(
        "interval_frames",
        format!("1 to 255 frames, or a rising list of at most {MAX_INTERVALS} such numbers"),
    ))
}

/// Checks the parameters of the correlator, and that a subset fits into the image if its size is known.
pub(super) fn check_correlation(
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
            .integer("subset_size_px", raw.subset_size_px, 9..=255, "px, odd")?
            .unwrap_or(default.subset_size_px),
        step_px: table.integer("step_px", raw.step_px, 1..=255, "px")?.unwrap_or(default.step_px),
        spline_points: table.integer("spline_points", raw.spline_points, 0..=20, "")?.unwrap_or(default.spline_points),
        search_px: table.integer("search_px", raw.search_px, 1..=1024, "px")?.unwrap_or(default.search_px),
        min_zncc: table.number("min_zncc", raw.min_zncc, zncc)?.unwrap_or(default.min_zncc),
        interpolation: table
            .choice("interpolation", raw.interpolation.as_deref(), &Interpolation::WORDS)?
            .unwrap_or(default.interpolation),
    };
    let size_px = params.subset_size_px;
    if size_px.is_multiple_of(2) {
        return Err(table.refuse("subset_size_px", "odd, 9 to 255 px"));
    }
    match image_px.map(|(width, height)| width.min(height)) {
        Some(side_px) if size_px > side_px => {
            let default =
                if raw.subset_size_px.is_none() { format!("; the default is {size_px}") } else { String::new() };
            Err(table.refuse("subset_size_px", format!("at most {side_px} px, the smaller side of the image{default}")))
        }
        _ => Ok(params),
    }
}
