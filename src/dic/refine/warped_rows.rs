//! Rows of eight columns of a warped target.

use crate::dic::geometry::{Block, Pixel, Warp};
use crate::dic::image::{InterpolatedImage, ShiftedRows, Taps, lane_positions, sample_lanes, widened_weights};
use crate::numeric::{LANES, Lanes, Vector};

/// The maximum number of rows of a shifted tile.
const MAX_SHIFTED_ROWS: usize = LANES;

/// The maximum number of rows of a rotated tile.
const MAX_TURNED_ROWS: usize = 2 * LANES;

/// The largest strain that gradients correct within a tile. Pixels at its edge are displaced by a hundredth of a pixel.
const MAX_STRAIN: f64 = 0.02 / MAX_TURNED_ROWS as f64;

/// The largest slope of a row of a tile: less than one cell over its lanes.
const MAX_SLOPE: f64 = 0.12;

/// The rows of a block of the target, in order.
pub(in crate::dic) trait RowSampler<V> {
    /// Returns the levels of the next row. The gradients are those of the reference in that row.
    fn next(&mut self, gradient_x: V, gradient_y: V) -> V;
}

/// Stored samples, with the mean added that was subtracted when they were stored.
pub(in crate::dic) struct StoredRows<'a, V> {
    samples: std::slice::Iter<'a, Lanes>,
    mean: V,
}

impl<'a, V: Vector> StoredRows<'a, V> {
    /// Starts at the first of the stored rows of a block. `mean`, DN, is added to them.
    #[inline(always)]
    pub(in crate::dic) fn new(samples: &'a [Lanes], mean: f32) -> Self {
        Self { samples: samples.iter(), mean: V::splat(mean) }
    }
}

impl<V: Vector> RowSampler<V> for StoredRows<'_, V> {
    #[inline(always)]
    fn next(&mut self, _: V, _: V) -> V {
        self.samples.next().map_or(self.mean, |row| V::from_lanes(row).add(self.mean))
    }
}

/// A target and the warp of a subset about a centre.
#[derive(Clone, Copy)]
pub(in crate::dic) struct WarpedTarget<'a> {
    pub(in crate::dic) target: &'a InterpolatedImage,
    /// The subset's centre in the target before the warp.
    pub(in crate::dic) at: Pixel,
    pub(in crate::dic) warp: &'a Warp,
    /// The approximate gain of the target relative to the reference.
    pub(in crate::dic) gain: f32,
}

impl WarpedTarget<'_> {
    /// Returns the position in the target, px, of an offset from the subset's centre.
    #[inline(always)]
    pub(in crate::dic) fn position(&self, dx: f64, dy: f64) -> (f64, f64) {
        let (x, y) = self.warp.apply(dx, dy);
        (f64::from(self.at.x) + x, f64::from(self.at.y) + y)
    }
}

/// Returns the number of rows per tile of a block, at most `max_rows`, so that all tiles are of nearly equal size.
///
/// A last tile of a single row would cost as much as a whole one.
#[inline(always)]
fn tile_rows(block: &Block, max_rows: usize) -> usize {
    block.rows.div_ceil(block.rows.div_ceil(max_rows))
}

/// A block that is only shifted.
impl<V: Vector, const N: usize> RowSampler<V> for ShiftedRows<'_, V, N> {
    #[inline(always)]
    fn next(&mut self, _: V, _: V) -> V {
        self.next_row()
    }
}

/// A block in tiles, each shifted like its centre.
pub(in crate::dic) struct TiledRows<'a, V, const N: usize> {
    warped: WarpedTarget<'a>,
    dx: i32,
    dy: i32,
    rows: usize,
    remaining: usize,
    tile: ShiftedRows<'a, V, N>,
}

impl<'a, V: Vector, const N: usize> TiledRows<'a, V, N> {
    #[inline(always)]
    pub(in crate::dic) fn new(warped: WarpedTarget<'a>, block: &Block) -> Self {
        let rows = tile_rows(block, MAX_SHIFTED_ROWS);
        let tile = Self::start_tile(&warped, block.dx, block.dy, rows);
        Self { warped, dx: block.dx, dy: block.dy, rows, remaining: rows, tile }
    }

    /// Starts a tile of `rows` rows, the first at the offset (dx, dy), at the shift of its centre.
    #[inline(always)]
    fn start_tile(warped: &WarpedTarget<'a>, dx: i32, dy: i32, rows: usize) -> ShiftedRows<'a, V, N> {
        let middle = (0.5 * (LANES as f64 - 1.0), 0.5 * (rows as f64 - 1.0));
        let (x, y) = warped.position(f64::from(dx) + middle.0, f64::from(dy) + middle.1);
        ShiftedRows::new(warped.target, x - middle.0, y - middle.1)
    }
}

impl<V: Vector, const N: usize> RowSampler<V> for TiledRows<'_, V, N> {
    #[inline(always)]
    fn next(&mut self, _: V, _: V) -> V {
        if self.remaining == 0 {
            self.dy += self.rows as i32;
            self.remaining = self.rows;
            self.tile = Self::start_tile(&self.warped, self.dx, self.dy, self.rows);
        }
        self.remaining -= 1;
        self.tile.next_row()
    }
}

