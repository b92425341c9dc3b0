//! Pixel masks of subsets, in blocks of eight columns.

use super::grid::GridPoint;
use super::point::{Pixel, Size};
use super::shape::WindowShape;
use super::warp::Warp;
use crate::numeric::{LANES, Lanes};

/// Eight neighbouring columns of a subset and the rows in which they have pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::dic) struct Block {
    /// The offset of the first column from the subset's centre, px.
    pub(in crate::dic) dx: i32,
    /// The offset of the first row from the subset's centre, px.
    pub(in crate::dic) dy: i32,
    /// The number of rows.
    pub(in crate::dic) rows: usize,
    /// The index of its first row among the rows of all blocks.
    pub(in crate::dic) start: usize,
}

/// The bounding box of a subset's pixels: first and last offsets from the centre, px.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(in crate::dic) struct Extent {
    pub(in crate::dic) left: i32,
    pub(in crate::dic) top: i32,
    pub(in crate::dic) right: i32,
    pub(in crate::dic) bottom: i32,
}

impl Extent {
    /// Returns the width and height in pixels, both ends included.
    pub(in crate::dic) fn size(&self) -> Size {
        let length = |first: i32, last: i32| (last - first + 1).max(0) as usize;
        Size { width: length(self.left, self.right), height: length(self.top, self.bottom) }
    }

    /// Whether the box lies wholly in an image of the size `image` when the subset's centre is at the pixel `at`.
    pub(in crate::dic) fn fits(&self, at: Pixel, image: Size) -> bool {
        let (x, y) = (at.x as isize, at.y as isize);
        x + self.left as isize >= 0
            && y + self.top as isize >= 0
            && x + (self.right as isize) < image.width as isize
            && y + (self.bottom as isize) < image.height as isize
    }
}

/// The pixels around a centre that belong to a subset.
#[derive(Debug, Clone, Default, PartialEq)]
pub(in crate::dic) struct SubsetMask {
    pub(in crate::dic) blocks: Vec<Block>,
    /// 1 where a pixel belongs, else 0; block by block, row by row.
    pub(in crate::dic) mask: Vec<Lanes>,
    /// The number of pixels that belong.
    pub(in crate::dic) pixels: usize,
    /// The largest offset of a pixel along x or y, px.
    pub(in crate::dic) half: u32,
    /// The bounding box of the pixels that belong.
    pub(in crate::dic) extent: Extent,
    /// The largest distance from the centre, px.
    radius: f64,
}

impl SubsetMask {
    /// Creates a subset of the given outline and full width.
    ///
    /// The disc extends half a pixel past the outermost centres. The ring leaves out the inner half of the disc's
    /// radius. `size_px` is odd; an even one gives the mask of the next odd number.
    pub(in crate::dic) fn new(shape: WindowShape, size_px: u32) -> Self {
        let half = size_px / 2;
        let outer = f64::from(half) + 0.5;
        Self::from_test(half, |dx, dy| {
            let radius = f64::from(dx * dx + dy * dy).sqrt();
            match shape {
                WindowShape::Square => true,
                WindowShape::Circle => radius <= outer,
                WindowShape::Ring => radius <= outer && radius > 0.5 * outer,
            }
        })
    }

