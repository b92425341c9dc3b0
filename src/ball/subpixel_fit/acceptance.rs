//! Acceptance of a fitted circle: whether its edges are the rim of a ball, and not texture or an occluder.

use super::{CERTAIN_INLIERS, MIN_SPECKLED_EDGES, SubpixelFit};
use crate::ball::RimKind;
use crate::ball::edge_selection;
use crate::ball::significance::evidence;
use crate::numeric::nth_smallest;

/// The blur up to which speckle at the rim pulls edges within these limits, px; the limits grow with larger blurs.
const SHARP_BLUR_PX: f32 = 0.9;
/// The minimum inlier fraction of a blurred rim with a larger scatter, since a textured background is blurred, too.
const MIN_INLIERS_BLURRED: f64 = 0.15;
/// The maximum distance of an inlier from the circle, px.
const INLIER_PX: f32 = 0.25;
/// The minimum number of inliers, plus a fraction of the rim inside the image.
///
/// These limits were set on 420 circles of balls in hard scenes and 2300 around texture, speckle and occluders
/// of all sizes: they accept 98 % of the former and none of the latter.
const MIN_INLIERS: f64 = 15.0;
const MIN_INLIER_FRACTION: f64 = 0.055;
/// The minimum inlier fraction of the used edges, and that for many inliers.
const MIN_INLIERS_OF_USED: f64 = 0.55;
const MIN_INLIERS_OF_USED_WHEN_MANY: f64 = 0.45;
const MANY_INLIERS: usize = 30;
/// The number of inliers below which the evidence against chance must reach a minimum, nats.
///
/// In 21 000 searches for balls of 6 to 20 px in speckled paint and texture, no false ball had as many inliers. Marks
/// pull three or four neighbouring edges alike, in blurred images more, and the search takes the best of many
/// circles. The three false balls with the most evidence had 31.0, 30.2 and 28.1 nats.
pub(super) const FEW_INLIERS: usize = 26;
const MIN_EVIDENCE_NATS: f64 = 31.0;
/// The maximum number of edges outside the circle: a distance, px, and a fraction of the inliers.
///
/// Marks at a rim pull its edges inwards. If more than this fraction lies farther out than this distance, those edges
/// are the rim and the circle lies inside the ball. Of 15 000 circles in hard scenes, such circles were off by up to
/// 8 px (80 sigmas). Of the others, 1 in 250 discs and 1 in 60 spheres had as many.
const MAX_OUTER: (f32, f64) = (0.4, 0.14);
const MAX_OUTER_OF_FEW: (f32, f64) = (0.4, 0.08);
const MAX_OUTER_SPECKLED: (f32, f64) = (1.0, 0.2);
/// The number of inliers below which fewer outer edges are allowed.
pub(super) const FEW_INLIERS_FOR_OUTER: usize = 40;
/// The maximum robust scatter of the used edges about the circle, px.
const MAX_SCATTER_PX: f64 = 0.28;
/// The factor of the maximum scatter at that inlier fraction, for speckle along the rest of the rim.
const CERTAIN_SCATTER_FACTOR: f64 = 1.5;
/// The maximum scatter of a speckled rim, px.
const MAX_SPECKLED_SCATTER_PX: f64 = 0.5;
/// The minimum number of inliers of a speckled rim.
const MIN_SPECKLED_INLIERS: usize = 45;
/// The maximum interquartile range of the levels outside a speckled rim, as a fraction of its contrast.
///
/// Circles in speckled paint have speckles outside, too.
const MAX_OUTSIDE_VARIATION: f32 = 0.2;
/// The minimum number of inliers of a shaded rim, as a fraction of the rim inside the image beyond [`MIN_INLIERS`], and as a
/// fraction of the used edges.
const MIN_SHADED_FRACTION: f64 = 0.2;
const MIN_SHADED_OF_USED: f64 = 0.55;

/// The edges that agree with a circle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Support {
    /// The number of edges on the circle.
    pub inliers: usize,
    /// The number of used edges.
    pub used: usize,
    /// The number of bins of the rim inside the image.
    pub inside: usize,
    /// The inliers as a fraction of these bins.
    pub inlier_fraction: f64,
    /// The blur relative to a sharp image, at least 1.
    pub blur_factor: f64,
    /// The factor of the scatter that a blurred rim may have.
    pub scatter_factor: f64,
}