/// A rotated block in tiles. The lanes of a row share their weights along x, and the rows of a lane those along y.
///
/// Within a tile, rotation and strain displace pixels by a few thousandths of a pixel along a row in x and down a lane
/// in y. The gradients correct this.
pub(in crate::dic) struct RotatedRows<'a, V, const N: usize, const M: usize> {
    warped: WarpedTarget<'a>,
    dx: i32,
    dy: i32,
    rows: usize,
    /// The next row of the tile.
    row: usize,
    /// The index of the first tap of each row.
    first: [usize; MAX_TURNED_ROWS],
    /// The weights along x, of each tap for all rows.
    weights_x: [[f32; MAX_TURNED_ROWS]; N],
    /// The weights along y, of each tap for all lanes.
    weights_y: [V; M],
    /// Whether some lanes lie in a second cell along y.
    is_wide: bool,
    /// The displacement of the lanes from the position of their row's weights, px, times the gain.
    lane_shift: V,
}

impl<'a, V: Vector, const N: usize, const M: usize> RotatedRows<'a, V, N, M> {
    /// Whether a warp is nearly a rotation of a few degrees, so that tiles are accurate.
    #[inline(always)]
    pub(in crate::dic) fn applies_to(warp: &Warp) -> bool {
        warp.is_within(MAX_SLOPE) && warp.ux.abs() <= MAX_STRAIN && warp.vy.abs() <= MAX_STRAIN
    }

    /// Starts at the first row of a block. The warp must be one that [`Self::applies_to`].
    #[inline(always)]
    pub(in crate::dic) fn new(warped: WarpedTarget<'a>, block: &Block) -> Self {
        let across = V::from_lanes(&Lanes::INDEX).sub(V::splat(0.5 * (LANES as f32 - 1.0)));
        let mut column = Self {
            warped,
            dx: block.dx,
            dy: block.dy,
            rows: tile_rows(block, MAX_TURNED_ROWS),
            row: 0,
            first: [0; MAX_TURNED_ROWS],
            weights_x: [[0.0; MAX_TURNED_ROWS]; N],
            weights_y: [V::splat(0.0); M],
            is_wide: false,
            lane_shift: across.mul(V::splat(warped.gain * warped.warp.ux as f32)),
        };
        column.begin_tile();
        column
    }

    /// Computes the weights and first taps of the current tile.
    #[inline(always)]
    fn begin_tile(&mut self) {
        let WarpedTarget { target, warp, .. } = self.warped;
        let middle = (0.5 * (LANES as f64 - 1.0), 0.5 * (self.rows as f64 - 1.0));
        let (x, y) = self.warped.position(f64::from(self.dx) + middle.0, f64::from(self.dy) + middle.1);
        // The position of the first lane in the first row.
        let (x, y) = (x - middle.0 - middle.1 * warp.uy, y - middle.1 - middle.0 * warp.vx);
        let end_y = y + 2.0 * middle.0 * warp.vx;
        let cell_y = y.min(end_y).floor();
        let lanes = lane_positions::<V>(y - cell_y, warp.vx);
        // Slightly early: a lane that rounds up to 1 must find its second cell.
        self.is_wide = y.max(end_y) - cell_y >= 0.999_999;
        if self.is_wide {
            self.weights_y = widened_weights::<V, N, M>(target, lanes);
        } else {
            self.weights_y[..N].copy_from_slice(&target.lane_weights::<V, N>(lanes));
        }
        let mut fractions = [0.0; MAX_TURNED_ROWS];
        let (mut next, stride) = (target.first_tap::<N>(0, cell_y as isize) as isize, target.stride() as isize);
        for (row, (fraction, first)) in fractions.iter_mut().zip(&mut self.first).enumerate().take(self.rows) {
            let x = x + row as f64 * warp.uy;
            let cell_x = x.floor();
            *fraction = (x - cell_x) as f32;
            *first = (next + cell_x as isize) as usize;
            next += stride;
        }
        for rows in (0..self.rows).step_by(LANES) {
            let weights = target.lane_weights::<V, N>(V::load(&fractions[rows..]));
            for (to, from) in self.weights_x.iter_mut().zip(weights) {
                from.store(&mut to[rows..]);
            }
        }
    }
}

