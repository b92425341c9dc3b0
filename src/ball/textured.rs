//! The search of a ball by its texture, where no sign of its edges prevails along the rim.

use super::boundary::{Boundary, Found};
use super::pyramid::GreyImage;
use super::ransac::RoughCircle;
use super::texture_disc::{MIN_SIDE_PX, RadiusRange, TextureDisc, log_levels};
use crate::image::{ImageView, PixelRect};
use crate::results::Circle;

/// The maximum error of the centre of a textured disc, in radii.
const REACH_OF_DISC: f64 = 0.25;
/// The minimum reach of a search, px.
const REACH_PX: f64 = 5.0;
/// The maximum error of a known radius, px.
const RADIUS_REACH_PX: f64 = 5.0;
/// The maximum uncertainty of the centre, px.
const MAX_SIGMA_PX: f64 = 0.6;
/// The same for a ball below [`MIN_RADIUS_PX`], and the visible fraction that it must exceed.
const MAX_SMALL_SIGMA_PX: f64 = 0.4;
const MIN_SMALL_FRACTION: f64 = 0.8;
/// The minimum lead of the best score over that of another boundary, which is as far from it as this, sigmas.
const MIN_LEAD: f64 = 0.06;
const DISTINCT_SIGMAS: f64 = 3.0;
/// The minimum radius, px. The rays of a smaller ball are too few for a significant boundary, unless its radius is known.
const MIN_RADIUS_PX: f64 = 20.0;
const MIN_KNOWN_RADIUS_PX: f64 = 9.0;
/// The maximum ratio of the largest to the smallest radius of a ball whose radius is known.
const KNOWN_RATIO: f64 = 1.4;

/// The search with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct TexturedSearch {
    disc: TextureDisc,
    boundary: Boundary,
    levels: GreyImage,
    scratch: [GreyImage; 2],
}

impl TexturedSearch {
    /// Finds the ball in a region: the most certain one of the first range of radii that has any.
    pub fn find(&mut self, image: ImageView<'_>, region: PixelRect, ranges: &[RadiusRange]) -> Option<Circle> {
        let mut ranges = ranges.iter().filter(|radii| is_large_enough(radii)).peekable();
        if region.columns().len().min(region.rows().len()) < MIN_SIDE_PX || ranges.peek().is_none() {
            return None;
        }
        log_levels(image, region, &mut self.scratch, &mut self.levels);
        ranges.find_map(|radii| self.find_sized(image, region, *radii))
    }

    /// Finds the ball near a prediction within a few pixels, with the known radius.
    ///
    /// The image need not hold more than 20 px around it.
    pub fn follow(&mut self, image: ImageView<'_>, near: RoughCircle) -> Option<Circle> {
        let radius_px = f64::from(near.radius);
        let about = RadiusRange::about(radius_px);
        let radii = RadiusRange {
            low: about.low.max(radius_px - RADIUS_REACH_PX),
            high: about.high.min(radius_px + RADIUS_REACH_PX),
        };
        if !is_large_enough(&radii) {
            return None;
        }
        let first = self.boundary.find(image, near, radii, REACH_PX)?;
        let found = [Some(first), self.boundary.find(image, rough(&first.circle), radii, REACH_PX)];
        let found: Vec<Found> = found.into_iter().flatten().collect();
        certain(best(&found)?, &found)
    }

    fn find_sized(&mut self, image: ImageView<'_>, region: PixelRect, radii: RadiusRange) -> Option<Circle> {
        let reach_px = (REACH_OF_DISC * radii.high).max(REACH_PX);
        let mut found: Vec<Found> = Vec::new();
        for disc in self.disc.search(&self.levels, radii) {
            let near = RoughCircle { x: disc.x + region.left as f32, y: disc.y + region.top as f32, ..disc };
            found.extend(self.boundary.find(image, near, radii, reach_px));
        }
        let first = best(&found)?;
        // Rays from the centre of the ball show its rim best.
        found.extend(self.boundary.find(image, rough(&first.circle), radii, REACH_PX));
        certain(best(&found)?, &found)
    }
}

/// Whether the rays of the smallest ball in a range are enough.
fn is_large_enough(radii: &RadiusRange) -> bool {
    let is_known = radii.high <= KNOWN_RATIO * radii.low;
    radii.low >= if is_known { MIN_KNOWN_RADIUS_PX } else { MIN_RADIUS_PX }
}

/// Returns the boundary with the highest score.
fn best(found: &[Found]) -> Option<Found> {
    found.iter().copied().max_by(|a, b| a.score.total_cmp(&b.score))
}

fn rough(circle: &Circle) -> RoughCircle {
    RoughCircle { x: circle.x_px as f32, y: circle.y_px as f32, radius: circle.radius_px as f32 }
}

/// Returns the circle of a boundary, unless it is uncertain or another one is nearly as good.
fn certain(best: Found, all: &[Found]) -> Option<Circle> {
    let circle = best.circle;
    let rivals = all.iter().any(|other| {
        let apart_px = (other.circle.x_px - circle.x_px).hypot(other.circle.y_px - circle.y_px);
        let apart_px = apart_px.max((other.circle.radius_px - circle.radius_px).abs());
        other.score > best.score - MIN_LEAD && apart_px > DISTINCT_SIGMAS * circle.sigma_center_px
    });
    let is_small = circle.radius_px < MIN_RADIUS_PX;
    let max_sigma_px = if is_small { MAX_SMALL_SIGMA_PX } else { MAX_SIGMA_PX };
    let is_whole = !is_small || circle.visible_fraction > MIN_SMALL_FRACTION;
    (!rivals && is_whole && circle.sigma_center_px < max_sigma_px).then_some(circle)
}
