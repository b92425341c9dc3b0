//! The pixels to evaluate, and the statistics of the frames.

use super::grab::Grabbed;
use crate::failure::Failure;
use crate::image::{Correction, Frame, Image};
use crate::numeric;
use crate::results::PairField;

/// The pixels of the bodies, or of the whole image if no body was found.
pub(super) struct Region {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) mask: Vec<bool>,
}

impl Region {
    /// Returns the pixels covered by subsets of `subset_px`, or all pixels of the image if there are no subsets.
    pub(super) fn from_subsets(fields: &[&PairField], subset_px: u32, width: usize, height: usize) -> Self {
        let mut mask = vec![false; width * height];
        let half = f64::from(subset_px) / 2.0;
        for point in fields.iter().flat_map(|field| &field.points) {
            let span = |at: f32, size: usize| {
                let (low, high) = ((f64::from(at) - half).ceil().max(0.0), (f64::from(at) + half).floor());
                (low as usize).min(size)..((high.max(-1.0) + 1.0) as usize).min(size)
            };
            for y in span(point.y_px, height) {
                mask[y * width..][span(point.x_px, width)].fill(true);
            }
        }
        if !mask.contains(&true) {
            mask.fill(true);
        }
        Self { width, height, mask }
    }

    /// Iterates over the indices, row by row, of the region's pixels whose four neighbours belong to it too.
    pub(super) fn inner_pixels(&self) -> impl Iterator<Item = usize> {
        let width = self.width;
        let rows = 1..self.height.saturating_sub(1);
        let places = rows.flat_map(move |y| (1..width.saturating_sub(1)).map(move |x| y * width + x));
        places.filter(move |at| [*at, at - 1, at + 1, at - width, at + width].iter().all(|at| self.mask[*at]))
    }

    /// Iterates over the values of the region's pixels.
    pub(super) fn values<'a>(&'a self, data: &'a [f32]) -> impl Iterator<Item = f32> + 'a {
        data.iter().zip(&self.mask).filter(|(_, inside)| **inside).map(|(value, _)| *value)
    }

    /// Returns the first column and row of the region, and one past the last; those of the image without a pixel.
    pub(super) fn bounds(&self) -> [usize; 4] {
        let places = || self.mask.iter().enumerate().filter(|(_, inside)| **inside).map(|(at, _)| at);
        let columns = || places().map(|at| at % self.width);
        let rows = || places().map(|at| at / self.width);
        [
            columns().min().unwrap_or(0),
            rows().min().unwrap_or(0),
            columns().max().map_or(self.width, |x| x + 1),
            rows().max().map_or(self.height, |y| y + 1),
        ]
    }
}

/// Pixel statistics over the kept frames.
pub(super) struct Stack {
    /// Mean over the frames, DN; of a moving scene the first frame.
    pub(super) mean: Image,
    /// Standard deviation over the frames, DN; empty for a moving scene.
    pub(super) noise: Vec<f32>,
    /// Maximum grey level of each pixel, DN.
    pub(super) highest: Vec<f32>,
    /// Minimum grey level of each pixel, DN.
    pub(super) lowest: Vec<f32>,
    /// Number of frames in the mean.
    pub(super) frames: usize,
}

impl Stack {
    /// Computes the statistics of the first `max_frames` frames after their correction.
    ///
    /// For mean and noise, the frames are scaled to the same mean grey level, so that flicker does not count. The
    /// extremes are not scaled.
    ///
    /// # Errors
    ///
    /// When a frame cannot be unpacked.
    pub(super) fn new(grabbed: &Grabbed, max_frames: usize, correction: &Correction) -> Result<Self, Failure> {
        let mut images = Vec::new();
        for (meta, bytes) in grabbed.frames.iter().take(max_frames) {
            let mut image = Image::default();
            Frame { meta: *meta, bytes }.unpack(&mut image)?;
            correction.correct(&mut image);
            images.push(image);
        }
        let (width, height) = (grabbed.format.width_px as usize, grabbed.format.height_px as usize);
        let count = images.len();
        let levels: Vec<f64> = images.iter().map(|image| mean(image.view().data())).collect();
        let level = levels.iter().sum::<f64>() / count.max(1) as f64;
        let (mut sum, mut square) = (vec![0.0_f64; width * height], vec![0.0_f64; width * height]);
        let (mut highest, mut lowest) = (vec![0.0_f32; width * height], vec![f32::INFINITY; width * height]);
        for (image, own) in images.iter().zip(&levels) {
            let gain = if *own > 0.0 { level / own } else { 1.0 };
            for (at, value) in image.view().data().iter().enumerate() {
                let even = gain * f64::from(*value);
                sum[at] += even;
                square[at] += even * even;
                highest[at] = highest[at].max(*value);
                lowest[at] = lowest[at].min(*value);
            }
        }
        let n = count as f64;
        let spread = |(sum, square): (&f64, &f64)| ((square - sum * sum / n) / (n - 1.0)).max(0.0).sqrt() as f32;
        let noise = if count > 1 { sum.iter().zip(&square).map(spread).collect() } else { Vec::new() };
        let mean = sum.iter().map(|sum| (sum / n) as f32).collect();
        Ok(Self { mean: Image::from_vec(mean, width, height)?, noise, highest, lowest, frames: count })
    }
}

/// Returns the mean of the values; 0 of nothing.
fn mean(data: &[f32]) -> f64 {
    data.iter().map(|value| f64::from(*value)).sum::<f64>() / data.len().max(1) as f64
}

/// Returns the quantile of the values at `share`, 0 to 1, whose order may change; 0 for none.
pub(super) fn quantile(values: &mut [f32], share: f64) -> f64 {
    numeric::quantile(values, share).map_or(0.0, f64::from)
}
