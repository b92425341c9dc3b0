//! Matching of a partly occluded body: determines its visible pixels and their motion together.

use super::light_field::LightField;
use super::motion::{BodyMotion, motion, status_of};
use super::occlusion_map::OcclusionMap;
use super::registration::RegistrationSample;
use super::sector_scatter::largest_share;
use super::visibility::{VisibilityMap, is_noise};
use crate::dic::geometry::{Point, SubsetMask, Warp};
use crate::dic::refine::{GaussNewtonStep, Match, Refiner};
use crate::dic::subset::ReferenceSubset;
use crate::dic::uncertainty::NoisePool;
use crate::numeric::Lanes;
use crate::results::PointStatus;

/// The ZNCC above which occlusion hardly biased a match of all pixels.
///
/// Below, the fit of gain and offset may have spread the occluder's residual over all pixels.
const MIN_WHOLE_ZNCC: f64 = 0.9;

/// The number of steps with the ZNCC mask, which tolerates an inaccurate start.
const ZNCC_ROUNDS: u32 = 4;

/// The maximum number of rounds with the residual mask; two or three are usual.
const RESIDUAL_ROUNDS: u32 = 8;

/// The displacement of the rim that ends the iteration, px. The next would be a twentieth of it.
const CONVERGED_PX: f64 = 0.002;

/// The minimum visible fraction of a body.
const MIN_VISIBLE_FRACTION: f64 = 0.15;

/// The minimum visible fraction of a body that need not match to within the noise.
const MIN_CHANGED_FRACTION: f64 = 0.5;

/// The minimum ZNCC of the visible pixels.
const MIN_ZNCC: f64 = 0.6;

/// The minimum noise of the difference of two frames, which rounding alone causes, DN.
const MIN_NOISE_DN: f32 = 0.45;

/// The visible pixels of a body, and memory to determine them.
#[derive(Debug, Clone, Default)]
pub(in crate::dic) struct OcclusionSearch {
    visibility: VisibilityMap,
    registration: RegistrationSample,
    /// The last samples of the target, minus the mean of the reference, and the last residual of the visible pixels.
    samples: Vec<Lanes>,
    residual: Vec<Lanes>,
    /// The last residual with its errors at sharp edges scaled down to the noise.
    even: Vec<Lanes>,
    /// 1 where a pixel is visible, packed like the body's mask.
    kept: Vec<Lanes>,
    window: SubsetMask,
    subset: ReferenceSubset,
    pool: NoisePool,
    /// The same as `kept`, extended to the edge of the occluder; empty if all pixels are visible.
    visible: Vec<Lanes>,
}

/// The criterion of visible pixels.
#[derive(Clone, Copy, PartialEq)]
enum Mask {
    Zncc,
    Residual,
}

/// Returns the gradients along x and y of all pixels of a body, packed.
fn gradients<'a>(body: &Refiner<'a>) -> [&'a [Lanes]; 2] {
    [&body.subset.gradient_x, &body.subset.gradient_y]
}

impl OcclusionSearch {
    /// Prepares for a body with the pixels of `window`, none of them occluded.
    pub(in crate::dic) fn plan(&mut self, window: &SubsetMask) {
        self.visibility.plan(window);
        self.visible.clear();
    }

    /// Whether a match of all pixels, with this residual, shows no sign of occlusion.
    pub(in crate::dic) fn is_unoccluded(&mut self, body: &Refiner<'_>, found: &Match, residual: &[Lanes]) -> bool {
        let window = body.window;
        if found.zncc < MIN_WHOLE_ZNCC {
            return false;
        }
        if self.visibility.is_unoccluded(window, residual, MIN_NOISE_DN) {
            return true;
        }
        // The noise may only be uneven.
        self.registration.flatten(gradients(body), residual, &window.mask, MIN_NOISE_DN, &mut self.even);
        self.visibility.is_unoccluded(window, &self.even, MIN_NOISE_DN)
    }

