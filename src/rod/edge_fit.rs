//! Subpixel fit of a straight edge: one blurred step through many profiles of grey levels.

use super::paint_levels::{Levels, MIN_LEVELS, PAINT_SIGMAS, Paint, fit_paint};
use super::profiles::{ExpectedEdge, MIN_PROFILES, Profile, read_profiles};
use crate::image::{ImageView, is_saturated};
use crate::numeric::{normal_f64, quantile};
use crate::results::{Estimate, PointStatus};
use nalgebra::{SMatrix, SVector};

/// The minimum fraction of the examined profiles.
const MIN_PROFILE_FRACTION: f64 = 0.12;
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
/// The relative weight that fixes a known parameter.
const FIXED_WEIGHT: f64 = 1e9;
/// The reach of the levels that place the edge: in px, and in standard deviations of the blur.
const CORE_PX: f64 = 2.0;
const CORE_SIGMAS: f64 = 2.2;
/// The residual from which a profile contains something else: in standard deviations, and as a fraction of the contrast
/// in each round.
const OUTLIER_SIGMAS: f64 = 3.5;
const OUTLIER_FRACTIONS: [f64; 4] = [0.4, 0.12, 0.06, 0.05];
/// The fraction of plausible profiles at which no better position is searched.
const GOOD_PROFILE_FRACTION: f64 = 0.3;
/// The minimum contrast of an edge, in standard deviations of the noise.
const MIN_CONTRAST_SIGMAS: f64 = 8.0;
/// The maximum distance of the edge from its expected position, px.
const MAX_SHIFT_PX: f64 = 3.0;
/// The range of the blur, px; an edge at the upper end is too blurred to be placed.
const BLUR_RANGE_PX: [f64; 2] = [0.25, 1.8];
/// The initial blur, px.
const START_BLUR_PX: f64 = 0.8;
/// The maximum number of Gauss-Newton steps, and the change at which they have converged, px.
const MAX_STEPS: usize = 20;
const CONVERGED_PX: f64 = 1e-5;
/// The constant of Tukey's biweight.
const TUKEY: f64 = 4.685;
/// The uncertainty of an edge because of the model, common to all its profiles, px.
const MODEL_SIGMA_PX: f64 = 0.002;
/// The same for speckled paint, px, and the fraction of the shift by shading of the paint, which acts one way only.
const SPECKLED_SIGMA_PX: f64 = 0.005;
const SHADING_FRACTION: f64 = 0.5;
/// The same for light that varies across the rod, px: edges were off by 0.014 to 0.065 px rms in five simulated films.
const SHADED_SIGMA_PX: f64 = 0.05;
/// The number of sectors of a shaded edge that are left out in turn.
const SECTORS: usize = 5;
/// The same for clipped paint: an exposure up to three times too long moves edges towards the dark by up to 0.7 px, px.
const CLIPPED_SIGMA_PX: f64 = 0.5;
/// The fraction of the brightest level from which paint counts as clipped.
const CLIPPED_FRACTION: f64 = 0.99;

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
}

/// The iterated parameters: position, slope, blur and both paints.
#[derive(Clone, Copy)]
struct EdgeModel {
    at: f64,
    slope: f64,
    blur: f64,
    is_blur_known: bool,
    /// Whether the light varies along the edge, so that the profiles were scaled.
    is_shaded: bool,
    paints: [Paint; 2],
    /// The change of the paints by the levels near the edge, DN.
    moved: [f64; 2],
}

impl EdgeModel {
    /// Returns the distance of the level `index` of a profile behind the edge, px; negative before it.
    fn distance_behind_px(&self, profile: &Profile, index: usize) -> f64 {
        profile.first + index as f64 - self.at - self.slope * profile.along
    }

    /// Returns the level behind the edge minus that before it, at its middle, DN.
    fn contrast(&self) -> f64 {
        self.paints[1].level_at_edge(0.0) - self.paints[0].level_at_edge(0.0)
    }

