//! The change from one frame to another, tile by tile.

use crate::image::PixelFormat;
use crate::numeric::quantile;
use std::ops::Range;

/// Length of the shortest side of a tile, pixels, so that the noise of a tile is known within a tenth.
const TILE_PX: usize = 16;
/// Maximum number of tiles along a side.
const MAX_TILES: usize = 32;

/// A picture's division into tiles.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Tiles {
    columns: Vec<Range<usize>>,
    rows: Vec<Range<usize>>,
    width_px: usize,
    format: PixelFormat,
}

impl Tiles {
    /// Divides frames of this size and layout into tiles.
    pub(super) fn new(width_px: usize, height_px: usize, format: PixelFormat) -> Self {
        Self { columns: tile_ranges(width_px), rows: tile_ranges(height_px), width_px, format }
    }

    /// Returns the mean square of the difference of two frames of packed pixels in each tile, DN^2.
    pub(super) fn change(&self, before: &[u8], after: &[u8]) -> Change {
        if before == after {
            return Change { tiles: vec![0.0; self.columns.len() * self.rows.len()] };
        }
        let mut tiles = Vec::with_capacity(self.columns.len() * self.rows.len());
        for rows in &self.rows {
            for columns in &self.columns {
                let sum: u64 = rows.clone().map(|row| self.row_sum(before, after, row, columns)).sum();
                tiles.push(sum as f64 / (rows.len() * columns.len()) as f64);
            }
        }
        Change { tiles }
    }

    /// Sums the squared differences of two frames in these columns of a row, DN^2.
    fn row_sum(&self, before: &[u8], after: &[u8], row: usize, columns: &Range<usize>) -> u64 {
        let bytes = self.format.bytes_per_pixel();
        let at = (row * self.width_px + columns.start) * bytes..(row * self.width_px + columns.end) * bytes;
        let (before, after) = (&before[at.clone()], &after[at]);
        if bytes == 1 {
            let squares = before.iter().zip(after).map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2));
            return squares.map(u64::from).sum();
        }
        let level = |pair: &[u8]| u16::from_le_bytes([pair[0], pair[1]]);
        let pairs = before.chunks_exact(2).zip(after.chunks_exact(2));
        pairs.map(|(a, b)| u64::from(level(a).abs_diff(level(b))).pow(2)).sum()
    }
}

/// Divides a side of an image into the ranges of tiles, px: at most [`MAX_TILES`], of about the same length, at least
/// [`TILE_PX`] if the side is that long.
fn tile_ranges(side_px: usize) -> Vec<Range<usize>> {
    let count = (side_px / TILE_PX).clamp(1, MAX_TILES);
    (0..count).map(|tile| tile * side_px / count..(tile + 1) * side_px / count).collect()
}

/// The mean square of the difference of two frames in each tile, DN^2.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Change {
    tiles: Vec<f64>,
}

impl Change {
    /// Returns the largest change of a tile, DN^2: that of what moves.
    pub(super) fn peak(&self) -> f64 {
        self.tiles.iter().copied().fold(0.0, f64::max)
    }

    /// Returns the median change of a tile, DN^2: that of noise, where most of the picture is at rest.
    pub(super) fn floor(&self) -> f64 {
        quantile(&mut self.tiles.clone(), 0.5).unwrap_or_default()
    }

    /// Returns the sum of the tiles' changes above the floor, DN^2.
    pub(super) fn motion(&self) -> f64 {
        let floor = self.floor();
        self.tiles.iter().map(|tile| (tile - floor).max(0.0)).sum()
    }

    /// Returns the largest part of a frame that its neighbours do not explain, DN^2 per pixel of a tile.
    ///
    /// A frame that was blended of its neighbours lies on the line between them, and its distance from this line
    /// follows from the distances of the three frames. `self` leads to the frame, `next` away from it, and `across`
    /// leads from the one neighbour to the other.
    pub(super) fn own_part(&self, next: &Self, across: &Self) -> f64 {
        let tiles = self.tiles.iter().zip(&next.tiles).zip(&across.tiles);
        let distances = tiles.map(|((to, from), across)| {
            let along = if *across > 0.0 { ((to + across - from) / (2.0 * across)).clamp(0.0, 1.0) } else { 0.0 };
            // |F - A - along (B - A)|^2, from the three squared distances.
            (to * (1.0 - along) + from * along - across * along * (1.0 - along)).max(0.0)
        });
        distances.fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_found_in_its_tile() {
        let tiles = Tiles::new(40, 33, PixelFormat::Mono8);
        let before = vec![7; 40 * 33];
        let mut after = before.clone();
        after[20 * 40 + 30] = 107;
        let change = tiles.change(&before, &after);
        assert_eq!(change.tiles.len(), 4);
        assert_eq!(change.tiles[..3], [0.0; 3]);
        assert!((change.peak() - 1e4 / (20.0 * 17.0)).abs() < 1e-9);
        assert!(change.floor() < 1e-12);
    }

    #[test]
    fn a_blended_frame_has_no_part_of_its_own() {
        let tiles = Tiles::new(16, 16, PixelFormat::Mono16);
        let frame = |level: &dyn Fn(u32) -> u32| -> Vec<u8> {
            (0..256).flat_map(|at| (level(at) as u16).to_le_bytes()).collect()
        };
        let (first, last) = (|at: u32| at * 40 % 1000, |at: u32| at * 12 % 700);
        let blend = |at: u32| (3 * first(at) + last(at)) / 4;
        let other = |at: u32| at * 77 % 900;
        let [first, last, blend, other] = [frame(&first), frame(&last), frame(&blend), frame(&other)];
        let own = |between: &[u8]| {
            tiles.change(&first, between).own_part(&tiles.change(between, &last), &tiles.change(&first, &last))
        };
        assert!(own(&blend) < 1.0 && own(&other) > 1e3, "{} {}", own(&blend), own(&other));
    }
}
