//! The coarse search of a ball by its texture: the disc that is more textured than its surroundings.
//!
//! It needs no edge along the rim. A ball is found whose paint and marks are brighter and darker than the background.

use super::annulus::maximum;
use super::pyramid::{GreyImage, blur};
use super::ransac::RoughCircle;
use crate::image::{ImageView, PixelRect};

/// The level below which differences do not count as texture, as a fraction of the highest level of the image.
const FLOOR_FRACTION: f32 = 0.03;
/// The number of cells per minimum radius.
const CELLS_PER_RADIUS: f64 = 6.0;
/// The number of radii tried within a range.
const RADII: usize = 8;
/// The outer limit of the disc, and the inner and outer limits of the ring around it, in radii.
const DISC: f64 = 0.95;
const RING: [f64; 2] = [1.05, 1.25];
/// The minimum part of the disc and of the ring that lies in the image.
const MIN_DISC: f64 = 0.6;
const MIN_RING: f64 = 0.3;
/// The distance of two discs, in radii, below which they count as one.
const DISTINCT_RADII: f64 = 0.3;
/// The number of discs returned.
const MAX_DISCS: usize = 3;

/// A range of radii, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RadiusRange {
    pub low: f64,
    pub high: f64,
}

/// The relative error of a radius that the scale and the diameter predict, or the frame before.
const RADIUS_TOLERANCE: f64 = 0.04;

impl RadiusRange {
    /// Returns the range about an expected radius.
    pub fn about(radius_px: f64) -> Self {
        Self { low: radius_px * (1.0 - RADIUS_TOLERANCE), high: radius_px * (1.0 + RADIUS_TOLERANCE) }
    }
}

/// The minimum side of a region that is searched by its texture, px.
pub(super) const MIN_SIDE_PX: usize = 16;

/// Computes the logarithm of the smoothed grey levels of a region.
///
/// Steps of reflectance are then equally high in light and in shadow.
pub(super) fn log_levels(image: ImageView<'_>, region: PixelRect, scratch: &mut [GreyImage; 2], out: &mut GreyImage) {
    let [raw, rows] = scratch;
    raw.copy_region(image, region);
    blur(raw, rows, out);
    let floor = (FLOOR_FRACTION * maximum(&out.data)).max(f32::MIN_POSITIVE);
    for level in &mut out.data {
        *level = (level.max(0.0) + floor).ln();
    }
}

/// The search with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct TextureDisc {
    /// The mean squared gradient of each cell, and its running sums along the rows.
    cells: Vec<f64>,
    sums: [Vec<f64>; 2],
    columns: usize,
    rows: usize,
    cell_px: usize,
}

/// A disc with the contrast of its texture.
#[derive(Debug, Clone, Copy)]
struct Disc {
    x: f64,
    y: f64,
    radius: f64,
    contrast: f64,
}

impl TextureDisc {
    /// Returns the discs with the highest contrast of texture to the ring around them, the best first.
    ///
    /// `levels` holds the logarithms of the grey levels. Centres are relative to it, and off by up to a cell.
    pub fn search(&mut self, levels: &GreyImage, radii: RadiusRange) -> Vec<RoughCircle> {
        self.cell_px = ((radii.low / CELLS_PER_RADIUS) as usize).max(1);
        self.measure(levels);
        let mut found: Vec<Disc> = Vec::new();
        for step in 0..RADII {
            let radius = radii.low * (radii.high / radii.low).powf(step as f64 / (RADII - 1) as f64);
            found.extend(self.best(radius));
        }
        found.sort_by(|a, b| b.contrast.total_cmp(&a.contrast));
        let mut kept: Vec<Disc> = Vec::new();
        for disc in found {
            let same = |other: &Disc| (other.x - disc.x).hypot(other.y - disc.y) < DISTINCT_RADII * other.radius;
            if kept.len() < MAX_DISCS && !kept.iter().any(same) {
                kept.push(disc);
            }
        }
        let cell = self.cell_px as f64;
        let pixel = |at: f64| ((at + 0.5) * cell - 0.5) as f32;
        kept.iter()
            .map(|disc| RoughCircle { x: pixel(disc.x), y: pixel(disc.y), radius: (disc.radius * cell) as f32 })
            .collect()
    }

