//! Integer-pixel search: cross-correlation by fast Fourier transform (FFT).
//!
//! The quick search correlates the subset circularly with the target area of the same size. It is cheap, and correct if
//! the subset moved less than about half its width. The full search covers the whole range. It divides the correlation
//! at each shift by the local contrast of the target, so the overlap does not bias the result.

use super::cross_correlation::{CrossCorrelation, LocalContrast, Shifts};
use super::peak::{Peak, Surface};
use crate::dic::geometry::{Pixel, Size, SubsetMask};
use crate::dic::image::PaddedImage;
use crate::dic::subset::ReferenceSubset;
use crate::numeric::{circular_size, fast_size};

/// The result of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::dic) struct SearchResult {
    /// The highest peak.
    pub(in crate::dic) best: Peak,
    /// The second-highest peak, if there is one.
    pub(in crate::dic) second: Option<Peak>,
    /// The displacement of column 0, row 0 of the surface, px.
    pub(in crate::dic) origin: Pixel,
    /// Whether the edge of the image limits the range.
    pub(in crate::dic) clipped: bool,
}

impl SearchResult {
    /// Returns the peak ratio: the height of the highest peak over that of the second; `None` without a second peak.
    pub(in crate::dic) fn peak_ratio(&self) -> Option<f64> {
        self.second.map(|second| self.best.height / second.height)
    }

    /// Returns the integer displacement of the highest peak, px.
    pub(in crate::dic) fn integer_displacement(&self) -> Pixel {
        Pixel { x: self.best.column as i32 + self.origin.x, y: self.best.row as i32 + self.origin.y }
    }

    /// Returns the sub-pixel displacement at the top of a peak, px.
    pub(in crate::dic) fn displacement(&self, peak: &Peak) -> (f64, f64) {
        let (column, row) = (peak.column as i32 + self.origin.x, peak.row as i32 + self.origin.y);
        (f64::from(column) + peak.dx, f64::from(row) + peak.dy)
    }
}

/// Plans and memory for searches of one subset size.
pub(in crate::dic) struct IntegerSearch {
    range: usize,
    quick: CrossCorrelation,
    full: CrossCorrelation,
    contrast: LocalContrast,
    surface: Vec<f32>,
    /// The size of the surface of the last full search.
    shifts: Size,
    candidates: Vec<f32>,
    /// Whether any search ran since this was last reset.
    pub(in crate::dic) is_used: bool,
}

impl IntegerSearch {
    /// Plans searches of subsets up to `window_px` wide, `range_px` to each side.
    pub(in crate::dic) fn new(window_px: usize, range_px: usize) -> Self {
        let area = window_px + 2 * range_px;
        let quick = circular_size(window_px);
        let count = (2 * range_px + 1).max(quick + 2);
        Self {
            range: range_px,
            quick: CrossCorrelation::new(quick),
            full: CrossCorrelation::new(fast_size(area)),
            contrast: LocalContrast::new(area),
            surface: vec![0.0; count * count],
            shifts: Size { width: 0, height: 0 },
            candidates: vec![0.0; count],
            is_used: false,
        }
    }

