//! Subpixel fit of a straight edge: one blurred step through many profiles of grey levels.

use super::edge_model::{CoreLevels, CoreSums, EdgeModel, Effort, PlacedEdge, ProfileFit, Vector};
use super::paint_levels::{Levels, MIN_LEVELS, PAINT_SIGMAS, Paint, fit_paint, outermost};
use super::profiles::{CleanPaint, ExpectedEdge, MIN_PROFILES, Profile, read_profiles};
use crate::image::ImageView;
use crate::numeric::{normal_f64, quantile};
use crate::results::{Estimate, PointStatus};

/// The margin to the edge of levels that show the paint: in px, and in standard deviations of the blur.
const PAINT_MARGIN_PX: f64 = 2.0;
const PAINT_MARGIN_SIGMAS: f64 = 3.2;
/// The minimum tolerance of paint levels, as a fraction of the contrast.
pub(super) const PAINT_TOLERANCE: f64 = 0.1;
/// The uncertainty of the level of speckled paint, as a fraction of the contrast.
///
/// The smaller one is added to that of a clean tape of about the same level, if there is one. The last is the range in
/// which the clean level may lie farther out.
const FREE_PAINT_SIGMA: f64 = 0.05;
const SAME_PAINT_SIGMA: f64 = 0.006;
const SAME_PAINT_RANGE: std::ops::RangeInclusive<f64> = -0.03..=0.12;
/// The residual from which a profile contains something else, as a fraction of the contrast, in each round.
const OUTLIER_FRACTIONS: [f64; 4] = [0.4, 0.12, 0.06, 0.05];
/// The fraction of plausible profiles at which no better position is searched.
const GOOD_PROFILE_FRACTION: f64 = 0.3;
/// The maximum distance of the edge from its expected position, px.
const MAX_SHIFT_PX: f64 = 3.0;
/// The distance that an edge may move without changing which levels are clear of it, px.
const SAME_PLACE_PX: f64 = 0.01;
/// The initial blur, px.
const START_BLUR_PX: f64 = 0.8;
/// The number of sectors of a shaded edge that are left out in turn.
const SECTORS: usize = 5;

/// A fitted edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Edge {
    /// The position across, at the middle, px.
    pub(super) at: Estimate,
    /// The slope: px across per px along.
    pub(super) slope: Estimate,
    /// The standard deviation of the blur, px.
    pub(super) blur_px: f64,
    /// The darker and the lighter paint, DN.
    pub(super) paints_dn: [Estimate; 2],
    /// Whether there are speckles on one side.
    pub(super) is_speckled: bool,
    /// The fit that the next frame starts from; `None` where light varies along the edge.
    pub(super) fitted: Option<FittedEdge>,
}

/// A fit of an edge, from which the fit in the next frame starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FittedEdge {
    /// The slope: px across per px along.
    pub(super) slope: f64,
    /// The standard deviation of the blur, px.
    pub(super) blur_px: f64,
    pub(super) paints: ObservedPaints,
    /// The level behind the edge minus that before it, DN.
    pub(super) contrast_dn: f64,
    /// The variance of the levels about the model, DN^2.
    pub(super) variance_dn2: f64,
}

/// The paints of both sides, before it and behind it, as the levels clear of an edge show them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ObservedPaints {
    pub(super) paints: [Paint; 2],
    /// The distance between the outermost levels of both sides, DN.
    pub(super) range_dn: f64,
    /// The tolerance of paint levels, DN.
    pub(super) tolerance_dn: f64,
    /// 1 if it gets lighter across, -1 if it gets darker.
    pub(super) sign: f64,
}

impl Edge {
    /// Composes an edge from its place in the image, its model and the fit to start from.
    pub(super) fn new(placed: &PlacedEdge, model: &EdgeModel, fitted: Option<FittedEdge>) -> Self {
        let PlacedEdge { at, slope, paints_dn, .. } = *placed;
        Self { at, slope, blur_px: model.blur, paints_dn, is_speckled: model.is_speckled(), fitted }
    }
}

