//! The difference of an image from the ground of a scene, where the ground has hardly any structure.
//!
//! Marks that reach the rim of a ball, or a side without light, break its edge. What differs from the ground is the ball
//! nevertheless, without another frame to compare with.

use crate::image::{ImageView, PixelRect};
use crate::numeric::nth_smallest;
use crate::results::Circle;
use std::ops::Range;

/// The side of the tiles whose medians are the brightness of the ground, in largest radii. A ball covers at most 35 % of one.
const TILE_RADII: f64 = 3.0;
/// The minimum side of a tile, px.
const MIN_TILE_PX: usize = 24;

/// The side of the squares whose mean difference is compared, in smallest radii. It fits into every ball.
const SQUARE_RADII: f64 = 1.4;
/// The minimum mean difference in a ball, relative to the largest one in the image. Where something else differs more, such
/// as a surface, the ball may be a part of that, and a disc elsewhere its reflection.
const MIN_SHARE: f32 = 0.75;

/// The ground of a region, with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct PlainGround {
    /// The medians of the tiles, row by row, DN.
    medians: Vec<f32>,
    tile: Vec<f32>,
    difference: Vec<f32>,
    /// The sums of the absolute differences of all pixels above and to the left, one row and column more than the image.
    sums: Vec<f64>,
}

/// The tiles along one side of a region.
#[derive(Debug, Clone, Copy)]
struct Tiling {
    start: usize,
    side: f64,
    count: usize,
}

impl Tiling {
    /// Divides a length into tiles of about this side, all of one size, px.
    fn new(pixels: Range<usize>, side: usize) -> Self {
        let count = (pixels.len() / side).max(1);
        Self { start: pixels.start, side: pixels.len() as f64 / count as f64, count }
    }

    /// Returns the pixels of a tile.
    fn range(&self, tile: usize) -> Range<usize> {
        let edge = |tile: usize| self.start + (tile as f64 * self.side).round() as usize;
        edge(tile)..edge(tile + 1)
    }

    /// Returns the two tiles whose middles enclose a pixel, and the weight of the second.
    fn neighbours(&self, pixel: usize) -> ([usize; 2], f32) {
        let place = ((pixel - self.start) as f64 + 0.5) / self.side - 0.5;
        let place = place.clamp(0.0, (self.count - 1) as f64);
        let first = place as usize;
        ([first, (first + 1).min(self.count - 1)], (place - first as f64) as f32)
    }
}

impl PlainGround {
    /// Returns an image minus its ground in a region, DN; 0 outside of it. `max_radius_px` is that of the largest ball.
    pub(super) fn subtract(&mut self, image: ImageView<'_>, region: PixelRect, max_radius_px: f64) -> &[f32] {
        let side = ((TILE_RADII * max_radius_px) as usize).max(MIN_TILE_PX);
        let (columns, rows) = (Tiling::new(region.columns(), side), Tiling::new(region.rows(), side));
        self.medians.clear();
        for (row, column) in (0..rows.count).flat_map(|row| (0..columns.count).map(move |column| (row, column))) {
            self.tile.clear();
            let pixels = columns.range(column);
            rows.range(row).for_each(|y| self.tile.extend_from_slice(&image.row(y)[pixels.clone()]));
            let middle = self.tile.len() / 2;
            self.medians.push(nth_smallest(&mut self.tile, middle));
        }
        self.difference.clear();
        self.difference.resize(image.width() * image.height(), 0.0);
        for y in region.rows() {
            let ([above, below], down) = rows.neighbours(y);
            for x in region.columns() {
                let ([before, after], right) = columns.neighbours(x);
                let across = |row: usize| {
                    let at = |column: usize| self.medians[row * columns.count + column];
                    at(before) * (1.0 - right) + at(after) * right
                };
                let ground = across(above) * (1.0 - down) + across(below) * down;
                self.difference[y * image.width() + x] = image.row(y)[x] - ground;
            }
        }
        self.add_up(image.width());
        &self.difference
    }