impl<V: Vector, const N: usize, const M: usize> RowSampler<V> for RotatedRows<'_, V, N, M> {
    #[inline(always)]
    fn next(&mut self, gradient_x: V, gradient_y: V) -> V {
        if self.row == self.rows {
            self.dy += self.rows as i32;
            self.row = 0;
            self.begin_tile();
        }
        let mut weights_x = [V::splat(0.0); N];
        for (weight, rows) in weights_x.iter_mut().zip(&self.weights_x) {
            *weight = V::splat(rows[self.row]);
        }
        let taps = Taps::starting_at(self.warped.target, self.first[self.row]);
        let value = match self.weights_y.first_chunk::<N>() {
            Some(weights_y) if !self.is_wide => taps.weighted_sum(&weights_x, weights_y),
            _ => taps.weighted_sum(&weights_x, &self.weights_y),
        };
        let down = self.warped.warp.vy as f32 * (self.row as f32 - 0.5 * (self.rows as f32 - 1.0));
        self.row += 1;
        value.plus_product(gradient_x, self.lane_shift).plus_product(gradient_y, V::splat(self.warped.gain * down))
    }
}

/// A deformed block: each pixel has its own weights.
pub(in crate::dic) struct WarpedRows<'a, const N: usize, const M: usize> {
    warped: WarpedTarget<'a>,
    dx: i32,
    dy: i32,
}

impl<'a, const N: usize, const M: usize> WarpedRows<'a, N, M> {
    #[inline(always)]
    pub(in crate::dic) fn new(warped: WarpedTarget<'a>, block: &Block) -> Self {
        Self { warped, dx: block.dx, dy: block.dy }
    }
}

impl<V: Vector, const N: usize, const M: usize> RowSampler<V> for WarpedRows<'_, N, M> {
    #[inline(always)]
    fn next(&mut self, _: V, _: V) -> V {
        let (x, y) = self.warped.position(f64::from(self.dx), f64::from(self.dy));
        self.dy += 1;
        sample_lanes::<V, N, M>(self.warped.target, x, y, self.warped.warp.ux, self.warped.warp.vx)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::image::{Interpolation, PreparedFrame};
    use crate::dic::tests::Speckle;
    use crate::numeric::Portable;

    /// Returns the rows of a block, sampled pixel by pixel and in rotated tiles, with the target's own gradients.
    fn both(target: &InterpolatedImage, warp: &Warp, block: &Block) -> [Vec<Lanes>; 2] {
        let warped = WarpedTarget { target, at: Pixel { x: 45, y: 45 }, warp, gain: 1.0 };
        let mut exact = WarpedRows::<6, 7>::new(warped, block);
        let mut turned = RotatedRows::<Portable, 6, 7>::new(warped, block);
        let rows = (0..block.rows as i32).map(|row| {
            let place = |lane: usize| warped.position(f64::from(block.dx) + lane as f64, f64::from(block.dy + row));
            let along = |dx: f64, dy: f64| {
                Lanes(std::array::from_fn(|lane| {
                    let (x, y) = place(lane);
                    2.0 * (target.value_at(x + dx, y + dy) - target.value_at(x - dx, y - dy))
                }))
            };
            let (along_x, along_y) = (Portable::from_lanes(&along(0.25, 0.0)), Portable::from_lanes(&along(0.0, 0.25)));
            let exact = RowSampler::<Portable>::next(&mut exact, along_x, along_y);
            (exact.to_lanes(), turned.next(along_x, along_y).to_lanes())
        });
        let (exact, turned) = rows.unzip();
        [exact, turned]
    }

    #[test]
    fn a_rotated_block_equals_sampling_pixel_by_pixel() {
        let mut prepared = PreparedFrame::default();
        prepared.fill(Speckle::standard(5, 90.0).draw(90, 90).view(), Interpolation::Optimised);
        let block = Block { dx: -9, dy: -21, rows: 43, start: 0 };
        for angle_deg in [-2.8, -1.1, -0.2, 0.03, 0.4, 1.7, 2.8_f64] {
            let warp = Warp::rigid(0.37 * angle_deg, -0.61, angle_deg.to_radians());
            assert!(RotatedRows::<Portable, 6, 7>::applies_to(&warp));
            let [exact, turned] = both(&prepared.interpolated, &warp, &block);
            let pairs = exact.iter().zip(&turned).flat_map(|(a, b)| a.0.into_iter().zip(b.0));
            let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 0.05, "{angle_deg} deg: {worst} DN");
        }
        for warp in [Warp::rigid(0.0, 0.0, 0.06), Warp { ux: 0.002, ..Warp::default() }] {
            assert!(!RotatedRows::<Portable, 6, 7>::applies_to(&warp));
        }
    }
}
