//! A body that something hides in part: which of its pixels are in sight, and where they went.

use super::body::{BodyMotion, motion, status_of};
use super::lanes::Lanes;
use super::likeness::{Likeness, is_even};
use super::refine::{Match, Refiner};
use super::sigma::Pool;
use super::subset::Subset;
use super::veil::Veil;
use super::warp::Warp;
use super::window::Window;
use crate::results::PointStatus;

/// ZNCC from which on a match of all pixels was hardly misled by what hides some.
///
/// Below, the fit of gain and offset may have spread a strange half over all of the residual.
const WHOLE_ZNCC: f64 = 0.9;

/// Steps with the first mask, which a start some way off does not mislead.
const COARSE_ROUNDS: u32 = 4;

/// Rounds with the second mask at most; two or three settle it.
const FINE_ROUNDS: u32 = 8;

/// A round that moves the rim by less than this is the last, px: the next would move it by a twentieth of that.
const SETTLED_PX: f64 = 0.002;

/// Smallest share of a body in sight that it is found by.
const LEAST_SHARE: f64 = 0.15;

/// Smallest ZNCC of what is in sight that counts as found.
const LEAST_ZNCC: f64 = 0.6;

/// Noise of the difference of two frames is not taken for less: rounding alone leaves this, DN.
const LEAST_NOISE: f32 = 0.45;

/// What of a body is in sight, and memory to find out.
#[derive(Debug, Clone, Default)]
pub(super) struct Sight {
    likeness: Likeness,
    /// What was looked at last: the target, the mean of the reference taken off, and what the pixels in sight before left.
    samples: Vec<Lanes>,
    residual: Vec<Lanes>,
    /// 1 where a pixel is in sight, packed like the body's mask.
    kept: Vec<Lanes>,
    window: Window,
    subset: Subset,
    pool: Pool,
    /// The same as `kept`, up to what hides the others; empty where all are in sight.
    seen: Vec<Lanes>,
}

/// How pixels in sight are told.
#[derive(Clone, Copy, PartialEq)]
enum Mask {
    Zncc,
    Residual,
}

impl Sight {
    /// Makes it ready for a body of these pixels.
    pub(super) fn plan(&mut self, window: &Window) {
        self.likeness.plan(window);
        self.seen.clear();
    }

    /// Whether every pixel of the body looks as it should after a match of all of them, which left `residual`.
    pub(super) fn is_whole(&mut self, window: &Window, found: &Match, residual: &[Lanes]) -> bool {
        found.zncc >= WHOLE_ZNCC && self.likeness.is_whole(window, residual, LEAST_NOISE)
    }

    /// Finds what is in sight, from a start about 1 px and 1 deg off at most, or from a match of all pixels and what that
    /// left.
    pub(super) fn find(
        &mut self,
        body: &Refiner<'_>,
        start: Warp,
        (zncc, residual): (f64, &[Lanes]),
    ) -> Result<Match, PointStatus> {
        if !body.inside(&start) {
            return Err(PointStatus::OutOfFrame);
        }
        let mut warp = start;
        self.take_all(body);
        let coarse = if zncc < WHOLE_ZNCC { COARSE_ROUNDS } else { 0 };
        let (rim_px, last) = (f64::from(body.window.half), coarse + FINE_ROUNDS);
        let is_matched = coarse == 0 && !residual.is_empty();
        if is_matched {
            self.mask(body, residual, Mask::Residual);
            self.keep(body)?;
        }
        for round in 0..last {
            let noise = self.look(body, &warp, if round < coarse { Mask::Zncc } else { Mask::Residual });
            self.keep(body)?;
            let (step, zncc, gained) = self.refiner(body).step_from(body, &self.samples).map_err(status_of)?;
            let length = step.length(rim_px);
            if length.is_nan() || length >= rim_px {
                return Err(PointStatus::LowCorrelation);
            }
            warp = warp.after_inverse(&step).ok_or(PointStatus::LowCorrelation)?;
            if !body.inside(&warp) {
                return Err(PointStatus::OutOfFrame);
            }
            if (is_matched || round > coarse) && length < SETTLED_PX {
                let zncc = (zncc + gained).min(1.0);
                return self.sound(Match { warp, second: [[0.0; 3]; 2], zncc, iterations: round + 1 }, noise);
            }
        }
        let found = self.refiner(body).refine(warp).map_err(status_of)?;
        let noise = self.look(body, &found.warp, Mask::Residual);
        self.sound(found, noise)
    }