    /// Creates a subset from the pixels at offsets of at most `half` px along x and y for which `belongs(dx, dy)`.
    pub(in crate::dic) fn from_test(half: u32, belongs: impl Fn(i32, i32) -> bool) -> Self {
        let reach = half as i32;
        let mut window =
            Self { blocks: Vec::new(), mask: Vec::new(), pixels: 0, half, radius: 0.0, extent: Extent::default() };
        // The square of the largest distance; half widths are below 10 000 px.
        let mut square = 0;
        for dx in (-reach..=reach).step_by(LANES) {
            let mut block = Block { dx, dy: 0, rows: 0, start: window.mask.len() };
            let mut used = block.start;
            for dy in -reach..=reach {
                let lane = |x: i32| if x <= reach && belongs(x, dy) { 1.0 } else { 0.0 };
                let row = Lanes(std::array::from_fn(|k| lane(dx + k as i32)));
                let pixels = row.0.iter().sum::<f32>() as usize;
                if let Some((first, last)) = first_and_last_lane(&row) {
                    let farthest = (dx + first).abs().max((dx + last).abs());
                    square = square.max(farthest * farthest + dy * dy);
                }
                if pixels > 0 && used == block.start {
                    block.dy = dy;
                }
                // Empty rows before the first pixel are skipped, and those after the last removed.
                if pixels > 0 || used > block.start {
                    window.mask.push(row);
                }
                if pixels > 0 {
                    used = window.mask.len();
                }
                window.pixels += pixels;
            }
            window.mask.truncate(used);
            block.rows = used - block.start;
            if block.rows > 0 {
                window.blocks.push(block);
            }
        }
        window.radius = f64::from(square).sqrt();
        window.update_extent();
        window
    }

    /// Updates the bounding box from the mask; all zero if no pixel belongs.
    fn update_extent(&mut self) {
        let mut extent = Extent { left: i32::MAX, top: i32::MAX, right: i32::MIN, bottom: i32::MIN };
        for block in &self.blocks {
            for (dy, row) in (block.dy..).zip(&self.mask[block.start..block.start + block.rows]) {
                let Some((first, last)) = first_and_last_lane(row) else { continue };
                extent.left = extent.left.min(block.dx + first);
                extent.right = extent.right.max(block.dx + last);
                extent.top = extent.top.min(dy);
                extent.bottom = extent.bottom.max(dy);
            }
        }
        self.extent = if self.pixels > 0 { extent } else { Extent::default() };
    }

    /// Returns the first and last column of the subset in each of the `rows` rows of an image when its centre is at
    /// `at`.
    ///
    /// In rows without a pixel the first column is larger than the last.
    ///
    /// # Panics
    ///
    /// If a pixel lies above or below the image.
    pub(in crate::dic) fn row_spans(&self, at: Pixel, rows: usize) -> Vec<(i32, i32)> {
        let mut spans = vec![(i32::MAX, i32::MIN); rows];
        for block in &self.blocks {
            let mask = &self.mask[block.start..block.start + block.rows];
            for (dy, mask) in (block.dy..).zip(mask) {
                let Some((first, last)) = first_and_last_lane(mask) else { continue };
                let (left, right) = &mut spans[(at.y + dy) as usize];
                let x = at.x + block.dx;
                (*left, *right) = ((*left).min(x + first), (*right).max(x + last));
            }
        }
        spans
    }

    /// Copies the subset to `out` without the pixels at offsets (dx, dy) for which `belongs` is false, and returns
    /// whether any were removed.
    ///
    /// Empty rows at the ends of a block are dropped, so that nothing far outside is read.
    pub(in crate::dic) fn clip(&self, belongs: impl Fn(i32, i32) -> bool, out: &mut Self) -> bool {
        out.blocks.clear();
        out.mask.clear();
        (out.pixels, out.half, out.radius) = (0, self.half, self.radius);
        for block in &self.blocks {
            let start = out.mask.len();
            let mut first = None;
            let mut end = start;
            for (dy, mask) in (block.dy..).zip(&self.mask[block.start..block.start + block.rows]) {
                let mut row = *mask;
                for (dx, value) in (block.dx..).zip(&mut row.0).filter(|(_, value)| **value > 0.5) {
                    *value = if belongs(dx, dy) { 1.0 } else { 0.0 };
                }
                let pixels = row.0.iter().filter(|value| **value > 0.5).count();
                out.pixels += pixels;
                if pixels > 0 || first.is_some() {
                    first.get_or_insert(dy);
                    out.mask.push(row);
                }
                if pixels > 0 {
                    end = out.mask.len();
                }
            }
            out.mask.truncate(end);
            if let Some(dy) = first {
                out.blocks.push(Block { dx: block.dx, dy, rows: end - start, start });
            }
        }
        out.update_extent();
        out.pixels < self.pixels
    }