    /// Computes the texture of every cell: the mean squared gradient.
    fn measure(&mut self, levels: &GreyImage) {
        let (width, cell) = (levels.width, self.cell_px);
        (self.columns, self.rows) = (width / cell, levels.height / cell);
        self.cells.clear();
        self.cells.resize(self.columns * self.rows, 0.0);
        for y in 1..levels.height.saturating_sub(1) {
            let row = y / cell;
            if row >= self.rows {
                break;
            }
            let line = |y: usize| &levels.data[y * width..(y + 1) * width];
            let (above, here, below) = (line(y - 1), line(y), line(y + 1));
            for x in 1..width - 1 {
                let column = x / cell;
                if column < self.columns {
                    let (dx, dy) = (here[x + 1] - here[x - 1], below[x] - above[x]);
                    self.cells[row * self.columns + column] += f64::from(dx * dx + dy * dy);
                }
            }
        }
        for (list, power) in self.sums.iter_mut().zip([1, 2]) {
            list.clear();
            for row in self.cells.chunks_exact(self.columns.max(1)) {
                let mut sum = 0.0;
                list.push(0.0);
                list.extend(row.iter().map(|cell| {
                    // The root of the energy: single strong edges count less than texture everywhere.
                    sum += cell.sqrt().powi(power);
                    sum
                }));
            }
        }
    }

    /// Returns the disc of this radius in px with the highest contrast; its values are in cells.
    fn best(&self, radius_px: f64) -> Option<Disc> {
        let radius_cells = radius_px / self.cell_px as f64;
        let (disc, ring) = (Spans::new(DISC * radius_cells), RING.map(|limit| Spans::new(limit * radius_cells)));
        let mut best: Option<Disc> = None;
        for y in 0..self.rows {
            for x in 0..self.columns {
                let [inner, hole, outer] = [&disc, &ring[0], &ring[1]].map(|spans| self.sum(spans, x, y));
                let around = outer.cells - hole.cells;
                if inner.cells < MIN_DISC * disc.cells || around < MIN_RING * (ring[1].cells - ring[0].cells) {
                    continue;
                }
                let contrast = (inner.texture / inner.cells - (outer.texture - hole.texture) / around)
                    / (inner.squares / inner.cells).sqrt().max(f64::MIN_POSITIVE);
                if best.is_none_or(|best| contrast > best.contrast) {
                    best = Some(Disc { x: x as f64, y: y as f64, radius: radius_cells, contrast });
                }
            }
        }
        best.filter(|best| best.contrast > 0.0)
    }

    /// Sums the texture of the cells of a disc around a cell.
    fn sum(&self, spans: &Spans, x: usize, y: usize) -> DiscSum {
        let mut sum = DiscSum::default();
        let reach = spans.half.len() as i64 - 1;
        for dy in -reach..=reach {
            let (row, half) = (y as i64 + dy, spans.half[dy.unsigned_abs() as usize] as i64);
            if !(0..self.rows as i64).contains(&row) {
                continue;
            }
            let from = (x as i64 - half).max(0) as usize;
            let to = (x as i64 + half + 1).min(self.columns as i64) as usize;
            let start = row as usize * (self.columns + 1);
            let [texture, squares] = [0, 1].map(|k: usize| self.sums[k][start + to] - self.sums[k][start + from]);
            sum.texture += texture;
            sum.squares += squares;
            sum.cells += (to - from) as f64;
        }
        sum
    }
}

/// The texture of the cells of a disc.
#[derive(Debug, Clone, Copy, Default)]
struct DiscSum {
    texture: f64,
    squares: f64,
    cells: f64,
}

/// The rows of a disc on the grid of cells.
#[derive(Debug)]
struct Spans {
    /// The half width of the row at each distance from the centre, cells.
    half: Vec<usize>,
    /// The number of cells of the disc.
    cells: f64,
}

impl Spans {
    /// Tabulates the rows of a disc on the grid of cells.
    fn new(radius_cells: f64) -> Self {
        let half: Vec<usize> = (0..=radius_cells as usize)
            .map(|dy| (radius_cells.powi(2) - (dy * dy) as f64).max(0.0).sqrt() as usize)
            .collect();
        let cells = half.iter().enumerate().map(|(dy, half)| if dy == 0 { 1 } else { 2 } * (2 * half + 1));
        Self { cells: cells.sum::<usize>() as f64, half }
    }
}