    /// Finds the visible pixels and their motion.
    ///
    /// The start is at most about 1 px and 1 deg off, or a match of all pixels with its ZNCC and residual. Without a
    /// match the ZNCC is 0 and the residual empty.
    ///
    /// # Errors
    ///
    /// [`PointStatus::OutOfFrame`], [`PointStatus::Occluded`] if less than 15 % is visible,
    /// [`PointStatus::LowContrast`] if the visible pixels have no texture, or [`PointStatus::LowCorrelation`] if they
    /// do not match.
    pub(in crate::dic) fn find(
        &mut self,
        body: &Refiner<'_>,
        start: Warp,
        zncc: f64,
        residual: &[Lanes],
    ) -> Result<Match, PointStatus> {
        if !body.is_inside(&start) {
            return Err(PointStatus::OutOfFrame);
        }
        let mut warp = start;
        self.reset(body);
        let coarse = if zncc < MIN_WHOLE_ZNCC { ZNCC_ROUNDS } else { 0 };
        let (rim_px, last) = (f64::from(body.window.half), coarse + RESIDUAL_ROUNDS);
        let is_matched = coarse == 0 && !residual.is_empty();
        if is_matched {
            self.update_mask(body, residual, Mask::Residual);
            self.restrict_to_visible(body)?;
        }
        for round in 0..last {
            let noise = self.update_visible(body, &warp, if round < coarse { Mask::Zncc } else { Mask::Residual });
            self.restrict_to_visible(body)?;
            let update = self.refiner(body).step_from(body, &self.samples).map_err(status_of)?;
            let GaussNewtonStep { step, zncc, zncc_gain } = update;
            let length = step.length(rim_px);
            if length.is_nan() || length >= rim_px {
                return Err(PointStatus::LowCorrelation);
            }
            warp = warp.after_inverse(&step).ok_or(PointStatus::LowCorrelation)?;
            if !body.is_inside(&warp) {
                return Err(PointStatus::OutOfFrame);
            }
            if (is_matched || round > coarse) && length < CONVERGED_PX {
                let zncc = (zncc + zncc_gain).min(1.0);
                return self.check_match(
                    body,
                    Match { warp, second: [[0.0; 3]; 2], zncc, iterations: round + 1 },
                    noise,
                );
            }
        }
        let found = self.refiner(body).refine(warp).map_err(status_of)?;
        if !body.is_inside(&found.warp) {
            return Err(PointStatus::OutOfFrame);
        }
        let noise = self.update_visible(body, &found.warp, Mask::Residual);
        self.check_match(body, found, noise)
    }

    /// Checks that the residual of a match is noise and its ZNCC high enough. Otherwise a small part of the body may
    /// fit by chance. `noise` is the standard deviation of the residual, DN.
    ///
    /// The residual need not be noise if at least half of the body is visible with a ZNCC of 0.9.
    ///
    /// # Errors
    ///
    /// [`PointStatus::LowCorrelation`] otherwise.
    fn check_match(&self, body: &Refiner<'_>, found: Match, noise: f32) -> Result<Match, PointStatus> {
        let is_most = self.window.pixels as f64 >= MIN_CHANGED_FRACTION * body.window.pixels as f64;
        // Changed shading, or background within a polygon, leave a residual that is no noise.
        let is_changed = is_most && found.zncc >= MIN_WHOLE_ZNCC;
        let is_sound = is_changed || (found.zncc >= MIN_ZNCC && is_noise(&self.even, noise, &self.kept));
        if is_sound { Ok(found) } else { Err(PointStatus::LowCorrelation) }
    }

