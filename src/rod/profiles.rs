//! The profiles of grey levels across an expected edge.

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

/// The grey levels along a line across the edge.
#[derive(Debug, Clone)]
pub(super) struct Profile {
    /// The coordinate along the edge, from its middle.
    pub(super) along: f64,
    /// The coordinate of the first level across.
    pub(super) first: f64,
    pub(super) levels: Vec<f64>,
    pub(super) weight: f64,
    /// The maximum weight, 0 to 1: the square of the contrast relative to the others.
    pub(super) trust: f64,
}

/// Reads the profiles around the expected edge, without those that leave the allowed range.
///
/// # Errors
///
/// [`PointStatus::OutOfFrame`] if at most half of them, or fewer than five, stay in it, and the errors of [`flatten`].
pub(super) fn read_profiles(image: ImageView<'_>, expected: &ExpectedEdge<'_>) -> Result<Vec<Profile>, PointStatus> {
    let [before, behind] = expected.depth.map(|depth| depth as f64);
    let [first, last] = expected.room.map(|place| place as f64);
    let level = |along: usize, across: usize| match expected.direction {
        Direction::Rows => image.at(along, across),
        Direction::Columns => image.at(across, along),
    };
    let profile_at = |along: usize| {
        let from_middle = along as f64 - expected.middle;
        let center = (expected.near + expected.slope * from_middle).round();
        if !(center - MIN_DEPTH_PX >= first && center + MIN_DEPTH_PX <= last) {
            return None;
        }
        let start = (center - before).max(first) as usize;
        let end = (center + behind).min(last) as usize;
        let levels = (start..=end).map(|across| level(along, across).map(f64::from));
        let levels = levels.collect::<Option<_>>()?;
        Some(Profile { along: from_middle, first: start as f64, levels, weight: 1.0, trust: 1.0 })
    };
    let all = expected.along[1].saturating_sub(expected.along[0]);
    let profiles: Vec<Profile> = (expected.along[0]..expected.along[1]).filter_map(profile_at).collect();
    if 2 * profiles.len() <= all || profiles.len() < MIN_PROFILES {
        return Err(PointStatus::OutOfFrame);
    }
    match expected.light {
        Some(light) => flatten(profiles, expected, light),
        None => Ok(profiles),
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
fn flatten(
    mut profiles: Vec<Profile>,
    expected: &ExpectedEdge<'_>,
    light: &TapeLight,
) -> Result<Vec<Profile>, PointStatus> {
    let highest = profiles.iter().flat_map(|profile| &profile.levels).copied().fold(0.0, f64::max);
    let clipped = if is_saturated(highest as f32) { highest - 0.5 } else { f64::INFINITY };
    let edge_at = |profile: &Profile| expected.near + expected.slope * profile.along;
    let dark = |profile: &Profile| {
        let is_dark = |index: usize| {
            let behind = profile.first + index as f64 - edge_at(profile);
            -expected.sign * behind >= DARK_MARGIN_PX
        };
        let levels = profile.levels.iter().enumerate().filter(|(index, _)| is_dark(*index));
        quantile(&mut levels.map(|(_, level)| *level).collect::<Vec<_>>(), DARK_QUANTILE)
    };
    let light_at = |profile: &Profile, across: f64| light.level_at(expected.middle + profile.along, across);
    profiles.retain(|profile| profile.levels.iter().all(|level| *level < clipped));
    let darks: Vec<f64> = profiles.iter().map(|profile| dark(profile).unwrap_or(f64::INFINITY)).collect();
    let contrasts: Vec<f64> =
        profiles.iter().zip(&darks).map(|(profile, dark)| light_at(profile, edge_at(profile)) - dark).collect();
    let mut positive: Vec<f64> = contrasts.iter().copied().filter(|contrast| *contrast > 0.0).collect();
    let typical = quantile(&mut positive, 0.5).unwrap_or(f64::INFINITY);
    let mut flattened = Vec::with_capacity(profiles.len());
    for ((mut profile, dark), contrast) in profiles.into_iter().zip(darks).zip(contrasts) {
        if contrast < MIN_CONTRAST_FRACTION * typical || !contrast.is_finite() {
            continue;
        }
        let gain = |index: usize| {
            let light = light_at(&profile, profile.first + index as f64);
            FLAT_CONTRAST / (light - dark).max(MIN_LEVEL_FRACTION * contrast)
        };
        profile.levels = (0..profile.levels.len()).map(|k| (profile.levels[k] - dark) * gain(k)).collect();
        profile.trust = (contrast / typical).powi(2).min(1.0);
        flattened.push(profile);
    }
    if flattened.len() < MIN_PROFILES { Err(PointStatus::LowContrast) } else { Ok(flattened) }
}
