//! The occluded pixels of a body as a summed-area table.

use crate::dic::geometry::{Point, Size, SubsetMask};
use crate::numeric::{LANES, Lanes};

/// The occluded pixels of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct OcclusionMap {
    /// The origin of the body's rectangle relative to its centre, px.
    left: i32,
    top: i32,
    width: usize,
    height: usize,
    /// The number of occluded pixels above and to the left of every corner between pixels.
    sums: Vec<u32>,
}

impl OcclusionMap {
    /// Builds the table of the body's pixels that are not `visible`: 1 where visible, packed like the mask.
    pub(in crate::dic) fn new(window: &SubsetMask, visible: &[Lanes]) -> Self {
        let Size { width, height } = window.extent.size();
        let (left, top) = (window.extent.left, window.extent.top);
        let stride = width + 1;
        let mut sums = vec![0_u32; stride * (height + 1)];
        for block in &window.blocks {
            let rows = block.start..block.start + block.rows;
            for ((dy, mask), visible) in (block.dy..).zip(&window.mask[rows.clone()]).zip(&visible[rows]) {
                for lane in (0..LANES).filter(|lane| mask.0[*lane] > 0.5 && visible.0[*lane] < 0.5) {
                    let (x, y) = (block.dx + lane as i32 - left, dy - top);
                    sums[(y as usize + 1) * stride + x as usize + 1] = 1;
                }
            }
        }
        for row in 1..=height {
            let mut along = 0;
            for corner in row * stride..(row + 1) * stride {
                along += sums[corner];
                sums[corner] = along + sums[corner - stride];
            }
        }
        Self { left, top, width, height, sums }
    }

    /// Returns the number of occluded pixels in an upright square of side `size_px` about a position, px from the
    /// body's centre. Pixels off the body do not count.
    pub fn occluded_pixels(&self, at: Point, size_px: u32) -> u32 {
        let Point { x_px: x, y_px: y } = at;
        let half = 0.5 * f64::from(size_px);
        let corner =
            |place: f64, first: i32, side: usize| (place + 0.5 - f64::from(first)).round().clamp(0.0, side as f64);
        let (left, right) = (corner(x - half, self.left, self.width), corner(x + half, self.left, self.width));
        let (top, bottom) = (corner(y - half, self.top, self.height), corner(y + half, self.top, self.height));
        let sum = |x: f64, y: f64| self.sums[y as usize * (self.width + 1) + x as usize];
        (sum(right, bottom) + sum(left, top)) - (sum(left, bottom) + sum(right, top))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_count_their_occluded_pixels() {
        let disc = |dx: i32, dy: i32| dx * dx + dy * dy <= 400;
        let window = SubsetMask::from_test(21, disc);
        // Everything right of the seventh column is occluded.
        let visible = SubsetMask::from_test(21, |dx, dy| disc(dx, dy) && dx <= 7);
        let mut packed = vec![Lanes::default(); window.mask.len()];
        for block in &window.blocks {
            let other = visible.blocks.iter().find(|other| other.dx == block.dx);
            for row in 0..block.rows {
                let own = other.and_then(|o| {
                    (block.dy + row as i32 - o.dy)
                        .try_into()
                        .ok()
                        .filter(|k: &usize| *k < o.rows)
                        .map(|k| visible.mask[o.start + k])
                });
                packed[block.start + row] = own.unwrap_or_default();
            }
        }
        let map = OcclusionMap::new(&window, &packed);
        let count = |x: i32, y: i32, half: i32| {
            let inside = |dx: i32, dy: i32| (dx - x).abs() <= half && (dy - y).abs() <= half;
            let all = (-25..=25).flat_map(|dx| (-25..=25).map(move |dy| (dx, dy)));
            all.filter(|(dx, dy)| disc(*dx, *dy) && *dx > 7 && inside(*dx, *dy)).count() as u32
        };
        for (x, y, half) in [(0, 0, 7), (0, 0, 8), (4, -6, 7), (11, 3, 5), (19, 0, 9), (30, 30, 4), (0, 0, 40)] {
            let counted = map.occluded_pixels(Point::new(f64::from(x) + 0.2, f64::from(y) - 0.3), 2 * half as u32 + 1);
            assert_eq!(counted, count(x, y, half), "{x} {y} {half}");
        }
    }
}