    /// Returns the noise of a level near the edge, DN: the larger one of both sides.
    fn noise(&self) -> f64 {
        self.paints[0].noise.max(self.paints[1].noise)
    }

    /// Returns the weight of the paint of a side (0 before, 1 behind) relative to one level near the edge: the ratio of
    /// their variances.
    fn paint_weight(&self, side: usize) -> f64 {
        (self.noise() / self.paints[side].sigma).powi(2)
    }

    /// Returns residual and derivatives of the levels of a profile that place the edge: those near it.
    ///
    /// The model is a step blurred by a Gaussian. The derivatives are by position, slope, blur and the levels of both
    /// sides.
    fn core_residuals<'p>(&'p self, profile: &'p Profile) -> impl Iterator<Item = (f64, Vector)> + 'p {
        let reach = CORE_PX.max(CORE_SIGMAS * self.blur);
        let [before, after] = self.paints.map(|paint| paint.level_at_edge(profile.along));
        profile.levels.iter().enumerate().filter_map(move |(index, level)| {
            let behind = self.distance_behind_px(profile, index);
            if behind.abs() > reach {
                return None;
            }
            let (p, density) = normal_f64(behind / self.blur);
            let by_place = -(after - before) * density / self.blur;
            let by_blur = by_place * behind / self.blur;
            let residual = level - before - (after - before) * p;
            let derivatives = Vector::from([by_place, by_place * profile.along, by_blur, 1.0 - p, p]);
            Some((residual, derivatives))
        })
    }

    /// Returns the distance of the edge in one profile behind the common one, px, by one Gauss-Newton step.
    fn profile_shift(&self, profile: &Profile) -> f64 {
        let (mut right, mut normal) = (0.0, 0.0);
        for (residual, derivatives) in self.core_residuals(profile) {
            right += residual * derivatives[0];
            normal += derivatives[0] * derivatives[0];
        }
        right / normal.max(1e-9)
    }
}

type Vector = SVector<f64, 5>;
type Matrix = SMatrix<f64, 5, 5>;

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
    let paints = [Paint::default(); 2];
    let clean = expected.clean;
    let blur = clean.map_or(START_BLUR_PX, |clean| clean.blur_px);
    let mut model = EdgeModel {
        at: expected.near,
        slope: expected.slope,
        blur,
        is_blur_known: clean.is_some(),
        is_shaded: expected.light.is_some(),
        paints,
        moved: [0.0; 2],
    };
    model.paints = estimate_paints(&profiles, &model, expected)?;
    model.at = find_start(&profiles, &model);
    for fraction in OUTLIER_FRACTIONS {
        model.paints = estimate_paints(&profiles, &model, expected)?;
        reweigh(&mut profiles, &model, fraction);
        let kept = profiles.iter().filter(|profile| profile.weight > 0.0).count();
        if kept < MIN_PROFILES || (kept as f64) < MIN_PROFILE_FRACTION * profiles.len() as f64 {
            return Err(PointStatus::LowCorrelation);
        }
        model = solve_model(&profiles, model)?;
        if (model.at - expected.near).abs() > MAX_SHIFT_PX {
            return Err(PointStatus::Lost);
        }
    }
    edge_with_uncertainty(&profiles, &model)
}

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
fn estimate_paints(
    profiles: &[Profile],
    model: &EdgeModel,
    expected: &ExpectedEdge<'_>,
) -> Result<[Paint; 2], PointStatus> {
    let sign = expected.sign;
    let margin = PAINT_MARGIN_PX.max(PAINT_MARGIN_SIGMAS * model.blur);
    let sides = [-1.0, 1.0].map(|of| levels_beside(profiles, model, of, margin));
    if sides.iter().any(|levels| levels.len() < MIN_LEVELS) {
        return Err(PointStatus::OutOfFrame);
    }
    let mut sorted = [sides[0].levels.clone(), sides[1].levels.clone()];
    let mut side_quantile = |k: usize, fraction: f64| quantile(&mut sorted[k], fraction).unwrap_or(f64::NAN);
    // With sign 1 it is dark before the edge and light behind it.
    let start: [f64; 2] = std::array::from_fn(|k| {
        let is_light = (k == 1) == (sign > 0.0);
        side_quantile(k, if is_light { PAINT_QUANTILE } else { 1.0 - PAINT_QUANTILE })
    });
    let contrast = sign * (start[1] - start[0]);
    if contrast <= 0.0 {
        return Err(PointStatus::Lost);
    }
    let noise = [0, 1].map(|k| 0.7413 * (side_quantile(k, 0.75) - side_quantile(k, 0.25)));
    let tolerance = (PAINT_TOLERANCE * contrast).max(PAINT_SIGMAS * noise[0].min(noise[1]));
    let outward = |k: usize| if (k == 1) == (sign > 0.0) { 1.0 } else { -1.0 };
    let mut paints = [Paint::default(); 2];
    for (k, paint) in paints.iter_mut().enumerate() {
        *paint = fit_paint(&sides[k], start[k], tolerance, outward(k))?;
        if let Some(clean) = expected.clean.filter(|_| paint.is_speckled) {
            let other = clean.paints_dn[usize::from(outward(k) > 0.0)];
            let further = outward(k) * (other.value - paint.level_at_edge(0.0)) / contrast;
            // Speckles pull the observed paint towards the other side. Otherwise it is another paint.
            if SAME_PAINT_RANGE.contains(&further) {
                let sigma = other.sigma.hypot(SAME_PAINT_SIGMA * contrast);
                *paint = Paint { coefficients: [other.value, 0.0, 0.0, 0.0], sigma, ..*paint };
            } else {
                paint.sigma = paint.sigma.max(FREE_PAINT_SIGMA * contrast);
            }
        }
    }
    Ok(paints)
}