impl SubpixelFit {
    /// Counts the edges that agree with the fitted circle; `blur` in px.
    pub(super) fn support(&self, blur: f32) -> Support {
        let inliers = self.fit.count_inliers(INLIER_PX);
        let inside = (0..self.rim.bins()).filter(|&bin| self.rim.count(bin) > 0).count().max(1);
        let used = self.selection.used.iter().filter(|used| **used).count();
        let inlier_fraction = inliers as f64 / inside as f64;
        let blur_factor = f64::from(blur / SHARP_BLUR_PX).max(1.0);
        let may_scatter = inliers >= MANY_INLIERS && inlier_fraction >= MIN_INLIERS_BLURRED;
        let scatter_factor = if may_scatter { blur_factor } else { 1.0 };
        Support { inliers, used, inside, inlier_fraction, blur_factor, scatter_factor }
    }

    /// Whether enough edges agree, scatter little about the circle, and few lie outside it.
    pub(super) fn is_rim(&self, support: &Support, scatter_px: f64) -> bool {
        let Support { inliers, used, inside, .. } = *support;
        let agrees = match self.fit.rim_kind {
            RimKind::Clean => {
                let is_certain = support.inlier_fraction > CERTAIN_INLIERS;
                let factor = if is_certain { CERTAIN_SCATTER_FACTOR } else { 1.0 } * support.scatter_factor;
                scatter_px <= MAX_SCATTER_PX * factor && self.is_beyond_chance(support)
            }
            RimKind::Speckled => {
                used as f64 > MIN_SPECKLED_EDGES * inside as f64
                    && inliers >= MIN_SPECKLED_INLIERS
                    && scatter_px < MAX_SPECKLED_SCATTER_PX
                    && self.is_uniform_outside()
            }
            RimKind::Shaded => {
                inliers as f64 >= MIN_INLIERS + MIN_SHADED_FRACTION * inside as f64
                    && inliers as f64 > MIN_SHADED_OF_USED * used as f64
                    && scatter_px <= MAX_SCATTER_PX
                    && self.is_beyond_chance(support)
            }
        };
        agrees && self.is_outermost(inliers)
    }

    /// Whether too many edges agree for a circle in texture.
    fn is_beyond_chance(&self, support: &Support) -> bool {
        let Support { inliers, used, inside, blur_factor, .. } = *support;
        let is_many = inliers >= MANY_INLIERS;
        let of_used = if is_many { MIN_INLIERS_OF_USED_WHEN_MANY } else { MIN_INLIERS_OF_USED };
        let enough = inliers as f64 >= MIN_INLIERS + MIN_INLIER_FRACTION * inside as f64
            && inliers as f64 > of_used * used as f64;
        // An edge of the opposite sign might as well have agreed.
        let nats = || {
            evidence(used + self.selection.opposite_sign, edge_selection::MAX_DISTANCE_PX, |within_px| {
                self.fit.count_inliers(within_px)
            })
        };
        enough && (inliers >= FEW_INLIERS || nats() > MIN_EVIDENCE_NATS * blur_factor)
    }

    /// Whether at most a small fraction of the edges lies outside the circle.
    fn is_outermost(&self, inliers: usize) -> bool {
        let (distance_px, max_fraction) = match inliers {
            _ if self.fit.rim_kind == RimKind::Speckled => MAX_OUTER_SPECKLED,
            ..FEW_INLIERS_FOR_OUTER => MAX_OUTER_OF_FEW,
            _ => MAX_OUTER,
        };
        self.fit.count_outer_edges(distance_px) as f64 <= max_fraction * inliers as f64
    }

    /// Whether the levels outside the rim are nearly uniform along it.
    fn is_uniform_outside(&self) -> bool {
        let trusted = || {
            self.edges
                .iter()
                .zip(&self.fit.robust_weight)
                .filter(|(_, robust_weight)| **robust_weight > 0.0)
                .map(|(edge, _)| edge)
        };
        let mut outside: Vec<f32> = trusted().map(|edge| edge.inside - edge.contrast).collect();
        let mut contrast: Vec<f32> = trusted().map(|edge| edge.contrast.abs()).collect();
        let Some(last) = outside.len().checked_sub(1) else { return false };
        let [low, high] = [last / 4, last * 3 / 4].map(|rank| nth_smallest(&mut outside, rank));
        (high - low) < MAX_OUTSIDE_VARIATION * nth_smallest(&mut contrast, last / 2)
    }
}
