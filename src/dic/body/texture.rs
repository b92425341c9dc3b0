//! Texture of a ball: whether it carries marks that turn with it, or shows light only.
//!
//! A plain ball has grey levels, too: the shading of its lamps, highlights, reflections. They follow the centre and do
//! not turn, so a match of them measures no rotation, and a translation that is not the ball's. Shading is smooth, and
//! highlights are few and small. Marks, speckles, seams and dimples are neither.

use std::ops::Range;

use crate::dic::geometry::GridPoint;
use crate::dic::image::PreparedFrame;
use crate::numeric::quantile;

/// The limits of the test. They separate films of an independent ray tracer: 12 marked balls had contrast in 0.44 to
/// 0.97 of their cells, plain balls with two lamps or a ring light in 0.12 to 0.22.
struct Limits {
    /// The part of the radius that is examined. Towards the rim, shading falls off as fast as texture.
    radius_fraction: f64,
    /// The side of a cell, as a fraction of the radius.
    cell_fraction: f64,
    /// The minimum side of a cell, px.
    min_cell_px: f64,
    /// The minimum part of a cell within the examined disc.
    min_filled_fraction: f64,
    /// The minimum number of cells: of a smaller ball, nothing can be concluded.
    min_cells: usize,
    /// The minimum contrast of a marked cell, in standard deviations of the noise.
    contrast_sigmas: f64,
    /// The minimum contrast of a marked cell, as a fraction of the grey level of the brighter parts.
    contrast_fraction: f64,
    /// The fraction of marked cells from which a ball is textured.
    marked_fraction: f64,
    /// The minimum contrast of marks along the angle, as a fraction of the brightest parts.
    ring_fraction: f64,
    /// The minimum noise, DN: that of rounding.
    min_noise_dn: f64,
}

const LIMITS: Limits = Limits {
    radius_fraction: 0.85,
    cell_fraction: 0.25,
    min_cell_px: 6.0,
    min_filled_fraction: 0.6,
    min_cells: 6,
    contrast_sigmas: 3.0,
    contrast_fraction: 0.025,
    marked_fraction: 0.33,
    ring_fraction: 0.06,
    min_noise_dn: 0.5,
};

/// The quantile of the second differences that represents the noise; larger ones are edges.
const NOISE_QUANTILE: f64 = 0.25;
/// The same quantile of the absolute values of a standard normal variable.
const NORMAL_QUANTILE: f64 = 0.318_64;
/// The standard deviation of a second difference along x and y, of white noise of one.
const SECOND_DIFFERENCE_GAIN: f64 = 6.0;
/// The quantile of the levels that represents the brighter parts.
const BRIGHT_QUANTILE: f64 = 0.95;

/// The quantile of the levels that represents the brightest parts, highlights among them.
const BRIGHTEST_QUANTILE: f64 = 0.99;

/// A disc in a frame, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallDisc {
    /// The centre along x.
    pub x_px: f64,
    /// The centre along y (down).
    pub y_px: f64,
    /// The radius.
    pub radius_px: f64,
}

/// Whether a ball carries marks over enough of its disc for its rotation to be seen.
///
/// At least a third of the cells must have contrast. False for a ball of fewer than six cells.
///
/// Cells of the disc are compared with planes fitted to them, which remove shading. The noise comes from second
/// differences (J. Immerkaer, Comput. Vis. Image Underst. 64 (1996) 300, <https://doi.org/10.1006/cviu.1996.0060>).
pub fn has_texture(frame: &PreparedFrame, disc: BallDisc) -> bool {
    let radius_px = LIMITS.radius_fraction * disc.radius_px;
    let cell_px = (LIMITS.cell_fraction * disc.radius_px).max(LIMITS.min_cell_px).round();
    let reach = (radius_px / cell_px).ceil() as i32;
    let examined = BallDisc { radius_px, ..disc };
    let Some(noise_dn) = noise_dn(frame, examined) else { return false };
    let mut levels: Vec<f32> = levels(frame, examined).collect();
    let Some(bright_dn) = quantile(&mut levels, BRIGHT_QUANTILE) else { return false };
    let bright_dn = f64::from(bright_dn + frame.offset);
    let limit = (LIMITS.contrast_sigmas * noise_dn).max(LIMITS.contrast_fraction * bright_dn);
    let (mut cells, mut marked) = (0, 0);
    for (row, column) in (-reach..reach).flat_map(|row| (-reach..reach).map(move |column| (row, column))) {
        let (left, top) = (disc.x_px + f64::from(column) * cell_px, disc.y_px + f64::from(row) * cell_px);
        let cell = Cell { left, top, side: cell_px };
        if let Some(contrast_dn) = cell.contrast_dn(frame, examined) {
            cells += 1;
            marked += usize::from(contrast_dn > limit);
        }
    }
    cells >= LIMITS.min_cells && marked as f64 >= LIMITS.marked_fraction * cells as f64
}