/// Returns the levels at least `margin` px from the edge, before it (`of` = -1) or behind it (`of` = 1).
fn levels_beside(profiles: &[Profile], model: &EdgeModel, of: f64, margin: f64) -> Levels {
    let mut beside = Levels::default();
    for profile in profiles {
        for (index, level) in profile.levels.iter().enumerate() {
            let behind = model.distance_behind_px(profile, index);
            if of * behind >= margin {
                beside.along.push(profile.along);
                beside.behind.push(behind);
                beside.levels.push(*level);
            }
        }
    }
    beside
}

/// Solves for position, slope, blur and the levels of both sides, which their paint constrains, by Gauss-Newton steps.
///
/// # Errors
///
/// [`PointStatus::Lost`] if the normal equations are singular.
fn solve_model(profiles: &[Profile], start: EdgeModel) -> Result<EdgeModel, PointStatus> {
    let mut model = start;
    model.moved = [0.0; 2];
    for _ in 0..MAX_STEPS {
        let (normal, mut right, _) = normal_equations(profiles, &model);
        for (k, moved) in model.moved.iter().enumerate() {
            // Previous changes already count against the paint.
            right[3 + k] -= moved * model.paint_weight(k);
        }
        let change = normal.try_inverse().ok_or(PointStatus::Lost)? * right;
        if !change.iter().all(|x| x.is_finite()) {
            return Err(PointStatus::Lost);
        }
        model.at += change[0].clamp(-1.0, 1.0);
        model.slope += change[1].clamp(-0.05, 0.05);
        model.blur = (model.blur + change[2].clamp(-0.4, 0.4)).clamp(BLUR_RANGE_PX[0], BLUR_RANGE_PX[1]);
        for k in 0..2 {
            model.moved[k] += change[3 + k];
            model.paints[k].coefficients[0] += change[3 + k];
        }
        if change[0].abs() < CONVERGED_PX && change[1].abs() < 0.1 * CONVERGED_PX {
            break;
        }
    }
    Ok(model)
}