    /// Whether no part of the image of the size of the smallest ball differs from the ground far more than a disc does.
    ///
    /// To be called after [`subtract`](Self::subtract) for an image of this width.
    pub(super) fn is_strongest(&self, circle: &Circle, width: usize, min_radius_px: f64) -> bool {
        let side = ((SQUARE_RADII * min_radius_px) as usize).max(1);
        let height = self.difference.len() / width;
        if side >= width.min(height) {
            return true;
        }
        let mean = |x: usize, y: usize| {
            let sum = |x: usize, y: usize| self.sums[y * (width + 1) + x];
            let total = sum(x + side, y + side) - sum(x, y + side) - sum(x + side, y) + sum(x, y);
            (total / (side * side) as f64) as f32
        };
        let step = (side / 2).max(1);
        let places =
            (0..height - side).step_by(step).flat_map(|y| (0..width - side).step_by(step).map(move |x| (x, y)));
        let strongest = places.map(|(x, y)| mean(x, y)).fold(0.0, f32::max);
        let corner = |center_px: f64, length: usize| {
            (center_px - 0.5 * side as f64).round().clamp(0.0, (length - side) as f64) as usize
        };
        mean(corner(circle.x_px, width), corner(circle.y_px, height)) >= MIN_SHARE * strongest
    }

    /// Adds up the absolute differences.
    fn add_up(&mut self, width: usize) {
        self.sums.clear();
        self.sums.resize((width + 1) * (self.difference.len() / width + 1), 0.0);
        for (y, row) in self.difference.chunks_exact(width).enumerate() {
            let mut sum = 0.0;
            for (x, value) in row.iter().enumerate() {
                sum += f64::from(value.abs());
                self.sums[(y + 1) * (width + 1) + x + 1] = self.sums[y * (width + 1) + x + 1] + sum;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_ground_and_a_disc_is_not() {
        let (width, height) = (160, 120);
        let is_disc = |x: usize, y: usize| (x as f64 - 70.0).hypot(y as f64 - 50.0) < 14.0;
        let level = |x: usize, y: usize| 0.3 * x as f32 + if is_disc(x, y) { 100.0 } else { 40.0 };
        let data: Vec<f32> = (0..width * height).map(|at| level(at % width, at / width)).collect();
        let image = ImageView::new(&data, width, height).unwrap();
        let mut ground = PlainGround::default();
        let difference = ground.subtract(image, PixelRect::from([8, 4, 144, 112]), 14.0);
        for (at, difference) in difference.iter().enumerate() {
            let (x, y) = (at % width, at / width);
            if (8..152).contains(&x) && (4..116).contains(&y) {
                let expected = if is_disc(x, y) { 60.0 } else { 0.0 };
                assert!((difference - expected).abs() < 10.0, "{x}, {y}: {difference}");
            } else {
                assert!(difference.abs() < 1e-6, "{x}, {y}: {difference}");
            }
        }
    }

    #[test]
    fn a_faint_disc_beside_a_strong_one_may_be_its_reflection() {
        let (width, height) = (160, 120);
        let is_in = |x: usize, y: usize, to: [f64; 2]| (x as f64 - to[0]).hypot(y as f64 - to[1]) < 14.0;
        let level = |x: usize, y: usize| match () {
            () if is_in(x, y, [50.0, 50.0]) => 100.0,
            () if is_in(x, y, [110.0, 60.0]) => 60.0,
            () => 40.0,
        };
        let data: Vec<f32> = (0..width * height).map(|at| level(at % width, at / width)).collect();
        let mut ground = PlainGround::default();
        ground.subtract(
            ImageView::new(&data, width, height).unwrap(),
            PixelRect::whole(width as u32, height as u32),
            14.0,
        );
        let circle = |x_px: f64, y_px: f64| Circle {
            x_px,
            y_px,
            radius_px: 14.0,
            sigma_center_px: 0.1,
            sigma_radius_px: 0.1,
            visible_fraction: 1.0,
        };
        assert!(ground.is_strongest(&circle(50.0, 50.0), width, 11.0));
        assert!(!ground.is_strongest(&circle(110.0, 60.0), width, 11.0));
    }
}