/// Returns the minimum contrast of marks along the angle, DN, by which a rotation shows; `None` if the disc is not in the
/// frame.
///
/// Lamps and reflections leave 2 to 5 % of the brightness of a ball, marks of a pen 8 % or more, speckle 20 %.
pub fn min_ring_contrast_dn(frame: &PreparedFrame, disc: BallDisc) -> Option<f64> {
    let noise_dn = noise_dn(frame, disc)?;
    let mut levels: Vec<f32> = levels(frame, disc).collect();
    let bright_dn = f64::from(quantile(&mut levels, BRIGHTEST_QUANTILE)? + frame.offset);
    Some((LIMITS.contrast_sigmas * noise_dn).max(LIMITS.ring_fraction * bright_dn))
}

/// A square part of a frame, px.
#[derive(Debug, Clone, Copy)]
struct Cell {
    left: f64,
    top: f64,
    side: f64,
}

impl Cell {
    /// Returns the standard deviation of the levels about a plane, DN; `None` if too little of the cell is in the disc.
    fn contrast_dn(&self, frame: &PreparedFrame, disc: BallDisc) -> Option<f64> {
        let middle = [self.left + 0.5 * self.side, self.top + 0.5 * self.side];
        let [left, top] = [self.left, self.top].map(|start| start.ceil() as i32);
        let [right, bottom] = [self.left, self.top].map(|start| (start + self.side).ceil() as i32);
        // The sums of 1, x, y, and of their products with each other and with the level v.
        let mut sums = [0.0_f64; 10];
        for y in top..bottom {
            let columns = row_in_disc(frame, disc, y);
            let columns = columns.start.max(left)..columns.end.min(right);
            let dy = f64::from(y) - middle[1];
            for (x, level) in columns.clone().zip(row_levels(frame, columns, y)) {
                let (dx, v) = (f64::from(x) - middle[0], f64::from(*level));
                for (sum, term) in
                    sums.iter_mut().zip([1.0, dx, dy, v, dx * dx, dx * dy, dy * dy, dx * v, dy * v, v * v])
                {
                    *sum += term;
                }
            }
        }
        let [n, x, y, v, xx, xy, yy, xv, yv, vv] = sums;
        if n < LIMITS.min_filled_fraction * self.side * self.side {
            return None;
        }
        let (xx, xy, yy) = (xx - x * x / n, xy - x * y / n, yy - y * y / n);
        let (xv, yv, vv) = (xv - x * v / n, yv - y * v / n, vv - v * v / n);
        let determinant = xx * yy - xy * xy;
        let explained = (xv * xv * yy - 2.0 * xv * yv * xy + yv * yv * xx) / determinant;
        (determinant > 0.0).then(|| ((vv - explained).max(0.0) / n).sqrt())
    }
}

/// Returns the standard deviation of the noise in a disc, DN, at least that of rounding; `None` without a prepared
/// pixel.
fn noise_dn(frame: &PreparedFrame, disc: BallDisc) -> Option<f64> {
    let mut differences: Vec<f32> = Vec::new();
    for y in rows_of_disc(disc) {
        let columns = row_in_disc(frame, disc, y);
        if columns.is_empty() {
            continue;
        }
        let wide = columns.start - 1..columns.end + 1;
        let [above, row, below] = [y - 1, y, y + 1].map(|y| row_levels(frame, wide.clone(), y));
        let second = |row: &[f32]| row[0] - 2.0 * row[1] + row[2];
        let rows = above.windows(3).zip(row.windows(3)).zip(below.windows(3));
        differences.extend(rows.map(|((a, b), c)| (second(a) - 2.0 * second(b) + second(c)).abs()));
    }
    let size = quantile(&mut differences, NOISE_QUANTILE)?;
    Some((f64::from(size) / (NORMAL_QUANTILE * SECOND_DIFFERENCE_GAIN)).max(LIMITS.min_noise_dn))
}