/// Returns the normal equations at a model (matrix, right side), and the weighted sum of squared residuals, DN^2.
///
/// The unknowns are position, slope, blur, and the levels before and behind the edge, which their paint constrains.
fn normal_equations(profiles: &[Profile], model: &EdgeModel) -> (Matrix, Vector, f64) {
    let (mut normal, mut right, mut squares) = (Matrix::zeros(), Vector::zeros(), 0.0);
    for profile in profiles.iter().filter(|profile| profile.weight > 0.0) {
        for (residual, derivatives) in model.core_residuals(profile) {
            let weighted = derivatives * profile.weight;
            // The lower triangle; the matrix is symmetric.
            for column in 0..5 {
                for row in column..5 {
                    normal[(row, column)] += derivatives[row] * weighted[column];
                }
            }
            right += weighted * residual;
            squares += profile.weight * residual * residual;
        }
    }
    normal.fill_upper_triangle_with_lower_triangle();
    for k in 0..2 {
        normal[(3 + k, 3 + k)] += model.paint_weight(k);
    }
    if model.is_blur_known {
        normal[(2, 2)] += FIXED_WEIGHT * normal[(0, 0)];
    }
    (normal, right, squares)
}

/// Updates the weights of the profiles: zero for those with a residual above `fraction` of the contrast and above 3.5
/// sigmas of noise, and Tukey's biweight of their distance from the common line for the rest.
fn reweigh(profiles: &mut [Profile], model: &EdgeModel, fraction: f64) {
    let limit = (fraction * model.contrast().abs()).max(OUTLIER_SIGMAS * model.noise());
    let is_clean: Vec<bool> = profiles
        .iter()
        .map(|profile| model.core_residuals(profile).all(|(residual, _)| residual.abs() <= limit))
        .collect();
    let shifts: Vec<f64> = profiles.iter().map(|profile| model.profile_shift(profile)).collect();
    let of_clean = shifts.iter().zip(&is_clean).filter(|(_, clean)| **clean).map(|(shift, _)| *shift);
    let middle = quantile(&mut of_clean.clone().collect::<Vec<_>>(), 0.5).unwrap_or(0.0);
    let mut deviations: Vec<f64> = of_clean.map(|shift| (shift - middle).abs()).collect();
    // The median absolute deviation of a normal distribution is its standard deviation / 1.4826.
    let scatter = 1.4826 * quantile(&mut deviations, 0.5).unwrap_or(0.0);
    for ((profile, shift), clean) in profiles.iter_mut().zip(shifts).zip(is_clean) {
        let distance = (shift - middle) / (TUKEY * scatter.max(1e-4));
        let biweight = if clean && distance.abs() < 1.0 { (1.0 - distance * distance).powi(2) } else { 0.0 };
        profile.weight = profile.trust * biweight;
    }
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
            .filter(|profile| moved.core_residuals(profile).all(|(residual, _)| residual.abs() <= limit))
            .count()
    };
    let enough = (GOOD_PROFILE_FRACTION * profiles.len() as f64).max(MIN_PROFILES as f64) as usize;
    let tried = SHIFTS_PX.map(|shift| (likely(shift), shift));
    let best = tried.iter().fold((0, 0.0), |best, next| if next.0 > best.0 { *next } else { best });
    model.at + tried.iter().find(|(count, _)| *count >= enough).unwrap_or(&best).1
}

