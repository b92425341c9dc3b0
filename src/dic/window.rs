//! The pixels of a subset, in blocks of eight columns.

use super::WindowShape;
use super::lanes::{LANES, Lanes};
use super::warp::Warp;

/// Eight neighbouring columns of a subset and the rows in which they have pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Block {
    /// Offset of the first column from the subset's centre, px.
    pub(super) dx: i32,
    /// Offset of the first row from the subset's centre, px.
    pub(super) dy: i32,
    /// Rows.
    pub(super) rows: usize,
    /// First of its rows among the rows of all blocks.
    pub(super) start: usize,
}

/// Which pixels around a centre belong to a subset.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Window {
    pub(super) blocks: Vec<Block>,
    /// 1 where a pixel belongs, else 0; block by block, row by row.
    pub(super) mask: Vec<Lanes>,
    /// Pixels that belong.
    pub(super) pixels: usize,
    /// Largest offset along x or y, px.
    pub(super) half: u32,
    /// Largest distance from the centre, px.
    radius: f64,
}

impl Window {
    /// A subset of the given outline and full width.
    ///
    /// The disc reaches half a pixel past the outermost centres; the ring leaves
    /// out the inner half of the disc's radius.
    pub(super) fn new(shape: WindowShape, size_px: u32) -> Self {
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

    /// The pixels within `half` of the centre for which `belongs(dx, dy)`.
    pub(super) fn from_test(half: u32, belongs: impl Fn(i32, i32) -> bool) -> Self {
        let reach = half as i32;
        let mut window = Self { blocks: Vec::new(), mask: Vec::new(), pixels: 0, half, radius: 0.0 };
        let inside = |dx: i32, dy: i32| dx.abs() <= reach && dy.abs() <= reach && belongs(dx, dy);
        for dx in (-reach..=reach).step_by(LANES) {
            let used = |dy: &i32| (0..LANES as i32).any(|lane| inside(dx + lane, *dy));
            let Some(first) = (-reach..=reach).find(used) else { continue };
            let last = (-reach..=reach).rev().find(used).unwrap_or(first);
            let rows = (last - first + 1) as usize;
            window.blocks.push(Block { dx, dy: first, rows, start: window.mask.len() });
            for dy in first..=last {
                let mut row = Lanes::splat(0.0);
                for (x, value) in (dx..).zip(&mut row.0).filter(|(x, _)| inside(*x, dy)) {
                    *value = 1.0;
                    window.pixels += 1;
                    window.radius = window.radius.max(f64::from(x).hypot(f64::from(dy)));
                }
                window.mask.push(row);
            }
        }
        window
    }

    /// This window without the pixels that do not belong, into `out`; tells whether there are any.
    pub(super) fn cut(&self, belongs: impl Fn(i32, i32) -> bool, out: &mut Self) -> bool {
        out.clone_from(self);
        for block in &self.blocks {
            for row in 0..block.rows {
                for (dx, value) in (block.dx..).zip(&mut out.mask[block.start + row].0) {
                    if *value > 0.5 && !belongs(dx, block.dy + row as i32) {
                        *value = 0.0;
                        out.pixels -= 1;
                    }
                }
            }
        }
        out.pixels < self.pixels
    }

    /// Whether the pixel at an offset from the centre belongs.
    pub(super) fn holds(&self, dx: i32, dy: i32) -> bool {
        let block = self.blocks.iter().find(|block| (block.dx..block.dx + LANES as i32).contains(&dx));
        block.is_some_and(|block| {
            let row = dy - block.dy;
            (0..block.rows as i32).contains(&row)
                && self.mask[block.start + row as usize].0[(dx - block.dx) as usize] > 0.5
        })
    }

    /// How far the warped subset reaches at most from its displaced centre along x and y, px.
    pub(super) fn reach(&self, warp: &Warp) -> (f64, f64) {
        let along = |a: f64, b: f64| (f64::from(self.half) * (a.abs() + b.abs())).min(self.radius * a.hypot(b));
        (along(1.0 + warp.ux, warp.uy), along(warp.vx, 1.0 + warp.vy))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_hold_the_pixels_of_their_outline() {
        assert_eq!(Window::new(WindowShape::Square, 31).pixels, 961);
        let circle = Window::new(WindowShape::Circle, 31).pixels as f64;
        let ring = Window::new(WindowShape::Ring, 31).pixels as f64;
        let area = std::f64::consts::PI * 15.5 * 15.5;
        assert!((circle / area - 1.0).abs() < 0.02, "{circle}");
        assert!((ring / (0.75 * area) - 1.0).abs() < 0.03, "{ring}");
    }

    #[test]
    fn the_mask_is_symmetric_about_the_centre() {
        for shape in [WindowShape::Square, WindowShape::Circle, WindowShape::Ring] {
            let window = Window::new(shape, 21);
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
