//! The model of a straight edge, a step blurred by a Gaussian between two paints, and its fit to the levels near the edge.

use super::paint_levels::Paint;
use super::profiles::MIN_PROFILES;
use crate::image::is_saturated;
use crate::numeric::quantile;
use crate::results::{Estimate, PointStatus};
use nalgebra::{SMatrix, SVector};

/// The minimum fraction of the examined profiles.
const MIN_PROFILE_FRACTION: f64 = 0.12;
/// The relative weight that fixes a known parameter.
const FIXED_WEIGHT: f64 = 1e9;
/// The reach of the levels that place the edge: in px, and in standard deviations of the blur.
const CORE_PX: f64 = 2.0;
const CORE_SIGMAS: f64 = 2.2;
/// The residual from which a profile contains something else, in standard deviations.
const OUTLIER_SIGMAS: f64 = 3.5;
/// The minimum contrast of an edge, in standard deviations of the noise.
const MIN_CONTRAST_SIGMAS: f64 = 8.0;
/// The range of the blur, px; an edge at the upper end is too blurred to be placed.
const BLUR_RANGE_PX: [f64; 2] = [0.25, 1.8];
/// The maximum number of Gauss-Newton steps, and the change at which they have converged, px.
const MAX_STEPS: usize = 20;
const CONVERGED_PX: f64 = 1e-5;
/// The same from a start that is known to some hundredths of a pixel: the next step would be a tenth of this one.
const CLOSE_CONVERGED_PX: f64 = 1e-3;
/// The constant of Tukey's biweight.
const TUKEY: f64 = 4.685;
/// The uncertainty of an edge because of the model, common to all its profiles, px.
const MODEL_SIGMA_PX: f64 = 0.002;
/// The same for speckled paint, px, and the fraction of the shift by shading of the paint, which acts one way only.
const SPECKLED_SIGMA_PX: f64 = 0.005;
const SHADING_FRACTION: f64 = 0.5;
/// The same for light that varies across the rod, px: edges were off by 0.014 to 0.065 px rms in five simulated films.
const SHADED_SIGMA_PX: f64 = 0.05;
/// The same for clipped paint: an exposure up to three times too long moves edges towards the dark by up to 0.7 px, px.
const CLIPPED_SIGMA_PX: f64 = 0.5;
/// The fraction of the brightest level from which paint counts as clipped.
const CLIPPED_FRACTION: f64 = 0.99;

pub(super) type Vector = SVector<f64, 5>;
type Matrix = SMatrix<f64, 5, 5>;

/// The convergence of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Effort {
    /// From any start.
    Full,
    /// From a start that is known to some hundredths of a pixel.
    Close,
    /// One step, from such a start.
    Step,
}

/// The iterated parameters: position, slope, blur and both paints.
#[derive(Clone, Copy)]
pub(super) struct EdgeModel {
    pub(super) at: f64,
    pub(super) slope: f64,
    pub(super) blur: f64,
    pub(super) is_blur_known: bool,
    /// Whether the light varies along the edge, so that the profiles were scaled.
    pub(super) is_shaded: bool,
    pub(super) paints: [Paint; 2],
    /// The change of the paints by the levels near the edge, DN.
    pub(super) moved: [f64; 2],
}

/// A placed edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlacedEdge {
    /// The position across, at the middle, px.
    pub(super) at: Estimate,
    /// The slope: px across per px along.
    pub(super) slope: Estimate,
    /// The darker and the lighter paint, DN.
    pub(super) paints_dn: [Estimate; 2],
    /// The variance of the levels about the model, DN^2.
    pub(super) variance_dn2: f64,
}

/// The sums of the normal equations of the levels near an edge.
#[derive(Default)]
pub(super) struct CoreSums {
    /// The matrix: of the unknowns position, slope, blur, and the levels before and behind the edge.
    pub(super) normal: Matrix,
    pub(super) right: Vector,
    /// The weighted sum of squared residuals, DN^2.
    pub(super) squares: f64,
    /// The weighted number of levels.
    pub(super) count: f64,
}

/// The fit of one profile to the model.
#[derive(Clone, Copy)]
pub(super) struct ProfileFit {
    /// The distance of its edge behind the common one, px, by one Gauss-Newton step.
    pub(super) shift_px: f64,
    /// The sum of the squared derivatives of its levels by the position, (DN/px)^2.
    pub(super) information: f64,
    /// The largest residual, DN.
    pub(super) residual_dn: f64,
    /// The maximum weight, 0 to 1.
    pub(super) trust: f64,
}