    /// A match, unless it went astray: the residual is no noise then, or a small part of the body fits by chance.
    fn sound(&self, found: Match, noise: f32) -> Result<Match, PointStatus> {
        let is_sound = found.zncc >= LEAST_ZNCC && is_even(&self.residual, noise, &self.kept);
        if is_sound { Ok(found) } else { Err(PointStatus::LowCorrelation) }
    }

    /// What a match by [`Self::find`] says of the body.
    pub(super) fn told(&mut self, body: &Refiner<'_>, found: &Match, offset: (f64, f64)) -> BodyMotion {
        let (mut pool, mut residual) = (std::mem::take(&mut self.pool), std::mem::take(&mut self.residual));
        pool.clear();
        pool.add_texture(&self.subset, &self.window);
        let refiner = self.refiner(body);
        // Before the last step, which hardly changes it.
        refiner.residual_from(body, &self.samples, &mut residual);
        let noise = self.likeness.noise(&residual, &self.kept).max(LEAST_NOISE);
        let pixels = self.likeness.in_sight(body.window, (&residual, noise), &self.kept, &mut self.seen);
        residual.iter_mut().zip(&self.window.mask).for_each(|(residual, mask)| *residual = *residual * *mask);
        let motion = motion(&self.refiner(body), found, offset, (&mut pool, &residual));
        (self.pool, self.residual) = (pool, residual);
        BodyMotion { motion, zncc: found.zncc, visible_fraction: pixels as f64 / body.window.pixels as f64 }
    }

    /// Forgets what hid the body before.
    pub(super) fn unveil(&mut self) {
        self.seen.clear();
    }

    /// What hides the body, of these pixels, as [`Self::told`] found it; `None` where nothing does.
    pub(super) fn veil(&self, window: &Window) -> Option<Veil> {
        (!self.seen.is_empty()).then(|| Veil::new(window, &self.seen))
    }

    /// Goes on with the pixels in sight alone, if they are enough.
    fn keep(&mut self, body: &Refiner<'_>) -> Result<(), PointStatus> {
        if (self.window.pixels as f64) < LEAST_SHARE * body.window.pixels as f64 {
            return Err(PointStatus::Occluded);
        }
        self.subset.keep(body.subset, &self.window, body.shape).map_err(|_| PointStatus::LowContrast)
    }

    /// Begins with everything in sight.
    fn take_all(&mut self, body: &Refiner<'_>) {
        self.window.clone_from(body.window);
        self.subset.clone_from(body.subset);
        self.kept.clone_from(&body.window.mask);
    }

    /// The pixels in sight, compared by the body and by what of it was in sight before.
    fn refiner<'a>(&'a self, body: &Refiner<'a>) -> Refiner<'a> {
        Refiner { subset: &self.subset, window: &self.window, ..*body }
    }

    /// Tells the pixels in sight at `warp`, gain and offset being those of the pixels in sight before; gives the noise of
    /// what these left, DN.
    fn look(&mut self, body: &Refiner<'_>, warp: &Warp, mask: Mask) -> f32 {
        let (mut samples, mut residual) = (std::mem::take(&mut self.samples), std::mem::take(&mut self.residual));
        match body.sampled(warp, &mut samples) {
            Ok(_) => self.refiner(body).residual_from(body, &samples, &mut residual),
            Err(_) => residual.clear(),
        }
        let noise = self.mask(body, &residual, mask);
        (self.samples, self.residual) = (samples, residual);
        noise
    }

    /// Tells the pixels in sight by what those in sight before left; gives the noise of that, DN.
    fn mask(&mut self, body: &Refiner<'_>, residual: &[Lanes], mask: Mask) -> f32 {
        let noise = self.likeness.noise(residual, &self.kept).max(LEAST_NOISE);
        match mask {
            Mask::Residual => self.likeness.by_residual(body.window, residual, noise, &mut self.kept),
            Mask::Zncc => self.likeness.by_zncc(body.window, (&body.subset.levels, residual), &mut self.kept),
        }
        body.window.keep(&self.kept, &mut self.window);
        noise
    }
}