    /// Copies the subset to `out` without the pixels where `kept`, packed like [`Self::mask`], is 0. The blocks and the
    /// bounding box stay the same.
    ///
    /// All rows of the blocks are read, so the whole rectangle must stay in the image.
    pub(in crate::dic) fn restrict(&self, kept: &[Lanes], out: &mut Self) {
        out.blocks.clone_from(&self.blocks);
        out.mask.clear();
        out.mask.extend(self.mask.iter().zip(kept).map(|(mask, kept)| *mask * *kept));
        (out.half, out.radius) = (self.half, self.radius);
        out.pixels = out.mask.iter().map(|row| row.0.iter().filter(|value| **value > 0.5).count()).sum();
        out.extent = self.extent;
    }

    /// Whether the mask contains all pixels of the square of side 2 `half` + 1.
    pub(in crate::dic) fn is_square(&self) -> bool {
        self.pixels == (2 * self.half as usize + 1).pow(2)
    }

    /// Returns the bounding box of the subset centred at a point: left, top, right and bottom, px in the image.
    pub(in crate::dic) fn bounds_about(&self, point: GridPoint) -> [f64; 4] {
        let Extent { left, top, right, bottom } = self.extent;
        let (x, y) = (f64::from(point.x), f64::from(point.y));
        [x + f64::from(left), y + f64::from(top), x + f64::from(right), y + f64::from(bottom)]
    }

    /// Whether the pixel at the offset (dx, dy) from the centre belongs to the subset.
    pub(in crate::dic) fn contains(&self, dx: i32, dy: i32) -> bool {
        let block = self.blocks.iter().find(|block| (block.dx..block.dx + LANES as i32).contains(&dx));
        block.is_some_and(|block| {
            let row = dy - block.dy;
            (0..block.rows as i32).contains(&row)
                && self.mask[block.start + row as usize].0[(dx - block.dx) as usize] > 0.5
        })
    }

    /// Whether the bounds of the subset, centred at `at` and moved by `warp`, lie in an image of the size `image`.
    ///
    /// See [`Self::warped_bounds`]. False for a warp with NaN.
    pub(in crate::dic) fn fits_warped(&self, warp: &Warp, at: Pixel, image: Size) -> bool {
        let [left, top, right, bottom] = self.warped_bounds(warp);
        let (x, y) = (f64::from(at.x), f64::from(at.y));
        let (width, height) = (image.width as f64, image.height as f64);
        // Written so that NaN is outside.
        x + left >= 0.0 && x + right <= width - 1.0 && y + top >= 0.0 && y + bottom <= height - 1.0
    }

    /// Returns a bounding box of the warped subset relative to the centre before the warp: left, top, right, bottom,
    /// px.
    ///
    /// It is the smaller, along each side, of the warped rectangle's box and that of the warped circumscribed circle.
    pub(in crate::dic) fn warped_bounds(&self, warp: &Warp) -> [f64; 4] {
        let Extent { left, top, right, bottom } = self.extent;
        let along = |shift: f64, a: f64, b: f64| {
            let (across, down) =
                ((a * f64::from(left), a * f64::from(right)), (b * f64::from(top), b * f64::from(bottom)));
            let radius = self.radius * a.hypot(b);
            let low = (across.0.min(across.1) + down.0.min(down.1)).max(-radius);
            let high = (across.0.max(across.1) + down.0.max(down.1)).min(radius);
            (shift + low, shift + high)
        };
        let (x, y) = (along(warp.u, 1.0 + warp.ux, warp.uy), along(warp.v, warp.vx, 1.0 + warp.vy));
        [x.0, y.0, x.1, y.1]
    }
}

