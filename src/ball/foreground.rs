//! The parts of an image that moved before a still background: they differ from it by more than noise.
//!
//! A ball as bright as the background, or before a mottled one, has no rim of one sign. Its difference from the background
//! is zero outside the ball, whatever the background looks like.

use super::ransac::RoughCircle;
use super::texture_disc::RadiusRange;
use crate::image::{ImageView, PixelRect};
use crate::numeric::{SIGMA_PER_MEDIAN, nth_smallest};

/// The mean square of nine pixels from which they have changed, relative to the variance of the noise. Gaussian noise
/// exceeds it once in 10^10 pixels.
const MIN_CHANGE: f32 = 8.0;
/// The minimum noise of the difference, which rounding alone causes, DN.
const MIN_NOISE_DN: f32 = 0.5;
/// The side of the tiles in which the noise is estimated, in largest radii. The ball covers less than half of a tile.
const TILE_RADII: f64 = 3.0;
/// The minimum side of a tile, px.
const MIN_TILE_PX: usize = 24;
/// The area of a changed part relative to that of the smallest and of the largest ball. Parts of a ball may look like the
/// background, and its shadow may touch it.
const AREA: [f64; 2] = [0.4, 4.0];
/// The maximum number of changed parts that are examined, the largest first.
const MAX_PARTS: usize = 32;

/// The search of changed parts, with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct Foreground {
    /// The absolute differences.
    sizes: Vec<f32>,
    /// The sums of squares of three pixels of a row.
    rows: Vec<f32>,
    /// 1 where an unvisited pixel has changed, else 0.
    changed: Vec<u8>,
    tile: Vec<f32>,
    /// The noise of each tile, DN, and their arrangement.
    tiles: Tiles,
    stack: Vec<usize>,
}

/// A changed part of about the area of a ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChangedPart {
    /// Its centroid, and the radius of a disc of its area within the allowed range.
    pub circle: RoughCircle,
    /// The standard deviation of the noise around it, DN.
    pub noise_dn: f32,
}

/// The extent of a changed part.
#[derive(Debug, Clone, Copy, Default)]
struct Part {
    pixels: f64,
    x: f64,
    y: f64,
    noise_dn: f32,
}

/// The tiles of a region in which the noise is estimated, row by row.
#[derive(Debug, Default)]
struct Tiles {
    left: usize,
    top: usize,
    side: usize,
    columns: usize,
    noise_dn: Vec<f32>,
}

impl Tiles {
    /// Returns the noise around a pixel of the region, DN.
    fn noise_at(&self, x: usize, y: usize) -> f32 {
        let (column, row) = ((x - self.left) / self.side, (y - self.top) / self.side);
        self.noise_dn.get(row * self.columns + column).copied().unwrap_or(MIN_NOISE_DN)
    }
}

impl Foreground {
    /// Returns the absolute differences of the last [`search`](Self::search), in the order of the image.
    pub(super) fn sizes(&self) -> &[f32] {
        &self.sizes
    }

    /// Searches changed parts of about the area of a ball in a region, the largest first.
    ///
    /// `difference` is the image minus its background, DN.
    pub(super) fn search(
        &mut self,
        difference: ImageView<'_>,
        region: PixelRect,
        radii: RadiusRange,
    ) -> Vec<ChangedPart> {
        let (width, height) = (difference.width(), difference.height());
        self.sizes.clear();
        self.sizes.extend(difference.data().iter().map(|value| value.abs()));
        self.mark_changed(width, height, region, radii);
        let area = |radius: f64| std::f64::consts::PI * radius * radius;
        let allowed = AREA[0] * area(radii.low)..=AREA[1] * area(radii.high);
        let mut parts: Vec<Part> = Vec::new();
        for start in 0..self.changed.len() {
            if self.changed[start] == 1 {
                parts.push(self.take_part(start, width));
            }
        }
        parts.retain(|part| allowed.contains(&part.pixels));
        parts.sort_by(|a, b| b.pixels.total_cmp(&a.pixels));
        let circle = |part: &Part| RoughCircle {
            x: part.x as f32,
            y: part.y as f32,
            radius: (part.pixels / std::f64::consts::PI).sqrt().clamp(radii.low, radii.high) as f32,
        };
        let found = |part: Part| ChangedPart { circle: circle(&part), noise_dn: part.noise_dn };
        parts.into_iter().take(MAX_PARTS).map(found).collect()
    }

    /// Marks the pixels in a region whose neighbourhood of nine differs by more than noise.
    fn mark_changed(&mut self, width: usize, height: usize, region: PixelRect, radii: RadiusRange) {
        self.changed.clear();
        self.changed.resize(width * height, 0);
        self.rows.resize(width * height, 0.0);
        for (row, out) in self.sizes.chunks_exact(width).zip(self.rows.chunks_exact_mut(width)) {
            for (near, out) in row.windows(3).zip(&mut out[1..]) {
                *out = near[0] * near[0] + near[1] * near[1] + near[2] * near[2];
            }
        }
        let side = ((TILE_RADII * radii.high) as usize).max(MIN_TILE_PX);
        // Neighbourhoods lie within the image.
        let (left, right) = (region.columns().start.max(1), region.columns().end.min(width - 1));
        let (top, bottom) = (region.rows().start.max(1), region.rows().end.min(height - 1));
        self.tiles =
            Tiles { left, top, side, columns: right.saturating_sub(left).div_ceil(side), noise_dn: Vec::new() };
        for (y0, x0) in (top..bottom).step_by(side).flat_map(|y| (left..right).step_by(side).map(move |x| (y, x))) {
            let (y1, x1) = ((y0 + side).min(bottom), (x0 + side).min(right));
            self.tile.clear();
            (y0..y1).for_each(|y| self.tile.extend_from_slice(&self.sizes[y * width + x0..y * width + x1]));
            let middle = self.tile.len() / 2;
            let noise = (SIGMA_PER_MEDIAN as f32 * nth_smallest(&mut self.tile, middle)).max(MIN_NOISE_DN);
            self.tiles.noise_dn.push(noise);
            let limit = 9.0 * MIN_CHANGE * noise * noise;
            for y in y0..y1 {
                for at in y * width + x0..y * width + x1 {
                    let sum = self.rows[at - width] + self.rows[at] + self.rows[at + width];
                    self.changed[at] = u8::from(sum > limit);
                }
            }
        }
    }

    /// Returns the part that a changed pixel belongs to, and takes its pixels from the map.
    fn take_part(&mut self, start: usize, width: usize) -> Part {
        let mut part = Part::default();
        self.stack.clear();
        self.stack.push(start);
        self.changed[start] = 0;
        while let Some(at) = self.stack.pop() {
            part.pixels += 1.0;
            part.x += (at % width) as f64;
            part.y += (at / width) as f64;
            // The border of the image is never marked.
            for near in [at - 1, at + 1, at - width, at + width] {
                if self.changed[near] == 1 {
                    self.changed[near] = 0;
                    self.stack.push(near);
                }
            }
        }
        let noise_dn = self.tiles.noise_at(start % width, start / width);
        Part { x: part.x / part.pixels, y: part.y / part.pixels, noise_dn, ..part }
    }
}
