//! Projections of the binary image: its changes from row to row and from column to column.
//!
//! Eq. 5 of "Collision measurements using digital image correlation techniques" (Int. J. Mech. Sci., 2017). The image
//! is thresholded, and its first differences down and across are summed over each row and each column. Edges across and
//! along a rod are extrema of these sums, to whole pixels.

use crate::image::{ImageView, PixelRect};
use crate::numeric::otsu;

/// The number of histogram bins for the threshold.
const LEVELS: usize = 256;

/// A thresholded region of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct BinaryImage {
    /// The left column of the region in the image.
    pub left: usize,
    /// The top row of the region in the image.
    pub top: usize,
    /// The number of columns.
    pub width: usize,
    /// The number of rows.
    pub height: usize,
    /// The threshold, DN; lighter pixels are white.
    pub threshold_dn: f32,
    /// The mean grey levels of the black and of the white pixels, DN.
    pub means_dn: [f32; 2],
    white: Vec<bool>,
}

impl BinaryImage {
    /// Thresholds a region by Otsu's method (1979, doi:10.1109/TSMC.1979.4310076).
    ///
    /// Returns `None` if all its pixels are alike.
    ///
    /// # Panics
    ///
    /// If the region exceeds the image.
    pub fn new(image: ImageView<'_>, region: PixelRect) -> Option<Self> {
        let rows = || region.rows().map(|y| &image.row(y)[region.columns()]);
        let pixels = || rows().flatten().copied();
        let (low, high) = pixels().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if !(high > low && (high - low).is_finite()) {
            return None;
        }
        let scale = LEVELS as f32 / (high - low);
        let mut counts = [0_u32; LEVELS];
        pixels().for_each(|v| counts[(((v - low) * scale) as usize).min(LEVELS - 1)] += 1);
        let threshold_dn = low + otsu(&counts) as f32 / scale;
        let mean = |white: bool| {
            let (sum, count) = pixels()
                .filter(|v| (*v >= threshold_dn) == white)
                .fold((0.0_f64, 0_u32), |(sum, count), v| (sum + f64::from(v), count + 1));
            (sum / f64::from(count.max(1))) as f32
        };
        let white = pixels().map(|v| v >= threshold_dn).collect();
        let (left, top) = (region.columns().start, region.rows().start);
        let (width, height) = (region.columns().len(), region.rows().len());
        Some(Self { left, top, width, height, threshold_dn, means_dn: [mean(false), mean(true)], white })
    }

    /// Returns the change from one pixel to another by index: 1 from black to white, -1 from white to black, else 0.
    fn edge_sign(&self, from: usize, to: usize) -> i32 {
        i32::from(self.white[to]) - i32::from(self.white[from])
    }

    /// Sums the steps from each row of the region to the next, over some of its columns.
    ///
    /// A step from black to white counts 1, from white to black -1.
    /// These are the horizontal sums of Eq. 5. Entry k is the line between rows k and k + 1.
    pub fn row_steps(&self, columns: std::ops::Range<usize>) -> Vec<i32> {
        let sum = |row: usize| {
            let at = |x: usize| row * self.width + x;
            columns.clone().map(|x| self.edge_sign(at(x), at(x) + self.width)).sum()
        };
        (0..self.height.saturating_sub(1)).map(sum).collect()
    }

    /// Returns the fraction of white pixels in each row of the region, over some of its columns.
    pub fn white_fraction(&self, columns: std::ops::Range<usize>) -> Vec<f64> {
        let count = columns.len().max(1) as f64;
        let white = |y: usize| columns.clone().filter(|x| self.white[y * self.width + x]).count();
        (0..self.height).map(|y| white(y) as f64 / count).collect()
    }

    /// Sums the steps from each column of the region to the next, over all rows: the vertical sums of Eq. 5.
    ///
    /// A step from black to white counts 1, from white to black -1. Entry k is the line between columns k and k + 1.
    pub fn column_steps(&self) -> Vec<i32> {
        let sum = |x: usize| (0..self.height).map(|y| self.edge_sign(y * self.width + x, y * self.width + x + 1)).sum();
        (0..self.width.saturating_sub(1)).map(sum).collect()
    }
}