    /// Computes the motion of the point at `offset`, px from the centre, its uncertainty and the visible fraction from
    /// the last match by [`Self::find`].
    ///
    /// # Errors
    ///
    /// [`PointStatus::LowContrast`] if the visible pixels have no contrast in the target, or that match has moved a part
    /// of the body out of the frame.
    pub(in crate::dic) fn body_motion(
        &mut self,
        body: &Refiner<'_>,
        found: &Match,
        offset: Point,
    ) -> Result<BodyMotion, PointStatus> {
        let (mut pool, mut residual) = (std::mem::take(&mut self.pool), std::mem::take(&mut self.residual));
        pool.clear();
        pool.add_texture(&self.subset, &self.window);
        let refiner = self.refiner(body);
        // The residual before the last step, which hardly changes it.
        refiner.residual_from(body, &self.samples, &mut residual);
        if residual.is_empty() {
            (self.pool, self.residual) = (pool, residual);
            return Err(PointStatus::LowContrast);
        }
        self.registration.flatten(gradients(body), &residual, &self.kept, MIN_NOISE_DN, &mut self.even);
        let noise = self.visibility.noise(&self.even, &self.kept).max(MIN_NOISE_DN);
        let pixels = self.visibility.mark_visible(body.window, &self.even, noise, &self.kept, &mut self.visible);
        residual.iter_mut().zip(&self.window.mask).for_each(|(residual, mask)| *residual = *residual * *mask);
        let field = LightField::new(&self.subset, &self.window);
        let light = field.and_then(|field| field.correction(&self.window, &residual));
        let moved = motion(&self.refiner(body), found, offset, &mut pool, &residual, light);
        (self.pool, self.residual) = (pool, residual);
        let visible_fraction = pixels as f64 / body.window.pixels as f64;
        let octant_share = largest_share(&self.subset, &self.window);
        Ok(BodyMotion { visible_fraction, octant_share, ..moved })
    }

    /// Clears the occlusion found in the last frame, so that [`Self::occlusion_map`] returns `None`.
    pub(in crate::dic) fn clear_occlusion(&mut self) {
        self.visible.clear();
    }

    /// Returns the occluded pixels of the body as found by the last match; `None` if there are none.
    pub(in crate::dic) fn occlusion_map(&self, window: &SubsetMask) -> Option<OcclusionMap> {
        (!self.visible.is_empty()).then(|| OcclusionMap::new(window, &self.visible))
    }

    /// Rebuilds the subset from the visible pixels.
    ///
    /// # Errors
    ///
    /// [`PointStatus::Occluded`] below 15 % visible, [`PointStatus::LowContrast`] if these pixels have no texture.
    fn restrict_to_visible(&mut self, body: &Refiner<'_>) -> Result<(), PointStatus> {
        if (self.window.pixels as f64) < MIN_VISIBLE_FRACTION * body.window.pixels as f64 {
            return Err(PointStatus::Occluded);
        }
        self.subset.restrict(body.subset, &self.window, body.shape).map_err(|_| PointStatus::LowContrast)
    }

    /// Makes all pixels of the body visible.
    fn reset(&mut self, body: &Refiner<'_>) {
        self.window.clone_from(body.window);
        self.subset.clone_from(body.subset);
        self.kept.clone_from(&body.window.mask);
    }

    /// Returns the refiner of the visible pixels.
    fn refiner<'a>(&'a self, body: &Refiner<'a>) -> Refiner<'a> {
        Refiner { subset: &self.subset, window: &self.window, ..*body }
    }

    /// Updates the visible pixels at `warp` and returns the noise of their residual, DN. Gain and offset are those of
    /// the previously visible pixels.
    fn update_visible(&mut self, body: &Refiner<'_>, warp: &Warp, criterion: Mask) -> f32 {
        let (mut samples, mut residual) = (std::mem::take(&mut self.samples), std::mem::take(&mut self.residual));
        match body.sample_target(warp, &mut samples) {
            Ok(_) => self.refiner(body).residual_from(body, &samples, &mut residual),
            Err(_) => residual.clear(),
        }
        let noise = self.update_mask(body, &residual, criterion);
        (self.samples, self.residual) = (samples, residual);
        noise
    }

    /// Updates the visible pixels from a residual, and returns the noise of the residual on the previously visible
    /// pixels, DN, at least [`MIN_NOISE_DN`].
    fn update_mask(&mut self, body: &Refiner<'_>, residual: &[Lanes], criterion: Mask) -> f32 {
        self.registration.flatten(gradients(body), residual, &self.kept, MIN_NOISE_DN, &mut self.even);
        let noise = self.visibility.noise(&self.even, &self.kept).max(MIN_NOISE_DN);
        match criterion {
            Mask::Residual => self.visibility.mask_by_residual(body.window, &self.even, noise, &mut self.kept),
            Mask::Zncc => self.visibility.mask_by_zncc(body.window, &body.subset.levels, residual, &mut self.kept),
        }
        body.window.restrict(&self.kept, &mut self.window);
        noise
    }
}