    /// Searches for `subset`, centred at `at` in the reference, at the same position in the target: the quick search.
    ///
    /// Heights of its peaks are not normalised. Returns `None` if the peak lies beyond the range, or if the subset's
    /// rectangle extends beyond the target.
    pub(in crate::dic) fn find_near(
        &mut self,
        subset: &ReferenceSubset,
        window: &SubsetMask,
        target: &PaddedImage,
        at: Pixel,
    ) -> Option<SearchResult> {
        self.is_used = true;
        let (extent, size) = (window.extent, self.quick.size());
        if !extent.fits(at, target.size()) {
            return None;
        }
        let Size { width, height } = extent.size();
        let area = Size { width: width.min(size), height: height.min(size) };
        self.quick.load(subset, window, target, Pixel { x: at.x + extent.left, y: at.y + extent.top }, area);
        self.quick.run();
        // Moves shift zero to the middle, with one wrapped line around.
        let (columns, before) = (size + 2, size / 2 + 1);
        for (line, row) in self.surface.chunks_exact_mut(columns).take(columns).zip(size - before..) {
            let from = &self.quick.data[row % size * size..][..size];
            let (negative, positive) = line.split_at_mut(before);
            negative.iter_mut().zip(&from[size - before..]).for_each(|(value, correlation)| *value = correlation.re);
            positive.iter_mut().zip(from).for_each(|(value, correlation)| *value = correlation.re);
        }
        let surface = Surface { data: &self.surface[..columns * columns], columns };
        let highest = surface.highest_sample()?;
        let origin = Pixel { x: -(before as i32), y: -(before as i32) };
        let in_range = |place: usize| place.abs_diff(before) <= self.range;
        if !in_range(highest.0) || !in_range(highest.1) {
            return None;
        }
        let second = surface.second_peak(highest.0, highest.1, &mut self.candidates);
        Some(SearchResult { best: surface.fit_top(highest.0, highest.1), second, origin, clipped: false })
    }