/// An extremum of a list of sums.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// The index of the entry: the centroid of the summed entries.
    pub at: usize,
    /// The sum over it and its neighbours: positive from black to white.
    pub strength: i32,
}

/// Finds the extrema of sums over three entries, strongest of either sign first, at least `apart` entries from a
/// stronger one.
///
/// A blurred or tilted edge spreads over an entry and its two neighbours.
pub fn find_extrema(sums: &[i32], apart: usize) -> Vec<Line> {
    let spread = |at: usize| sums[at.saturating_sub(1)..(at + 2).min(sums.len())].iter().sum::<i32>();
    let mut all: Vec<Line> = (0..sums.len()).map(|at| Line { at, strength: spread(at) }).collect();
    all.retain(|line| line.strength != 0);
    // Of equal lines, the one with the highest own entry comes first, then the first.
    all.sort_by_key(|line| (-line.strength.abs(), -(sums[line.at] * line.strength.signum()), line.at));
    let mut kept: Vec<Line> = Vec::new();
    for line in all {
        if kept.iter().all(|other| other.at.abs_diff(line.at) >= apart) {
            kept.push(line);
        }
    }
    // The centroid of the summed entries.
    for line in &mut kept {
        let from = line.at.saturating_sub(1);
        let near = &sums[from..(line.at + 2).min(sums.len())];
        let moment: i32 = near.iter().zip(0..).map(|(sum, step): (_, i32)| sum * step).sum();
        let middle = f64::from(moment) / f64::from(line.strength);
        line.at = from + middle.round().clamp(0.0, near.len() as f64 - 1.0) as usize;
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    fn draw(shade: impl Fn(usize, usize) -> f32) -> Image {
        let mut image = Image::new(40, 60);
        for y in 0..60 {
            for x in 0..40 {
                image.data_mut()[y * 40 + x] = shade(x, y);
            }
        }
        image
    }

    #[test]
    fn sums_count_the_pixels_that_change_over_a_line() {
        let image = draw(|x, y| if (10..30).contains(&x) && (15..45).contains(&y) { 200.0 } else { 30.0 });
        let binary = BinaryImage::new(image.view(), PixelRect::whole(40, 60)).unwrap();
        assert!((binary.threshold_dn - 115.0).abs() < 2.0, "{}", binary.threshold_dn);
        let (down, across) = (binary.row_steps(0..40), binary.column_steps());
        assert_eq!((down.len(), across.len()), (59, 39));
        let entries = |sums: &[i32]| -> Vec<(usize, i32)> {
            sums.iter().enumerate().filter(|(_, sum)| **sum != 0).map(|(at, sum)| (at, *sum)).collect()
        };
        assert_eq!(entries(&down), [(14, 20), (44, -20)]);
        assert_eq!(entries(&across), [(9, 30), (29, -30)]);
        assert_eq!(find_extrema(&down, 4), [Line { at: 14, strength: 20 }, Line { at: 44, strength: -20 }]);
        assert_eq!(binary.row_steps(0..15).iter().filter(|sum| **sum != 0).copied().collect::<Vec<_>>(), [5, -5]);
    }

    #[test]
    fn a_region_is_cut_out_of_the_image() {
        let image = draw(|_, y| if y < 30 { 10.0 } else { 50.0 });
        let binary = BinaryImage::new(image.view(), PixelRect::from([5, 20, 10, 20])).unwrap();
        assert_eq!(find_extrema(&binary.row_steps(0..10), 4), [Line { at: 9, strength: 10 }]);
        assert!(
            BinaryImage::new(image.view(), PixelRect::from([5, 0, 10, 20])).is_none(),
            "one shade alone has no threshold"
        );
    }

    #[test]
    fn a_tilted_line_is_one_line() {
        // Falls by 2 rows over 40 columns.
        let image = draw(|x, y| if y > 20 + x / 14 { 200.0 } else { 30.0 });
        let binary = BinaryImage::new(image.view(), PixelRect::whole(40, 60)).unwrap();
        assert_eq!(find_extrema(&binary.row_steps(0..40), 4), [Line { at: 21, strength: 40 }]);
    }
}