impl FittedEdge {
    /// Whether there are speckles on one side.
    pub(super) fn is_speckled(&self) -> bool {
        self.paints.paints.iter().any(|paint| paint.is_speckled)
    }
}

impl ObservedPaints {
    /// Returns 1 if the outer side of the paint of a side (0 before, 1 behind) is the lighter one, else -1.
    pub(super) fn outward(&self, side: usize) -> f64 {
        outward(self.sign, side)
    }

    /// Returns the paints with those of clean edges, if known, where speckles cover the paint and it has about the same
    /// level.
    pub(super) fn corrected(&self, clean: Option<CleanPaint>) -> [Paint; 2] {
        let mut paints = self.paints;
        let Some(clean) = clean else { return paints };
        for (k, paint) in paints.iter_mut().enumerate().filter(|(_, paint)| paint.is_speckled) {
            let outward = self.outward(k);
            let other = clean.paints_dn[usize::from(outward > 0.0)];
            let further = outward * (other.value - paint.level_at_edge(0.0)) / self.range_dn;
            // Speckles pull the observed paint towards the other side. Otherwise it is another paint.
            if SAME_PAINT_RANGE.contains(&further) {
                let sigma = other.sigma.hypot(SAME_PAINT_SIGMA * self.range_dn);
                *paint = Paint { coefficients: [other.value, 0.0, 0.0, 0.0], sigma, ..*paint };
            } else {
                paint.sigma = paint.sigma.max(FREE_PAINT_SIGMA * self.range_dn);
            }
        }
        paints
    }
}

impl CoreLevels for [Profile] {
    fn sums(&self, model: &EdgeModel) -> CoreSums {
        let mut sums = CoreSums::default();
        for profile in self.iter().filter(|profile| profile.weight > 0.0) {
            for (residual, derivatives) in core_residuals(model, profile) {
                let weighted = derivatives * profile.weight;
                // The lower triangle; the matrix is symmetric.
                for column in 0..5 {
                    for row in column..5 {
                        sums.normal[(row, column)] += derivatives[row] * weighted[column];
                    }
                }
                sums.right += weighted * residual;
                sums.squares += profile.weight * residual * residual;
                sums.count += profile.weight;
            }
        }
        sums.normal.fill_upper_triangle_with_lower_triangle();
        sums
    }

    fn profile_fits(&self, model: &EdgeModel) -> Vec<ProfileFit> {
        let fit = |profile: &Profile| {
            let (mut right, mut information, mut residual_dn) = (0.0, 0.0, 0.0_f64);
            for (residual, derivatives) in core_residuals(model, profile) {
                right += residual * derivatives[0];
                information += derivatives[0] * derivatives[0];
                residual_dn = residual_dn.max(residual.abs());
            }
            ProfileFit { shift_px: right / information.max(1e-9), information, residual_dn, trust: profile.trust }
        };
        self.iter().map(fit).collect()
    }

    fn weights(&self) -> Vec<f64> {
        self.iter().map(|profile| profile.weight).collect()
    }

    fn set_weights(&mut self, weights: &[f64]) {
        self.iter_mut().zip(weights).for_each(|(profile, weight)| profile.weight = *weight);
    }

    fn highest_dn(&self) -> f64 {
        self.iter().flat_map(|profile| &profile.levels).copied().fold(0.0, f64::max)
    }
}

/// Returns residual and derivatives of the levels of a profile that place the edge: those near it.
///
/// The model is a step blurred by a Gaussian. The derivatives are by position, slope, blur and the levels of both sides.
fn core_residuals<'p>(model: &'p EdgeModel, profile: &'p Profile) -> impl Iterator<Item = (f64, Vector)> + 'p {
    let reach = model.reach_px();
    let [before, after] = model.paints.map(|paint| paint.level_at_edge(profile.along));
    // Those within reach lie at a distance of about this from the first level.
    let edge = model.at + model.slope * profile.along - profile.first;
    let from = (edge - reach - 1.0).max(0.0) as usize;
    let to = ((edge + reach + 2.0).max(0.0) as usize).min(profile.levels.len()).max(from);
    let near = profile.levels.get(from..to).unwrap_or_default();
    near.iter().enumerate().filter_map(move |(index, level)| {
        let behind = distance_behind_px(model, profile, from + index);
        if behind.abs() > reach {
            return None;
        }
        let (p, density) = normal_f64(behind / model.blur);
        let by_place = -(after - before) * density / model.blur;
        let by_blur = by_place * behind / model.blur;
        let residual = level - before - (after - before) * p;
        let derivatives = Vector::from([by_place, by_place * profile.along, by_blur, 1.0 - p, p]);
        Some((residual, derivatives))
    })
}

