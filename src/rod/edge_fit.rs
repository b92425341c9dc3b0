//! Subpixel fit of a straight edge: one blurred step through many profiles of grey levels.

use super::edge_model::{CoreSums, EdgeModel, Matrix, NormalEquations, ProfileFit};
use super::level_grid::{LevelGrid, Profile};
use super::paint_levels::Paint;
use super::profiles::{ExpectedEdge, MIN_PROFILES, read_profiles};
use super::side_paints::PaintEstimator;
use crate::image::{ImageView, is_saturated};
use crate::numeric::{SIGMA_PER_MEDIAN, quantile};
use crate::results::{Estimate, PointStatus};

/// The minimum fraction of the examined profiles.
const MIN_PROFILE_FRACTION: f64 = 0.12;
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

/// Fits the edge at its expected position: a step blurred by a Gaussian, with weights of the profiles by Tukey's
/// biweight in several rounds.
///
/// # Errors
///
/// [`PointStatus::OutOfFrame`] if it leaves the allowed range, [`PointStatus::Lost`] if there is none,
/// [`PointStatus::LowContrast`] if it is too faint or too blurred to be placed, and
/// [`PointStatus::LowCorrelation`] if its profiles do not agree.
pub(super) fn fit_step_edge(image: ImageView<'_>, expected: &ExpectedEdge<'_>) -> Result<Edge, PointStatus> {
    let grid = read_profiles(image, expected)?;
    let mut model = EdgeModel {
        at: expected.near,
        slope: expected.slope,
        blur: expected.clean.map_or(START_BLUR_PX, |clean| clean.blur_px),
        is_blur_known: expected.clean.is_some(),
        is_shaded: expected.light.is_some(),
        paints: [Paint::default(); 2],
        moved: [0.0; 2],
    };
    let mut paints = PaintEstimator::default();
    model.paints = paints.estimate(&grid, &model, expected)?;
    model.at = find_start(&grid, &model);
    let mut weights = Vec::new();
    for fraction in OUTLIER_FRACTIONS {
        model.paints = paints.estimate(&grid, &model, expected)?;
        let sums = model.sums(&grid);
        weights = profile_weights(&grid, &sums, &model, fraction);
        let kept = weights.iter().filter(|weight| **weight > 0.0).count();
        if kept < MIN_PROFILES || (kept as f64) < MIN_PROFILE_FRACTION * weights.len() as f64 {
            return Err(PointStatus::LowCorrelation);
        }
        model = solve_model(sums, &weights, model)?;
        if (model.at - expected.near).abs() > MAX_SHIFT_PX {
            return Err(PointStatus::Lost);
        }
    }
    edge_with_uncertainty(&grid, &weights, &model)
}

