//! Upsampled cross-correlation: subsets are interpolated between the pixels first, as in PIV practice.
//!
//! Both subsets are interpolated on a grid `points + 1` times finer and cross-correlated by FFT. The correlation at
//! each shift is divided by the local contrast of the target. A peak fit is essential. Without it the result is a
//! multiple of 1 / (points + 1) px, and a displacement below half of that reads zero.

use super::cross_correlation::{CrossCorrelation, LocalContrast, Shifts};
use super::peak::Surface;
use crate::dic::geometry::{Pixel, Size, SubsetMask};
use crate::dic::image::InterpolatedImage;
use crate::numeric::fast_size;

/// The search range around the integer displacement, px.
const MARGIN_PX: usize = 2;

/// The estimator of a correlation peak.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::dic) enum PeakFit {
    /// The top of the fitted peak.
    Fitted,
    /// The highest grid point.
    Highest,
}

/// A subset of an image, by its centre.
#[derive(Clone, Copy)]
pub(in crate::dic) struct Subset<'a> {
    pub(in crate::dic) image: &'a InterpolatedImage,
    pub(in crate::dic) at: Pixel,
}

/// Plan and memory of the upsampled search.
pub(in crate::dic) struct UpsampledSearch {
    /// The number of fine steps per pixel.
    factor: usize,
    correlation: CrossCorrelation,
    /// 1 on the fine grid of the subset where a pixel belongs.
    mask: Vec<f32>,
    /// The number of fine points that belong.
    count: usize,
    subset: Vec<f32>,
    area: Vec<f32>,
    rows: Vec<f32>,
    /// The tap weights at each fine step after a pixel.
    phases: Vec<[f32; 6]>,
    contrast: LocalContrast,
    surface: Vec<f32>,
}

impl UpsampledSearch {
    /// Plans searches of one window with `points` points between two pixels.
    pub(in crate::dic) fn new(window: &SubsetMask, points: usize) -> Self {
        let (factor, pixels) = (points + 1, 2 * window.half as usize);
        let side = pixels * factor + 1;
        let area = (pixels + 2 * MARGIN_PX) * factor + 1;
        let shifts = area - side + 1;
        let mut mask = vec![0.0; side * side];
        let offset = |fine: usize| (fine as f64 / factor as f64).round() as i32 - window.half as i32;
        for (k, value) in mask.iter_mut().enumerate() {
            if window.contains(offset(k % side), offset(k / side)) {
                *value = 1.0;
            }
        }
        Self {
            factor,
            correlation: CrossCorrelation::new(fast_size(area)),
            count: mask.iter().filter(|value| **value > 0.5).count(),
            mask,
            subset: vec![0.0; side * side],
            area: vec![0.0; area * area],
            rows: vec![0.0; (pixels + 2 * MARGIN_PX + 6) * area],
            phases: vec![[0.0; 6]; factor],
            contrast: LocalContrast::new(area),
            surface: vec![0.0; shifts * shifts],
        }
    }

    /// Returns the displacement of a subset within 2 px of the integer displacement `near`, px; `None` without
    /// contrast.
    ///
    /// `fit` chooses between the fitted top of the correlation and its highest grid point.
    pub(in crate::dic) fn find(
        &mut self,
        reference: Subset<'_>,
        target: Subset<'_>,
        window: &SubsetMask,
        near: Pixel,
        fit: PeakFit,
    ) -> Option<(f64, f64)> {
        let half = window.half as i32;
        let side = 2 * window.half as usize * self.factor + 1;
        for (phase, weights) in self.phases.iter_mut().enumerate() {
            *weights = reference.image.weights(phase as f32 / self.factor as f32);
        }
        let corner = Pixel { x: reference.at.x - half, y: reference.at.y - half };
        upsample(reference.image, corner, side, &self.phases, &mut self.rows, &mut self.subset);
        let energy = self.subtract_mean();
        let margin = half + MARGIN_PX as i32;
        let corner = Pixel { x: target.at.x + near.x - margin, y: target.at.y + near.y - margin };
        let area = side + 2 * MARGIN_PX * self.factor;
        upsample(target.image, corner, area, &self.phases, &mut self.rows, &mut self.area);
        let mean = self.area.iter().map(|value| f64::from(*value)).sum::<f64>() / self.area.len() as f64;
        self.area.iter_mut().for_each(|value| *value -= mean as f32);
        self.correlation.load_squares(&self.area, area, &self.subset, side);
        self.contrast.fill_tables(&self.correlation, Size { width: area, height: area });
        self.correlation.run();
        let count = area - side + 1;
        let area_ratio = (side * side) as f64 / self.count.max(1) as f64;
        let subset = Size { width: side, height: side };
        let shifts = Shifts { subset, columns: count, rows: count, energy, area_ratio };
        self.contrast.normalise(&self.correlation, &shifts, &mut self.surface);
        let surface = Surface { data: &self.surface, columns: count };
        let (column, row) = surface.highest_sample().filter(|_| energy > 0.0)?;
        let (mut fine_x, mut fine_y) = (column as f64, row as f64);
        if fit == PeakFit::Fitted {
            let top = surface.fit_top(column, row);
            fine_x += top.dx;
            fine_y += top.dy;
        }
        let factor = self.factor as f64;
        let place = |fine: f64, near: i32| fine / factor - MARGIN_PX as f64 + f64::from(near);
        Some((place(fine_x, near.x), place(fine_y, near.y)))
    }

    /// Subtracts the mean of the upsampled subset on the mask, clears it off the mask, and returns the sum of squares,
    /// DN^2.
    fn subtract_mean(&mut self) -> f64 {
        let inside = self.subset.iter().zip(&self.mask).map(|(value, mask)| f64::from(value * mask));
        let mean = (inside.sum::<f64>() / self.count.max(1) as f64) as f32;
        let mut energy = 0.0;
        for (value, mask) in self.subset.iter_mut().zip(&self.mask) {
            *value = (*value - mean) * mask;
            energy += f64::from(*value) * f64::from(*value);
        }
        energy
    }
}

/// Interpolates `side` x `side` points from the pixel `corner` on, with as many points per pixel as `phases`.
///
/// `phases` holds the tap weights at each fraction of a pixel. `rows` is scratch memory for rows filtered along x.
fn upsample(
    image: &InterpolatedImage,
    corner: Pixel,
    side: usize,
    phases: &[[f32; 6]],
    rows: &mut [f32],
    out: &mut [f32],
) {
    let factor = phases.len();
    let lines = (side - 1) / factor + 6;
    for line in 0..lines {
        let (taps, _) = image.taps::<6>(corner.x as isize, corner.y as isize + line as isize);
        for (fine, value) in rows[line * side..(line + 1) * side].iter_mut().enumerate() {
            let taps = &taps[fine / factor..][..6];
            *value = taps.iter().zip(&phases[fine % factor]).map(|(tap, weight)| tap * weight).sum();
        }
    }
    for (fine, target) in out.chunks_exact_mut(side).take(side).enumerate() {
        target.fill(0.0);
        for (tap, weight) in phases[fine % factor].iter().enumerate() {
            let line = &rows[(fine / factor + tap) * side..][..side];
            target.iter_mut().zip(line).for_each(|(value, row)| *value += weight * row);
        }
    }
}