/// Returns the indices (0 to 7) of the first and last lane that belong; `None` if no lane does.
fn first_and_last_lane(mask: &Lanes) -> Option<(i32, i32)> {
    let first = mask.0.iter().position(|value| *value > 0.5)?;
    let last = mask.0.iter().rposition(|value| *value > 0.5)?;
    Some((first as i32, last as i32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_hold_the_pixels_of_their_outline() {
        assert_eq!(SubsetMask::new(WindowShape::Square, 31).pixels, 961);
        let circle = SubsetMask::new(WindowShape::Circle, 31).pixels as f64;
        let ring = SubsetMask::new(WindowShape::Ring, 31).pixels as f64;
        let area = std::f64::consts::PI * 15.5 * 15.5;
        assert!((circle / area - 1.0).abs() < 0.02, "{circle}");
        assert!((ring / (0.75 * area) - 1.0).abs() < 0.03, "{ring}");
    }

    #[test]
    fn every_pixel_of_a_window_cut_anywhere_lies_within_its_reach() {
        let (whole, mut cut) = (SubsetMask::new(WindowShape::Square, 31), SubsetMask::default());
        let warps = [
            Warp { u: 3.0, ux: 0.2, uy: -0.6, v: -2.0, vx: 0.9, vy: -0.3 },
            Warp::rigid(1.0, 2.0, 1.4),
            Warp::shift(0.5, -0.25),
        ];
        for (left, top, right, bottom) in [(-15, -15, 2, 15), (-3, -15, 15, 4), (6, -15, 15, -9)] {
            assert!(whole.clip(|dx, dy| (left..=right).contains(&dx) && (top..=bottom).contains(&dy), &mut cut));
            for warp in &warps {
                let corners = [(left, top), (right, top), (left, bottom), (right, bottom)];
                let at = corners.map(|(dx, dy)| warp.apply(f64::from(dx), f64::from(dy)));
                let low = |pick: fn(&(f64, f64)) -> f64| at.iter().map(pick).fold(f64::INFINITY, f64::min);
                let high = |pick: fn(&(f64, f64)) -> f64| at.iter().map(pick).fold(f64::NEG_INFINITY, f64::max);
                let expected = [low(|p| p.0), low(|p| p.1), high(|p| p.0), high(|p| p.1)];
                for (found, expected) in cut.warped_bounds(warp).iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-9, "{:?} {warp:?}: {found} {expected}", cut.extent);
                }
            }
        }
    }

    #[test]
    fn the_span_of_a_row_goes_from_its_first_to_its_last_pixel() {
        let window = SubsetMask::from_test(12, |dx, dy| dx * dx + 2 * dy * dy <= 100 && dx != 3);
        let spans = window.row_spans(Pixel { x: 20, y: 9 }, 30);
        for (y, span) in (0..).zip(spans) {
            let belongs = |x: &i32| window.contains(x - 20, y - 9);
            let (first, last) = ((0..40).find(belongs), (0..40).rfind(belongs));
            assert_eq!(span, (first.unwrap_or(i32::MAX), last.unwrap_or(i32::MIN)), "row {y}");
        }
    }

    #[test]
    fn the_mask_is_symmetric_about_the_centre() {
        for shape in [WindowShape::Square, WindowShape::Circle, WindowShape::Ring] {
            let window = SubsetMask::new(shape, 21);
            let mut moment = (0.0, 0.0);
            for block in &window.blocks {
                for row in 0..block.rows {
                    for lane in 0..LANES {
                        let weight = f64::from(window.mask[block.start + row].0[lane]);
                        moment.0 += weight * f64::from(block.dx + lane as i32);
                        moment.1 += weight * f64::from(block.dy + row as i32);
                    }
                }
            }
            assert_eq!(moment, (0.0, 0.0), "{shape:?}");
        }
    }
}