/// Solves for position, slope, blur and the levels of both sides, which their paint constrains, by Gauss-Newton steps.
///
/// `sums` are those at the start.
///
/// # Errors
///
/// [`PointStatus::Lost`] if the normal equations are singular.
fn solve_model(sums: CoreSums<'_>, weights: &[f64], start: EdgeModel) -> Result<EdgeModel, PointStatus> {
    let (grid, mut sums) = (sums.grid, Some(sums));
    let mut model = EdgeModel { moved: [0.0; 2], ..start };
    for _ in 0..MAX_STEPS {
        let sums = sums.take().unwrap_or_else(|| model.sums(grid));
        let NormalEquations { normal, mut right, .. } = sums.normal_equations(weights, &model);
        for (k, moved) in model.moved.iter().enumerate() {
            // Previous changes already count against the paint.
            right[3 + k] -= moved * model.paint_weight(k);
        }
        let change = normal.cholesky().ok_or(PointStatus::Lost)?.solve(&right);
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

/// Returns the weights of the profiles: zero for those with a residual above `fraction` of the contrast and above 3.5
/// sigmas of noise, and Tukey's biweight of their distance from the common line for the rest.
fn profile_weights(grid: &LevelGrid, sums: &CoreSums<'_>, model: &EdgeModel, fraction: f64) -> Vec<f64> {
    let limit = (fraction * model.contrast().abs()).max(OUTLIER_SIGMAS * model.noise());
    let fits = sums.profile_fits();
    let mut clean: Vec<f64> = fits.iter().filter(|fit| fit.worst_dn <= limit).map(|fit| fit.shift_px).collect();
    let middle = quantile(&mut clean, 0.5).unwrap_or(0.0);
    clean.iter_mut().for_each(|shift| *shift = (*shift - middle).abs());
    let scatter = SIGMA_PER_MEDIAN * quantile(&mut clean, 0.5).unwrap_or(0.0);
    let weight = |(fit, profile): (&ProfileFit, &Profile)| {
        let distance = (fit.shift_px - middle) / (TUKEY * scatter.max(1e-4));
        let is_clean = fit.worst_dn <= limit && distance.abs() < 1.0;
        if is_clean { profile.trust * (1.0 - distance * distance).powi(2) } else { 0.0 }
    };
    fits.iter().zip(&grid.profiles).map(weight).collect()
}

/// Returns the position across the edge, px, from which the fit starts, within 2 px of the model's.
///
/// It is the nearest one with enough plausible profiles, otherwise that with the most.
fn find_start(grid: &LevelGrid, model: &EdgeModel) -> f64 {
    const SHIFTS_PX: [f64; 9] = [0.0, -0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0];
    let limit = OUTLIER_FRACTIONS[0] * model.contrast().abs();
    let enough = (GOOD_PROFILE_FRACTION * grid.profiles.len() as f64).max(MIN_PROFILES as f64) as usize;
    let (mut best, mut most) = (model.at, 0);
    for shift in SHIFTS_PX {
        let moved = EdgeModel { at: model.at + shift, ..*model };
        let count = moved.sums(grid).count_within(limit);
        if count >= enough {
            return moved.at;
        }
        if count > most {
            (best, most) = (moved.at, count);
        }
    }
    best
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
fn edge_with_uncertainty(grid: &LevelGrid, weights: &[f64], model: &EdgeModel) -> Result<Edge, PointStatus> {
    let sums = model.sums(grid);
    let NormalEquations { normal, squares, count, .. } = sums.normal_equations(weights, model);
    // Five parameters are fitted.
    let variance = (squares / (count - 5.0).max(1.0)).max(1e-9);
    if model.contrast().abs() < MIN_CONTRAST_SIGMAS * variance.sqrt() || model.blur >= 0.98 * BLUR_RANGE_PX[1] {
        return Err(PointStatus::LowContrast);
    }
    let inverse = normal.try_inverse().ok_or(PointStatus::Lost)?;
    // Texture along the edge is not noise of single pixels, so the scatter of the profiles counts if it is larger.
    let fits = sums.profile_fits();
    let chi2: f64 = fits.iter().zip(weights).map(|(fit, weight)| weight * fit.shift_px.powi(2) * fit.information).sum();
    let used = weights.iter().filter(|weight| **weight > 0.0).count();
    let excess = (chi2 / variance / (used as f64 - 2.0).max(1.0)).max(1.0);
    let levels = model.paints.map(|paint| paint.level_at_edge(0.0));
    let sigma = |k: usize| (variance * excess * inverse[(k, k)]).max(0.0).sqrt();
    let paint = |k: usize| Estimate { value: levels[k], sigma: sigma(3 + k) };
    let is_speckled = model.paints.iter().any(|paint| paint.is_speckled);
    let is_clipped = !model.is_shaded && is_clipped(grid, levels[0].max(levels[1]) + model.noise());
    let model_px = match is_clipped {
        true => CLIPPED_SIGMA_PX,
        false if model.is_shaded => SHADED_SIGMA_PX
            .hypot(SHADING_FRACTION * shading_shift(model, &inverse))
            .hypot(sector_sigma(grid, weights, model)),
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
fn sector_sigma(grid: &LevelGrid, weights: &[f64], model: &EdgeModel) -> f64 {
    let shift = |sector: usize| {
        let is_left_out = |index: usize| index * SECTORS / weights.len() == sector;
        let others: Vec<f64> =
            weights.iter().enumerate().map(|(index, weight)| if is_left_out(index) { 0.0 } else { *weight }).collect();
        solve_model(model.sums(grid), &others, *model).map(|found| found.at - model.at)
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
fn is_clipped(grid: &LevelGrid, paint_dn: f64) -> bool {
    let highest = grid.highest_dn();
    is_saturated(highest) && paint_dn > CLIPPED_FRACTION * f64::from(highest)
}

#[cfg(test)]
mod tests;
