//! The profiles of grey levels across an expected edge.

use super::level_grid::{LevelGrid, Profile};
use super::tape_light::TapeLight;
use crate::image::{ImageView, is_saturated};
use crate::numeric::quantile;
use crate::results::{Estimate, PointStatus};

/// The minimum number of profiles of an edge.
pub(super) const MIN_PROFILES: usize = 5;
/// The minimum reach of profiles to either side, px.
const MIN_DEPTH_PX: f64 = 5.0;
/// The margin to the edge of the levels that show its darker side, px, and their quantile at its paint.
const DARK_MARGIN_PX: f64 = 3.5;
const DARK_QUANTILE: f64 = 0.4;
/// The minimum contrast of a profile relative to the median, and that of a level within it.
///
/// A reflection leaves no contrast, and the dark side of a lit rod little.
const MIN_CONTRAST_FRACTION: f64 = 0.3;
const MIN_LEVEL_FRACTION: f64 = 0.3;
/// The contrast of flattened profiles.
const FLAT_CONTRAST: f64 = 100.0;

/// The direction of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    /// Along the rows: profiles are parts of columns.
    Rows,
    /// Along the columns: profiles are parts of rows.
    Columns,
}

/// The expected position of an edge; coordinates count along and across the edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct ExpectedEdge<'a> {
    pub(super) direction: Direction,
    /// The profiles along it, first and one past the last.
    pub(super) along: [usize; 2],
    /// The coordinate along the edge to which its position belongs.
    pub(super) middle: f64,
    /// The position across, within about 2 px.
    pub(super) near: f64,
    /// The slope: px across per px along.
    pub(super) slope: f64,
    /// The length of the profiles before and behind it, if there is room.
    pub(super) depth: [usize; 2],
    /// The first and the last coordinate across that may be read.
    pub(super) room: [usize; 2],
    /// 1 if it gets lighter across, -1 if it gets darker.
    pub(super) sign: f64,
    /// Blur and paint measured at clean edges of the same image.
    pub(super) clean: Option<CleanPaint>,
    /// The light on the lighter side, if it varies along the edge.
    pub(super) light: Option<&'a TapeLight>,
}

/// Blur and paint of clean edges, which a speckled edge alone does not separate from its position.
#[derive(Debug, Clone, Copy)]
pub(super) struct CleanPaint {
    /// The standard deviation of the blur, px: the lens blurs all edges alike.
    pub(super) blur_px: f64,
    /// The darker and the lighter paint at the edge, DN: the tapes are of one material.
    pub(super) paints_dn: [Estimate; 2],
}

/// Reads the profiles around the expected edge, without those that leave the allowed range.
///
/// # Errors
///
/// [`PointStatus::OutOfFrame`] if at most half of them, or fewer than five, stay in it, and the errors of [`flatten`].
pub(super) fn read_profiles(image: ImageView<'_>, expected: &ExpectedEdge<'_>) -> Result<LevelGrid, PointStatus> {
    let [before, behind] = expected.depth.map(|depth| depth as f64);
    let (limits, [first, last]) = match expected.direction {
        Direction::Rows => ([image.width(), image.height()], expected.room),
        Direction::Columns => ([image.height(), image.width()], expected.room),
    };
    let last = last.min(limits[1] - 1);
    let profile_at = |along: usize| {
        let from_middle = along as f64 - expected.middle;
        let center = (expected.near + expected.slope * from_middle).round();
        if !(center - MIN_DEPTH_PX >= first as f64 && center + MIN_DEPTH_PX <= last as f64) {
            return None;
        }
        let across = [(center - before).max(first as f64) as usize, (center + behind).min(last as f64) as usize];
        Some(Profile { along: from_middle, across, trust: 1.0 })
    };
    let [from, to] = expected.along;
    let columns: Vec<(usize, Profile)> =
        (from..to.min(limits[0])).filter_map(|along| Some((along, profile_at(along)?))).collect();
    if 2 * columns.len() <= to.saturating_sub(from) || columns.len() < MIN_PROFILES {
        return Err(PointStatus::OutOfFrame);
    }
    let (data, width) = (image.data(), image.width());
    let profiles: Vec<Profile> = columns.iter().map(|(_, profile)| *profile).collect();
    let grid = match expected.direction {
        Direction::Rows => LevelGrid::new(profiles, |index, across| data[across * width + columns[index].0]),
        Direction::Columns => LevelGrid::new(profiles, |index, across| data[columns[index].0 * width + across]),
    };
    match expected.light {
        Some(light) => flatten(&grid, expected, light),
        None => Ok(grid),
    }
}

/// Scales each profile from its own darker side to the light on its lighter side, so that all become steps from 0 to
/// [`FLAT_CONTRAST`].
///
/// Profiles with saturated levels or with little contrast are left out.
///
/// # Errors
///
/// [`PointStatus::LowContrast`] if fewer than five are left.
fn flatten(grid: &LevelGrid, expected: &ExpectedEdge<'_>, light: &TapeLight) -> Result<LevelGrid, PointStatus> {
    let highest = grid.highest_dn();
    let clipped = if is_saturated(highest) { highest - 0.5 } else { f32::INFINITY };
    let light_at = |profile: &Profile, across: f64| light.level_at(expected.middle + profile.along, across);
    let is_kept = |index: &usize| grid.levels_of(*index).all(|(_, level)| level < clipped);
    let kept: Vec<(usize, f64, f64)> = (0..grid.profiles.len())
        .filter(is_kept)
        .map(|index| {
            let profile = &grid.profiles[index];
            let edge = expected.near + expected.slope * profile.along;
            let dark = dark_level(grid, index, expected);
            (index, dark, light_at(profile, edge) - dark)
        })
        .collect();
    let mut positive: Vec<f64> =
        kept.iter().map(|(.., contrast)| *contrast).filter(|contrast| *contrast > 0.0).collect();
    let typical = quantile(&mut positive, 0.5).unwrap_or(f64::INFINITY);
    let has_contrast = |contrast: f64| contrast >= MIN_CONTRAST_FRACTION * typical && contrast.is_finite();
    let kept: Vec<(usize, f64, f64)> = kept.into_iter().filter(|(.., contrast)| has_contrast(*contrast)).collect();
    if kept.len() < MIN_PROFILES {
        return Err(PointStatus::LowContrast);
    }
    let scaled = |(index, _, contrast): &(usize, f64, f64)| Profile {
        trust: (contrast / typical).powi(2).min(1.0),
        ..grid.profiles[*index]
    };
    Ok(LevelGrid::new(kept.iter().map(scaled).collect(), |index, across| {
        let (index, dark, contrast) = kept[index];
        let light = light_at(&grid.profiles[index], across as f64);
        let gain = FLAT_CONTRAST / (light - dark).max(MIN_LEVEL_FRACTION * contrast);
        ((f64::from(grid.level(index, across)) - dark) * gain) as f32
    }))
}

/// Returns the level of the darker side of a profile, DN; infinity if it has none.
fn dark_level(grid: &LevelGrid, index: usize, expected: &ExpectedEdge<'_>) -> f64 {
    let edge = expected.near + expected.slope * grid.profiles[index].along;
    let is_dark = |across: usize| -expected.sign * (across as f64 - edge) >= DARK_MARGIN_PX;
    let mut levels: Vec<f64> =
        grid.levels_of(index).filter(|(across, _)| is_dark(*across)).map(|(_, level)| f64::from(level)).collect();
    quantile(&mut levels, DARK_QUANTILE).unwrap_or(f64::INFINITY)
}