/// The levels that place an edge: profiles along it, each with a weight.
pub(super) trait CoreLevels {
    /// Returns the sums over all profiles with a weight.
    fn sums(&self, model: &EdgeModel) -> CoreSums;

    /// Returns the fit of each profile.
    fn profile_fits(&self, model: &EdgeModel) -> Vec<ProfileFit>;

    /// Returns the weights of the profiles.
    fn weights(&self) -> Vec<f64>;

    /// Replaces the weights of the profiles.
    fn set_weights(&mut self, weights: &[f64]);

    /// Returns the highest level, DN.
    fn highest_dn(&self) -> f64;
}

impl EdgeModel {
    /// Returns the level behind the edge minus that before it, at its middle, DN.
    pub(super) fn contrast(&self) -> f64 {
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

    /// Returns the larger one of the differences in position and blur from another model, px.
    pub(super) fn distance_px(&self, other: &Self) -> f64 {
        (self.at - other.at).abs().max((self.blur - other.blur).abs())
    }

    /// Returns the maximum distance from the edge of the levels that place it, px.
    pub(super) fn reach_px(&self) -> f64 {
        CORE_PX.max(CORE_SIGMAS * self.blur)
    }

    /// Solves for position, slope, blur and the levels of both sides, which their paint constrains, by Gauss-Newton steps.
    ///
    /// # Errors
    ///
    /// [`PointStatus::Lost`] if the normal equations are singular.
    pub(super) fn solve(mut self, levels: &(impl CoreLevels + ?Sized), effort: Effort) -> Result<Self, PointStatus> {
        let (steps, converged_px) = match effort {
            Effort::Full => (MAX_STEPS, CONVERGED_PX),
            Effort::Close => (MAX_STEPS, CLOSE_CONVERGED_PX),
            Effort::Step => (1, CLOSE_CONVERGED_PX),
        };
        self.moved = [0.0; 2];
        for _ in 0..steps {
            let CoreSums { normal, mut right, .. } = self.constrained_sums(levels);
            for (k, moved) in self.moved.iter().enumerate() {
                // Previous changes already count against the paint.
                right[3 + k] -= moved * self.paint_weight(k);
            }
            let change = normal.try_inverse().ok_or(PointStatus::Lost)? * right;
            if !change.iter().all(|x| x.is_finite()) {
                return Err(PointStatus::Lost);
            }
            self.at += change[0].clamp(-1.0, 1.0);
            self.slope += change[1].clamp(-0.05, 0.05);
            self.blur = (self.blur + change[2].clamp(-0.4, 0.4)).clamp(BLUR_RANGE_PX[0], BLUR_RANGE_PX[1]);
            for k in 0..2 {
                self.moved[k] += change[3 + k];
                self.paints[k].coefficients[0] += change[3 + k];
            }
            if change[0].abs() < converged_px && change[1].abs() < 0.1 * converged_px {
                break;
            }
        }
        Ok(self)
    }

    /// Returns the sums over the levels near the edge, with the paints and a known blur as constraints.
    fn constrained_sums(&self, levels: &(impl CoreLevels + ?Sized)) -> CoreSums {
        let mut sums = levels.sums(self);
        for k in 0..2 {
            sums.normal[(3 + k, 3 + k)] += self.paint_weight(k);
        }
        if self.is_blur_known {
            sums.normal[(2, 2)] += FIXED_WEIGHT * sums.normal[(0, 0)];
        }
        sums
    }

    /// Updates the weights of the profiles: zero for those with a residual above `fraction` of the contrast and above 3.5
    /// sigmas of noise, and Tukey's biweight of their distance from the common line for the rest.
    ///
    /// # Errors
    ///
    /// [`PointStatus::LowCorrelation`] if too few profiles keep a weight.
    pub(super) fn reweigh(&self, levels: &mut (impl CoreLevels + ?Sized), fraction: f64) -> Result<(), PointStatus> {
        let limit = (fraction * self.contrast().abs()).max(OUTLIER_SIGMAS * self.noise());
        let fits = levels.profile_fits(self);
        let is_clean = |fit: &ProfileFit| fit.residual_dn <= limit;
        let mut shifts: Vec<f64> = fits.iter().filter(|fit| is_clean(fit)).map(|fit| fit.shift_px).collect();
        let middle = quantile(&mut shifts, 0.5).unwrap_or(0.0);
        shifts.iter_mut().for_each(|shift| *shift = (*shift - middle).abs());
        // The median absolute deviation of a normal distribution is its standard deviation / 1.4826.
        let scatter = 1.4826 * quantile(&mut shifts, 0.5).unwrap_or(0.0);
        let weight = |fit: &ProfileFit| {
            let distance = (fit.shift_px - middle) / (TUKEY * scatter.max(1e-4));
            let is_kept = is_clean(fit) && distance.abs() < 1.0;
            fit.trust * if is_kept { (1.0 - distance * distance).powi(2) } else { 0.0 }
        };
        let weights: Vec<f64> = fits.iter().map(weight).collect();
        levels.set_weights(&weights);
        let kept = weights.iter().filter(|weight| **weight > 0.0).count();
        let is_enough = kept >= MIN_PROFILES && kept as f64 >= MIN_PROFILE_FRACTION * fits.len() as f64;
        if is_enough { Ok(()) } else { Err(PointStatus::LowCorrelation) }
    }

    /// Returns the fitted edge with the uncertainties from the covariance of the fit.
    ///
    /// The covariance is scaled by the reduced chi-square of the profiles where it exceeds 1. The error of the model is
    /// added in quadrature, with `light_sigma_px` for varying light.
    ///
    /// # Errors
    ///
    /// [`PointStatus::LowContrast`] if the edge is too faint or too blurred, [`PointStatus::Lost`] if the normal
    /// equations are singular.
    pub(super) fn place(
        &self,
        levels: &(impl CoreLevels + ?Sized),
        light_sigma_px: f64,
    ) -> Result<PlacedEdge, PointStatus> {
        let CoreSums { normal, squares, count, .. } = self.constrained_sums(levels);
        // Five parameters are fitted.
        let variance = (squares / (count - 5.0).max(1.0)).max(1e-9);
        if self.contrast().abs() < MIN_CONTRAST_SIGMAS * variance.sqrt() || self.blur >= 0.98 * BLUR_RANGE_PX[1] {
            return Err(PointStatus::LowContrast);
        }
        let inverse = normal.try_inverse().ok_or(PointStatus::Lost)?;
        // Texture along the edge is not noise of single pixels, so the scatter of the profiles counts if it is larger.
        let (fits, weights) = (levels.profile_fits(self), levels.weights());
        let used = fits.iter().zip(&weights).filter(|(_, weight)| **weight > 0.0);
        let chi2: f64 = used.clone().map(|(fit, weight)| weight * fit.shift_px.powi(2) * fit.information).sum();
        let excess = (chi2 / variance / (used.count() as f64 - 2.0).max(1.0)).max(1.0);
        let on_paint = self.paints.map(|paint| paint.level_at_edge(0.0));
        let sigma = |k: usize| (variance * excess * inverse[(k, k)]).max(0.0).sqrt();
        let paint = |k: usize| Estimate { value: on_paint[k], sigma: sigma(3 + k) };
        let is_clipped =
            !self.is_shaded && is_clipped(levels.highest_dn(), on_paint[0].max(on_paint[1]) + self.noise());
        let shading_px = SHADING_FRACTION * self.shading_shift(&inverse);
        let model_px = match is_clipped {
            true => CLIPPED_SIGMA_PX,
            false if self.is_shaded => SHADED_SIGMA_PX.hypot(shading_px).hypot(light_sigma_px),
            false if self.is_speckled() => SPECKLED_SIGMA_PX.hypot(shading_px),
            false => MODEL_SIGMA_PX,
        };
        Ok(PlacedEdge {
            at: Estimate { value: self.at, sigma: sigma(0).hypot(model_px) },
            slope: Estimate { value: self.slope, sigma: sigma(1) },
            paints_dn: if self.contrast() > 0.0 { [paint(0), paint(1)] } else { [paint(1), paint(0)] },
            variance_dn2: variance,
        })
    }

    /// Whether there are speckles on one side.
    pub(super) fn is_speckled(&self) -> bool {
        self.paints.iter().any(|paint| paint.is_speckled)
    }

    /// Returns the shift of the edge that comes with the change of its paints in the fit, px.
    ///
    /// It is the error of the edge if the paints are as first estimated.
    fn shading_shift(&self, inverse: &Matrix) -> f64 {
        (0..2).map(|k| self.moved[k] * inverse[(0, 3 + k)] / inverse[(3 + k, 3 + k)]).sum()
    }
}

/// Whether the image is saturated at its highest level, DN, and paint of this level, DN, with its noise, reaches
/// saturation.
fn is_clipped(highest_dn: f64, paint_dn: f64) -> bool {
    is_saturated(highest_dn as f32) && paint_dn > CLIPPED_FRACTION * highest_dn
}