/// Returns the fitted edge with the uncertainties from the covariance of the fit.
///
/// The covariance is scaled by the reduced chi-square of the profiles where it exceeds 1. The error of the model is
/// added in quadrature.
///
/// # Errors
///
/// [`PointStatus::LowContrast`] if the edge is too faint or too blurred, [`PointStatus::Lost`] if the normal equations
/// are singular.
fn edge_with_uncertainty(profiles: &[Profile], model: &EdgeModel) -> Result<Edge, PointStatus> {
    let used: Vec<&Profile> = profiles.iter().filter(|profile| profile.weight > 0.0).collect();
    let (normal, _, squares) = normal_equations(profiles, model);
    let count: f64 = used.iter().map(|profile| profile.weight * model.core_residuals(profile).count() as f64).sum();
    // Five parameters are fitted.
    let variance = (squares / (count - 5.0).max(1.0)).max(1e-9);
    if model.contrast().abs() < MIN_CONTRAST_SIGMAS * variance.sqrt() || model.blur >= 0.98 * BLUR_RANGE_PX[1] {
        return Err(PointStatus::LowContrast);
    }
    let inverse = normal.try_inverse().ok_or(PointStatus::Lost)?;
    // Texture along the edge is not noise of single pixels, so the scatter of the profiles counts if it is larger.
    let chi2: f64 = used
        .iter()
        .map(|profile| {
            let information: f64 = model.core_residuals(profile).map(|(_, derivatives)| derivatives[0].powi(2)).sum();
            profile.weight * model.profile_shift(profile).powi(2) * information
        })
        .sum();
    let excess = (chi2 / variance / (used.len() as f64 - 2.0).max(1.0)).max(1.0);
    let levels = model.paints.map(|paint| paint.level_at_edge(0.0));
    let sigma = |k: usize| (variance * excess * inverse[(k, k)]).max(0.0).sqrt();
    let paint = |k: usize| Estimate { value: levels[k], sigma: sigma(3 + k) };
    let is_speckled = model.paints.iter().any(|paint| paint.is_speckled);
    let is_clipped = !model.is_shaded && is_clipped(profiles, levels[0].max(levels[1]) + model.noise());
    let model_px = match is_clipped {
        true => CLIPPED_SIGMA_PX,
        false if model.is_shaded => SHADED_SIGMA_PX
            .hypot(SHADING_FRACTION * shading_shift(model, &inverse))
            .hypot(sector_sigma(profiles, model)),
        false if is_speckled => SPECKLED_SIGMA_PX.hypot(SHADING_FRACTION * shading_shift(model, &inverse)),
        false => MODEL_SIGMA_PX,
    };
    Ok(Edge {
        at: Estimate { value: model.at, sigma: sigma(0).hypot(model_px) },
        slope: Estimate { value: model.slope, sigma: sigma(1) },
        blur_px: model.blur,
        paints_dn: if model.contrast() > 0.0 { [paint(0), paint(1)] } else { [paint(1), paint(0)] },
        is_speckled,
    })
}

/// Returns the uncertainty of the edge, px, by leaving out one sector of its profiles at a time.
///
/// An error of the light on the lighter side is common to neighbouring profiles, so their scatter does not show it. The
/// jackknife: B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, SIAM 1982, section 3.
fn sector_sigma(profiles: &[Profile], model: &EdgeModel) -> f64 {
    let shift = |sector: usize| {
        let others = profiles.iter().enumerate().filter(|(index, _)| index * SECTORS / profiles.len() != sector);
        let others: Vec<Profile> = others.map(|(_, profile)| profile.clone()).collect();
        solve_model(&others, *model).map(|found| found.at - model.at)
    };
    let squares: f64 = (0..SECTORS).filter_map(|sector| shift(sector).ok()).map(|shift| shift * shift).sum();
    ((SECTORS - 1) as f64 / SECTORS as f64 * squares).sqrt()
}

/// Returns the shift of the edge that comes with the change of its paints in the fit, px.
///
/// It is the error of the edge if the paints are as first estimated.
fn shading_shift(model: &EdgeModel, inverse: &Matrix) -> f64 {
    (0..2).map(|k| model.moved[k] * inverse[(0, 3 + k)] / inverse[(3 + k, 3 + k)]).sum()
}

/// Whether the image is saturated and paint of this level, DN, with its noise, reaches saturation.
fn is_clipped(profiles: &[Profile], paint_dn: f64) -> bool {
    let highest = profiles.iter().flat_map(|profile| &profile.levels).copied().fold(0.0, f64::max);
    is_saturated(highest as f32) && paint_dn > CLIPPED_FRACTION * highest
}

#[cfg(test)]
mod tests;