/// Returns the grey levels of the prepared pixels of a disc, DN, minus the frame's offset.
fn levels(frame: &PreparedFrame, disc: BallDisc) -> impl Iterator<Item = f32> {
    rows_of_disc(disc).flat_map(move |y| row_levels(frame, row_in_disc(frame, disc, y), y)).copied()
}

/// Returns the rows of the image that a disc crosses.
fn rows_of_disc(disc: BallDisc) -> Range<i32> {
    (disc.y_px - disc.radius_px).ceil() as i32..(disc.y_px + disc.radius_px).floor() as i32 + 1
}

/// Returns the columns of the image whose pixels in row `y` are prepared and inside the disc; empty without any.
fn row_in_disc(frame: &PreparedFrame, disc: BallDisc, y: i32) -> Range<i32> {
    let origin = frame.local(GridPoint { x: 0, y: 0 });
    let is_prepared = (0..frame.levels.height() as i32).contains(&(y + origin.y));
    let square = disc.radius_px.powi(2) - (f64::from(y) - disc.y_px).powi(2);
    if !is_prepared || square <= 0.0 {
        return 0..0;
    }
    let half = square.sqrt();
    let first = ((disc.x_px - half).floor() as i32 + 1).max(-origin.x);
    let end = ((disc.x_px + half).ceil() as i32).min(frame.levels.width() as i32 - origin.x);
    first..end.max(first)
}

/// Returns the grey levels of some columns of row `y` of the image, DN, minus the frame's offset. One column and row
/// beyond the prepared part may be read: it is padded.
fn row_levels(frame: &PreparedFrame, columns: Range<i32>, y: i32) -> &[f32] {
    if columns.is_empty() {
        return &[];
    }
    let origin = frame.local(GridPoint { x: 0, y: 0 });
    let first = frame.levels.index((columns.start + origin.x) as isize, (y + origin.y) as isize);
    &frame.levels.data()[first..first + columns.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::tests::{Speckle, prepared, record};
    use crate::image::Image;

    const DISC: BallDisc = BallDisc { x_px: 70.0, y_px: 66.0, radius_px: 45.0 };

    /// A plain ball under a lamp, with a highlight.
    fn plain() -> Image {
        let mut image = Image::new(140, 132);
        for (y, row) in image.rows_mut().enumerate() {
            for (x, level) in row.iter_mut().enumerate() {
                let (dx, dy) = ((x as f32 - 70.0) / 45.0, (y as f32 - 66.0) / 45.0);
                let depth = (1.0 - dx * dx - dy * dy).max(0.0).sqrt();
                let glow = (-((dx + 0.3).powi(2) + (dy + 0.4).powi(2)) / 0.004).exp();
                *level = 20.0 + 170.0 * (0.6 * depth - 0.3 * dx - 0.4 * dy).max(0.0) + 60.0 * glow;
            }
        }
        image
    }

    #[test]
    fn light_is_no_texture_and_speckles_are() {
        for noise in [0.0, 1.0, 4.0] {
            assert!(!has_texture(&prepared(&record(&plain(), noise, 1)), DISC), "noise {noise}");
            let speckle = Speckle::standard(21, 140.0).draw(140, 132);
            assert!(has_texture(&prepared(&record(&speckle, noise, 2)), DISC), "noise {noise}");
        }
    }

    #[test]
    fn a_ball_of_few_pixels_or_outside_the_image_shows_nothing() {
        let frame = prepared(&Speckle::standard(21, 140.0).draw(140, 132));
        assert!(!has_texture(&frame, BallDisc { radius_px: 6.0, ..DISC }));
        assert!(!has_texture(&frame, BallDisc { x_px: 900.0, ..DISC }));
        assert!(!has_texture(&frame, BallDisc { x_px: -900.0, ..DISC }));
    }
}