/// Returns the distance of the level `index` of a profile behind the edge, px; negative before it.
fn distance_behind_px(model: &EdgeModel, profile: &Profile, index: usize) -> f64 {
    profile.first + index as f64 - model.at - model.slope * profile.along
}

/// Fits the edge at its expected position: a step blurred by a Gaussian, with weights of the profiles by Tukey's
/// biweight in several rounds.
///
/// # Errors
///
/// [`PointStatus::OutOfFrame`] if it leaves the allowed range, [`PointStatus::Lost`] if there is none,
/// [`PointStatus::LowContrast`] if it is too faint or too blurred to be placed, and
/// [`PointStatus::LowCorrelation`] if its profiles do not agree.
pub(super) fn fit_step_edge(image: ImageView<'_>, expected: &ExpectedEdge<'_>) -> Result<Edge, PointStatus> {
    let mut profiles = read_profiles(image, expected)?;
    let clean = expected.clean;
    let mut model = EdgeModel {
        at: expected.near,
        slope: expected.slope,
        blur: clean.map_or(START_BLUR_PX, |clean| clean.blur_px),
        is_blur_known: clean.is_some(),
        is_shaded: expected.light.is_some(),
        paints: [Paint::default(); 2],
        moved: [0.0; 2],
    };
    let mut observed = observe_paints(&profiles, &model, expected.sign)?;
    let mut seen_from = model;
    model.paints = observed.corrected(clean);
    model.at = find_start(&profiles, &model);
    for fraction in OUTLIER_FRACTIONS {
        if model.distance_px(&seen_from) > SAME_PLACE_PX {
            observed = observe_paints(&profiles, &model, expected.sign)?;
            seen_from = model;
        }
        model.paints = observed.corrected(clean);
        model.reweigh(profiles.as_mut_slice(), fraction)?;
        model = model.solve(profiles.as_slice(), Effort::Full)?;
        if (model.at - expected.near).abs() > MAX_SHIFT_PX {
            return Err(PointStatus::Lost);
        }
    }
    let light_sigma_px = if model.is_shaded { sector_sigma(&profiles, &model) } else { 0.0 };
    let placed = model.place(profiles.as_slice(), light_sigma_px)?;
    let fitted = FittedEdge {
        slope: model.slope,
        blur_px: model.blur,
        paints: observed,
        contrast_dn: model.contrast(),
        variance_dn2: placed.variance_dn2,
    };
    Ok(Edge::new(&placed, &model, (!model.is_shaded).then_some(fitted)))
}

/// Returns 1 if the outer side of the paint of a side (0 before, 1 behind) is the lighter one, else -1. With `sign` 1 it is
/// dark before the edge and light behind it.
fn outward(sign: f64, side: usize) -> f64 {
    if (side == 1) == (sign > 0.0) { 1.0 } else { -1.0 }
}

/// Returns the margin to the edge of the levels that show the paint, px.
pub(super) fn paint_margin_px(model: &EdgeModel) -> f64 {
    PAINT_MARGIN_PX.max(PAINT_MARGIN_SIGMAS * model.blur)
}