    /// The normalised surface of the last [`Self::find`].
    pub(in crate::dic) fn last_surface(&self) -> Surface<'_> {
        let Size { width: columns, height: rows } = self.shifts;
        Surface { data: &self.surface[..columns * rows], columns }
    }

    /// Searches for `subset`, centred at `at` in the reference, around `at + around` in the target: the full search.
    ///
    /// It covers the planned range to each side. Returns `None` if no shift keeps the subset in the target.
    pub(in crate::dic) fn find(
        &mut self,
        subset: &ReferenceSubset,
        window: &SubsetMask,
        target: &PaddedImage,
        at: Pixel,
        around: Pixel,
    ) -> Option<SearchResult> {
        self.is_used = true;
        let (extent, range) = (window.extent, self.range as i64);
        let shifts = |center: i64, first: i32, last: i32, length: usize| {
            let low = (center - range).max(-i64::from(first));
            let high = (center + range).min(length as i64 - 1 - i64::from(last));
            (low <= high).then_some((low, high))
        };
        let (x, y) = (i64::from(at.x) + i64::from(around.x), i64::from(at.y) + i64::from(around.y));
        let (left, right) = shifts(x, extent.left, extent.right, target.width())?;
        let (top, bottom) = shifts(y, extent.top, extent.bottom, target.height())?;
        let (columns, rows) = ((right - left + 1) as usize, (bottom - top + 1) as usize);
        self.shifts = Size { width: columns, height: rows };
        let Size { width, height } = extent.size();
        let corner = Pixel { x: left as i32 + extent.left, y: top as i32 + extent.top };
        let area = Size { width: columns + width - 1, height: rows + height - 1 };
        self.full.load(subset, window, target, corner, area);
        self.contrast.fill_tables(&self.full, area);
        self.full.run();
        let area_ratio = (width * height) as f64 / window.pixels as f64;
        let shifts = Shifts { subset: extent.size(), columns, rows, energy: subset.energy, area_ratio };
        self.contrast.normalise(&self.full, &shifts, &mut self.surface);
        let surface = Surface { data: &self.surface[..columns * rows], columns };
        let highest = surface.highest_sample()?;
        let origin = Pixel { x: (left - i64::from(at.x)) as i32, y: (top - i64::from(at.y)) as i32 };
        let clipped = columns.min(rows) < 2 * self.range + 1;
        let second = surface.second_peak(highest.0, highest.1, &mut self.candidates);
        Some(SearchResult { best: surface.fit_top(highest.0, highest.1), second, origin, clipped })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dic::geometry::GridPoint;
    use crate::dic::image::PreparedFrame;
    use crate::dic::tests::{Speckle, record};
    use crate::dic::{Interpolation, Shape, WindowShape, zncc};
    use crate::image::{Image, ImageView};

    fn cut(image: &Image, x: i32, y: i32, half: i32) -> Image {
        let pixel = |k: i32| {
            let (dx, dy) = (k % (2 * half + 1) - half, k / (2 * half + 1) - half);
            image.view().at((x + dx) as usize, (y + dy) as usize).unwrap()
        };
        let side = (2 * half + 1) as usize;
        Image::from_vec((0..(side * side) as i32).map(pixel).collect(), side, side).unwrap()
    }

    /// The reference implementation: the coefficient computed at every shift.
    fn slow_surface(reference: &Image, target: &Image, at: (i32, i32), half: i32, range: i32) -> Vec<f32> {
        let subset = cut(reference, at.0, at.1, half);
        let mut surface = Vec::new();
        for v in -range..=range {
            for u in -range..=range {
                let other = cut(target, at.0 + u, at.1 + v, half);
                let view = |image: &Image| -> Vec<f32> { image.view().data().to_vec() };
                let (a, b) = (view(&subset), view(&other));
                let side = (2 * half + 1) as usize;
                let pair = (ImageView::new(&a, side, side).unwrap(), ImageView::new(&b, side, side).unwrap());
                surface.push(zncc(pair.0, pair.1).unwrap() as f32);
            }
        }
        surface
    }

    #[test]
    fn the_surface_equals_the_statistical_correlation_at_every_shift_with_dirty_memory() {
        let speckle = Speckle::standard(5, 90.0);
        let reference = record(&speckle.draw(90, 80), 2.0, 1);
        let target = record(&speckle.moved(|_, _| (3.4, -2.2)).draw(90, 80), 2.0, 2);
        let (mut f, mut g) = (PreparedFrame::default(), PreparedFrame::default());
        f.fill(reference.view(), Interpolation::Optimised);
        g.fill(target.view(), Interpolation::Optimised);
        let window = SubsetMask::new(WindowShape::Square, 21);
        let mut search = IntegerSearch::new(21, 7);
        search.full.spoil();
        search.quick.spoil();
        search.contrast.spoil();
        let mut subset = ReferenceSubset::default();
        let at = GridPoint { x: 44, y: 40 };
        subset.fill(&f, &window, Shape::Translation, at).unwrap();
        let found = search.find(&subset, &window, &g.levels, g.local(at), Pixel::default()).unwrap();
        let slow = slow_surface(&reference, &target, (44, 40), 10, 7);
        let difference = slow.iter().zip(&search.surface).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(difference < 2e-5, "largest difference {difference}");
        let (u, v) = found.displacement(&found.best);
        assert!((u - 3.4).abs() < 0.05 && (v + 2.2).abs() < 0.05, "{u} {v}");
        let near = search.find_near(&subset, &window, &g.levels, g.local(at)).unwrap();
        let (u, v) = near.displacement(&near.best);
        assert!((u - 3.4).abs() < 0.6 && (v + 2.2).abs() < 0.6, "circular: {u} {v}");
    }

    #[test]
    fn searches_keep_to_the_image() {
        let speckle = Speckle::standard(6, 60.0);
        let mut frame = PreparedFrame::default();
        frame.fill(record(&speckle.draw(60, 60), 1.0, 1).view(), Interpolation::Optimised);
        let window = SubsetMask::new(WindowShape::Square, 31);
        let (mut search, mut subset) = (IntegerSearch::new(31, 16), ReferenceSubset::default());
        subset.fill(&frame, &window, Shape::Affine, GridPoint { x: 15, y: 44 }).unwrap();
        let found = search.find(&subset, &window, &frame.levels, Pixel { x: 15, y: 44 }, Pixel::default()).unwrap();
        assert_eq!(found.origin, Pixel { x: 0, y: -16 });
        assert_eq!((found.best.column, found.best.row), (0, 16));
        assert!(search.find(&subset, &window, &frame.levels, Pixel { x: 15, y: 44 }, Pixel { x: 200, y: 0 }).is_none());
    }
}
