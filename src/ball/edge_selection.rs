//! Selection of the bins that show the rim, and not speckle or an occluder.

use super::edge_fit::Edge;
use super::{Polarity, RimKind};
use crate::numeric::{MAX_COUNT, nth_highest, nth_smallest};

/// The minimum contrast of an edge, in units of the image noise.
const MIN_CONTRAST: f32 = 8.0;
/// The maximum distance of an edge from the circle, px; an edge farther off belongs to something else.
pub(super) const MAX_DISTANCE_PX: f32 = 2.5;
/// The number of bins among which contrasts are compared.
const NEIGHBOURS: usize = 41;
/// The number of bins from one comparison to the next.
const STRIDE: usize = 4;
/// The rank of the contrast that represents clean rim among them.
const CLEAN_RANK: f32 = 0.85;
/// The fraction of the clean contrast that an edge of a brighter ball must reach.
const CLEAN_FRACTION: f32 = 0.8;

/// The origin of the contrast that represents clean rim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CleanContrast {
    Estimated,
    Reused,
}

/// The edge selection with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct EdgeSelection {
    /// Whether each bin shows the rim.
    pub used: Vec<bool>,
    contrast: Vec<f32>,
    sorted: Vec<f32>,
    /// The contrasts, repeated before the first bin and after the last.
    around: Vec<f32>,
    clean: Vec<f32>,
    /// The number of bins with an edge of the rim's sign.
    pub same_sign: usize,
    /// The number of bins with an edge of the opposite sign.
    pub opposite_sign: usize,
    /// Whether bins are excluded by their contrast.
    pub excludes_speckle: bool,
}

impl EdgeSelection {
    /// Selects the bins to use; returns the noise of the image, grey levels.
    ///
    /// With [`CleanContrast::Reused`], `edges` must belong to the bins of the last call.
    pub fn select(&mut self, edges: &[Edge], polarity: Polarity, kind: RimKind, clean: CleanContrast) -> f32 {
        let noise = self.estimate_noise(edges);
        let sign = match polarity {
            Polarity::Brighter => 1.0,
            Polarity::Darker => -1.0,
        };
        self.contrast.clear();
        self.contrast.extend(edges.iter().map(|e| sign * e.contrast));
        self.used.clear();
        let contrast = &self.contrast;
        let min_contrast = MIN_CONTRAST * noise;
        let is_shaded = kind == RimKind::Shaded;
        let near = || edges.iter().zip(contrast).map(|(e, &c)| (c, e.shift.abs() < MAX_DISTANCE_PX));
        self.used.extend(near().map(|(c, is_near)| is_near && (c > min_contrast || (is_shaded && c < -min_contrast))));
        self.opposite_sign = near().map(|(c, is_near)| usize::from(c < -min_contrast && is_near)).sum();
        // On a darker ball, speckle and paint are both darker than the background and both good edges.
        // On a brighter one, the dark speckle has the wrong contrast or little of it.
        self.same_sign = self.used.iter().filter(|used| **used).count();
        self.excludes_speckle = polarity == Polarity::Brighter && kind == RimKind::Clean;
        if self.excludes_speckle {
            if clean == CleanContrast::Estimated || self.clean.len() != self.used.len().div_ceil(STRIDE) {
                self.estimate_clean_contrast();
            }
            self.exclude_speckle();
        }
        noise
    }

    /// Estimates the noise of the image, grey levels, at least 0.3, as the lower quartile of the residuals of the steps.
    ///
    /// Bins without texture show only noise. Returns infinity if no bin has an edge, so that none is used.
    fn estimate_noise(&mut self, edges: &[Edge]) -> f32 {
        self.sorted.clear();
        self.sorted.extend(edges.iter().filter(|e| e.contrast.abs() > 0.0).map(|e| e.rms));
        if self.sorted.is_empty() {
            return f32::INFINITY;
        }
        let rank = self.sorted.len() / 4;
        // Rounding to whole grey levels alone has a standard deviation of 1 / sqrt(12), about 0.3.
        nth_smallest(&mut self.sorted, rank).max(0.3)
    }

    /// Estimates the contrast of clean rim all around: a high quantile among the neighbouring bins, every fourth bin.
    fn estimate_clean_contrast(&mut self) {
        let bins = self.used.len();
        let reach = NEIGHBOURS.min(bins) / 2;
        // Unused bins rank below all others.
        self.around.clear();
        self.around.extend(
            (0..bins + 2 * reach)
                .map(|place| (place + bins - reach) % bins)
                .map(|bin| if self.used[bin] { self.contrast[bin] } else { f32::NEG_INFINITY }),
        );
        self.clean.clear();
        for first in (0..bins).step_by(STRIDE) {
            let mut near = [f32::NEG_INFINITY; MAX_COUNT];
            near[..=2 * reach].copy_from_slice(&self.around[first..=first + 2 * reach]);
            let count = near.iter().filter(|contrast| **contrast > f32::NEG_INFINITY).count();
            let rank = (count.saturating_sub(1) as f32 * CLEAN_RANK).round() as usize;
            self.clean.push(if count > 0 { nth_highest(&near, (count - rank) as u32) } else { 0.0 });
        }
    }

    /// Excludes the bins whose contrast is well below that of clean rim next to them.
    fn exclude_speckle(&mut self) {
        for bin in 0..self.used.len() {
            let nearest = ((bin + STRIDE / 2) / STRIDE) % self.clean.len();
            self.used[bin] &= self.contrast[bin] > CLEAN_FRACTION * self.clean[nearest];
        }
    }
}

const _: () = assert!(NEIGHBOURS <= MAX_COUNT);