/// Estimates the paint of both sides from the levels clear of the edge, before it and behind it.
///
/// Speckles are closer in level to the other side of the edge than the paint around them. The paint of a side is
/// therefore the outermost level. The side without speckles gives its variation.
///
/// # Errors
///
/// [`PointStatus::OutOfFrame`] for too few levels, [`PointStatus::Lost`] if the contrast has the wrong sign, and the
/// errors of [`fit_paint`].
fn observe_paints(profiles: &[Profile], model: &EdgeModel, sign: f64) -> Result<ObservedPaints, PointStatus> {
    let margin = paint_margin_px(model);
    let sides = [-1.0, 1.0].map(|of| levels_beside(profiles, model, of, margin));
    if sides.iter().any(|levels| levels.len() < MIN_LEVELS) {
        return Err(PointStatus::OutOfFrame);
    }
    let mut sorted = [sides[0].levels.clone(), sides[1].levels.clone()];
    let start: [f64; 2] = [0, 1].map(|k| outermost(&mut sorted[k], outward(sign, k)).unwrap_or(f64::NAN));
    let contrast = sign * (start[1] - start[0]);
    if contrast <= 0.0 {
        return Err(PointStatus::Lost);
    }
    let mut side_quantile = |k: usize, fraction: f64| quantile(&mut sorted[k], fraction).unwrap_or(f64::NAN);
    let noise = [0, 1].map(|k| 0.7413 * (side_quantile(k, 0.75) - side_quantile(k, 0.25)));
    let tolerance = (PAINT_TOLERANCE * contrast).max(PAINT_SIGMAS * noise[0].min(noise[1]));
    let mut observed =
        ObservedPaints { paints: [Paint::default(); 2], range_dn: contrast, tolerance_dn: tolerance, sign };
    for k in 0..2 {
        observed.paints[k] = fit_paint(&sides[k], start[k], tolerance, observed.outward(k))?;
    }
    Ok(observed)
}

/// Returns the levels at least `margin` px from the edge, before it (`of` = -1) or behind it (`of` = 1).
fn levels_beside(profiles: &[Profile], model: &EdgeModel, of: f64, margin: f64) -> Levels {
    let mut beside = Levels::default();
    for profile in profiles {
        for (index, level) in profile.levels.iter().enumerate() {
            let behind = distance_behind_px(model, profile, index);
            if of * behind >= margin {
                beside.along.push(profile.along);
                beside.behind.push(behind);
                beside.levels.push(*level);
            }
        }
    }
    beside
}

/// Returns the position across the edge, px, from which the fit starts, within 2 px of the model's.
///
/// It is the nearest one with enough plausible profiles, otherwise that with the most.
fn find_start(profiles: &[Profile], model: &EdgeModel) -> f64 {
    const SHIFTS_PX: [f64; 9] = [0.0, -0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0];
    let limit = OUTLIER_FRACTIONS[0] * model.contrast().abs();
    let likely = |shift: f64| {
        let moved = EdgeModel { at: model.at + shift, ..*model };
        profiles
            .iter()
            .filter(|profile| core_residuals(&moved, profile).all(|(residual, _)| residual.abs() <= limit))
            .count()
    };
    let enough = (GOOD_PROFILE_FRACTION * profiles.len() as f64).max(MIN_PROFILES as f64) as usize;
    let tried = SHIFTS_PX.map(|shift| (likely(shift), shift));
    let best = tried.iter().fold((0, 0.0), |best, next| if next.0 > best.0 { *next } else { best });
    model.at + tried.iter().find(|(count, _)| *count >= enough).unwrap_or(&best).1
}

/// Returns the uncertainty of the edge, px, by leaving out one sector of its profiles at a time.
///
/// An error of the light on the lighter side is common to neighbouring profiles, so their scatter does not show it. The
/// jackknife: B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, SIAM 1982, section 3.
fn sector_sigma(profiles: &[Profile], model: &EdgeModel) -> f64 {
    let shift = |sector: usize| {
        let others = profiles.iter().enumerate().filter(|(index, _)| index * SECTORS / profiles.len() != sector);
        let others: Vec<Profile> = others.map(|(_, profile)| profile.clone()).collect();
        model.solve(others.as_slice(), Effort::Full).map(|found| found.at - model.at)
    };
    let squares: f64 = (0..SECTORS).filter_map(|sector| shift(sector).ok()).map(|shift| shift * shift).sum();
    ((SECTORS - 1) as f64 / SECTORS as f64 * squares).sqrt()
}

#[cfg(test)]
pub(super) mod tests;
