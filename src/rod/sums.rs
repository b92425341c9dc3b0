//! Black and white, and how much of it changes from row to row and from column to column.
//!
//! Eq. 5 of "Collision measurements using digital image correlation techniques"
//! (Int. J. Mech. Sci., 2017): the picture is made black and white, and its first
//! differences down and across are summed over each row and each column. Edges
//! across and along a rod stand out as extrema, to whole pixels.

use crate::image::ImageView;

/// Grey levels the threshold is chosen among.
const LEVELS: usize = 256;

/// A black-and-white region of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoTone {
    /// Left column of the region in the image.
    pub left: usize,
    /// Top row of the region in the image.
    pub top: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Lighter pixels are white, DN.
    pub threshold_dn: f32,
    /// Mean grey levels of the black and of the white pixels, DN.
    pub means_dn: [f32; 2],
    white: Vec<bool>,
}

impl TwoTone {
    /// Cuts the grey levels of a region (x, y, width, height, px) where black and white are furthest apart for their
    /// numbers (Otsu 1979, doi:10.1109/TSMC.1979.4310076); `None` when all its pixels are alike.
    ///
    /// # Panics
    ///
    /// If the region reaches out of the image.
    pub fn new(image: ImageView<'_>, [left, top, width, height]: [usize; 4]) -> Option<Self> {
        let rows = || (top..top + height).map(|y| &image.row(y)[left..left + width]);
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
        Some(Self { left, top, width, height, threshold_dn, means_dn: [mean(false), mean(true)], white })
    }

    fn step(&self, from: usize, to: usize) -> i32 {
        i32::from(self.white[to]) - i32::from(self.white[from])
    }

    /// How many more pixels turn white than black from each row of the region to the next, over some of its columns:
    /// the horizontal sums of Eq. 5 in steps from black to white. Entry k is the line between rows k and k + 1.
    pub fn down(&self, columns: std::ops::Range<usize>) -> Vec<i32> {
        let sum = |row: usize| {
            let at = |x: usize| row * self.width + x;
            columns.clone().map(|x| self.step(at(x), at(x) + self.width)).sum()
        };
        (0..self.height.saturating_sub(1)).map(sum).collect()
    }

    /// Share of white pixels in each row of the region, over some of its columns.
    pub fn white_share(&self, columns: std::ops::Range<usize>) -> Vec<f64> {
        let count = columns.len().max(1) as f64;
        let white = |y: usize| columns.clone().filter(|x| self.white[y * self.width + x]).count();
        (0..self.height).map(|y| white(y) as f64 / count).collect()
    }

    /// The vertical sums of Eq. 5: the same from each column to the next, over all rows.
    pub fn across(&self) -> Vec<i32> {
        let sum = |x: usize| (0..self.height).map(|y| self.step(y * self.width + x, y * self.width + x + 1)).sum();
        (0..self.width.saturating_sub(1)).map(sum).collect()
    }
}

/// The first level that counts as white.
fn otsu(counts: &[u32; LEVELS]) -> usize {
    let total: f64 = counts.iter().map(|n| f64::from(*n)).sum();
    let moment: f64 = counts.iter().enumerate().map(|(level, n)| level as f64 * f64::from(*n)).sum();
    let (mut below, mut sum, mut best) = (0.0, 0.0, (-1.0, 1, 1));
    for level in 1..LEVELS {
        below += f64::from(counts[level - 1]);
        sum += (level - 1) as f64 * f64::from(counts[level - 1]);
        if below <= 0.0 || below >= total {
            continue;
        }
        let between = (moment * below - sum * total).powi(2) / (below * (total - below));
        // Levels that nothing has between the two classes are as good as one another: the middle one is taken.
        if between > best.0 {
            best = (between, level, level);
        } else if between >= best.0 {
            best.2 = level;
        }
    }
    usize::midpoint(best.1, best.2)
}

/// An extremum of a row of sums.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Where, counted as the sums' entries are: the middle of the entries added up.
    pub at: usize,
    /// The sums over it and its neighbours: positive from black to white.
    pub strength: i32,
}

/// The extrema of sums, a blurred or leaning edge being spread over an entry and its two neighbours; strongest first,
/// none nearer than `apart` entries to a stronger one.
pub fn lines(sums: &[i32], apart: usize) -> Vec<Line> {
    let spread = |at: usize| sums[at.saturating_sub(1)..(at + 2).min(sums.len())].iter().sum::<i32>();
    let mut all: Vec<Line> = (0..sums.len()).map(|at| Line { at, strength: spread(at) }).collect();
    all.retain(|line| line.strength != 0);
    // Of lines alike, the one whose own entry is the highest, then the first.
    all.sort_by_key(|line| (-line.strength.abs(), -(sums[line.at] * line.strength.signum()), line.at));
    let mut kept: Vec<Line> = Vec::new();
    for line in all {
        if kept.iter().all(|other| other.at.abs_diff(line.at) >= apart) {
            kept.push(line);
        }
    }
    // The middle of what was added up.
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

    fn picture(shade: impl Fn(usize, usize) -> f32) -> Image {
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
        let image = picture(|x, y| if (10..30).contains(&x) && (15..45).contains(&y) { 200.0 } else { 30.0 });
        let tone = TwoTone::new(image.view(), [0, 0, 40, 60]).unwrap();
        assert!((tone.threshold_dn - 115.0).abs() < 2.0, "{}", tone.threshold_dn);
        let (down, across) = (tone.down(0..40), tone.across());
        assert_eq!((down.len(), across.len()), (59, 39));
        let entries = |sums: &[i32]| -> Vec<(usize, i32)> {
            sums.iter().enumerate().filter(|(_, sum)| **sum != 0).map(|(at, sum)| (at, *sum)).collect()
        };
        assert_eq!(entries(&down), [(14, 20), (44, -20)]);
        assert_eq!(entries(&across), [(9, 30), (29, -30)]);
        assert_eq!(lines(&down, 4), [Line { at: 14, strength: 20 }, Line { at: 44, strength: -20 }]);
        assert_eq!(tone.down(0..15).iter().filter(|sum| **sum != 0).copied().collect::<Vec<_>>(), [5, -5]);
    }

    #[test]
    fn a_region_is_cut_out_of_the_image() {
        let image = picture(|_, y| if y < 30 { 10.0 } else { 50.0 });
        let tone = TwoTone::new(image.view(), [5, 20, 10, 20]).unwrap();
        assert_eq!(lines(&tone.down(0..10), 4), [Line { at: 9, strength: 10 }]);
        assert!(TwoTone::new(image.view(), [5, 0, 10, 20]).is_none(), "one shade alone has no threshold");
    }

    #[test]
    fn a_leaning_line_is_one_line() {
        // Falls by 2 rows over 40 columns.
        let image = picture(|x, y| if y > 20 + x / 14 { 200.0 } else { 30.0 });
        let tone = TwoTone::new(image.view(), [0, 0, 40, 60]).unwrap();
        assert_eq!(lines(&tone.down(0..40), 4), [Line { at: 21, strength: 40 }]);
    }
}
