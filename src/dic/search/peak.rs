//! Peaks of a correlation surface.

use multiversion::multiversion;

use crate::dic::image::{InterpolatedImage, Interpolation, PaddedImage};
use crate::numeric::LANES;

/// The radius of the interpolated patch around a peak, samples.
const REACH: usize = 6;

/// The sub-sample position of a peak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::dic) struct Peak {
    /// The column of the highest sample.
    pub(in crate::dic) column: usize,
    /// The row of the highest sample.
    pub(in crate::dic) row: usize,
    /// The offset of the top from the highest sample along x, -1 to 1.
    pub(in crate::dic) dx: f64,
    /// The offset along y, -1 to 1.
    pub(in crate::dic) dy: f64,
    /// The height of the top.
    pub(in crate::dic) height: f64,
}

/// A correlation surface; missing samples are -infinity.
#[derive(Debug, Clone, Copy)]
pub(in crate::dic) struct Surface<'a> {
    pub(in crate::dic) data: &'a [f32],
    pub(in crate::dic) columns: usize,
}

impl Surface<'_> {
    /// Returns the number of rows.
    fn rows(&self) -> usize {
        self.data.len() / self.columns
    }

    /// Returns the nine samples around (column, row), row-major; `None` at the border and next to missing samples.
    fn neighbourhood(&self, column: usize, row: usize) -> Option<[f32; 9]> {
        if column == 0 || row == 0 || column + 1 >= self.columns || row + 1 >= self.rows() {
            return None;
        }
        let patch = std::array::from_fn(|k| self.data[(row + k / 3 - 1) * self.columns + column + k % 3 - 1]);
        patch.iter().all(|value| value.is_finite()).then_some(patch)
    }

    /// Fits the top of the peak whose highest sample is at (column, row).
    ///
    /// The fit is a least-squares paraboloid, with the cross term, through the logarithm of the nine samples. Without a
    /// maximum, and next to samples that are missing or not positive, the sample itself is returned.
    pub(in crate::dic) fn fit_top(&self, column: usize, row: usize) -> Peak {
        let height = f64::from(self.data[row * self.columns + column]);
        let plain = Peak { column, row, dx: 0.0, dy: 0.0, height };
        let Some(patch) = self.neighbourhood(column, row).filter(|patch| patch.iter().all(|value| *value > 0.0)) else {
            return plain;
        };
        match fit_paraboloid(&patch.map(|value| f64::from(value).ln())) {
            Some((dx, dy, top)) => Peak { dx, dy, height: top.exp(), ..plain },
            None => plain,
        }
    }

    /// Fits the top of a peak by a three-point Gaussian along each axis; the sample itself without a maximum.
    ///
    /// The height stays that of `peak`.
    ///
    /// C. E. Willert, M. Gharib, Exp. Fluids 10 (1991) 181, <https://doi.org/10.1007/BF00190388>.
    pub(in crate::dic) fn fit_gaussian(&self, peak: &Peak) -> Peak {
        let (column, row, sample) = (peak.column, peak.row, Peak { dx: 0.0, dy: 0.0, ..*peak });
        let Some(patch) = self.neighbourhood(column, row).filter(|patch| patch.iter().all(|value| *value > 0.0)) else {
            return sample;
        };
        let log = patch.map(|value| f64::from(value).ln());
        let top = |low: f64, middle: f64, high: f64| {
            let curvature = low - 2.0 * middle + high;
            if curvature < 0.0 { (0.5 * (low - high) / curvature).clamp(-1.0, 1.0) } else { 0.0 }
        };
        Peak { dx: top(log[3], log[4], log[5]), dy: top(log[1], log[4], log[7]), ..sample }
    }

    /// Finds the top of a peak on a spline through the samples around the highest one; the sample itself at the border.
    ///
    /// The height stays that of `peak`.
    pub(in crate::dic) fn fit_spline(&self, peak: &Peak) -> Peak {
        let (column, row) = (peak.column, peak.row);
        if self.neighbourhood(column, row).is_none() {
            return Peak { dx: 0.0, dy: 0.0, ..*peak };
        }
        let (left, top) = (column.saturating_sub(REACH), row.saturating_sub(REACH));
        let (right, bottom) = ((column + REACH).min(self.columns - 1), (row + REACH).min(self.rows() - 1));
        let mut samples = PaddedImage::default();
        samples.reshape(right - left + 1, bottom - top + 1);
        for y in top..=bottom {
            let line = &self.data[y * self.columns + left..=y * self.columns + right];
            samples.row_mut(y - top).iter_mut().zip(line).for_each(|(value, sample)| *value = sample.max(-1.0));
        }
        samples.mirror_margin();
        let surface = InterpolatedImage::new(&samples, Interpolation::Optimised);
        let (x, y) = ((column - left) as f64, (row - top) as f64);
        let (mut dx, mut dy) = (0.0, 0.0);
        // Fits smaller and smaller paraboloids to the spline. Without a maximum, moves to the highest sample.
        for step in [0.5, 0.4, 0.15, 0.04] {
            let place = |k: usize, offset: f64| offset + step * (k as f64 - 1.0);
            let value = |k: usize| surface.value_at(x + place(k % 3, dx), y + place(k / 3, dy));
            let values: [f64; 9] = std::array::from_fn(|k| f64::from(value(k)));
            let highest = (0..9).fold(4, |best, k| if values[k] > values[best] { k } else { best });
            let (sx, sy) = match fit_paraboloid(&values) {
                Some((sx, sy, _)) => (sx, sy),
                None => ((highest % 3) as f64 - 1.0, (highest / 3) as f64 - 1.0),
            };
            dx = (dx + step * sx).clamp(-1.0, 1.0);
            dy = (dy + step * sy).clamp(-1.0, 1.0);
        }
        Peak { dx, dy, ..*peak }
    }

    /// Returns column and row of the highest sample, the first of equal ones; `None` if all are missing.
    pub(in crate::dic) fn highest_sample(&self) -> Option<(usize, usize)> {
        let mut best = (f32::NEG_INFINITY, 0);
        for (row, line) in self.data.chunks_exact(self.columns).enumerate() {
            let high = maximum(line);
            if high > best.0 {
                best = (high, row);
            }
        }
        let (high, row) = best;
        let line = &self.data[row * self.columns..][..self.columns];
        let column = line.iter().position(|value| *value >= high)?;
        high.is_finite().then_some((column, row))
    }

    /// Returns the fitted top of the highest positive local maximum outside the neighbourhood of (column, row).
    ///
    /// Samples of the border do not count. `None` if there is no other maximum.
    ///
    /// `candidates` is scratch memory for at least one row.
    pub(in crate::dic) fn second_peak(&self, column: usize, row: usize, candidates: &mut [f32]) -> Option<Peak> {
        let candidates = &mut candidates[..self.columns];
        let mut best: Option<(f32, usize, usize)> = None;
        for y in 1..self.rows().saturating_sub(1) {
            let line = |y: usize| &self.data[y * self.columns..(y + 1) * self.columns];
            local_maxima(line(y - 1), line(y), line(y + 1), candidates);
            if y.abs_diff(row) <= 1 {
                let near = column.saturating_sub(1)..(column + 2).min(self.columns);
                candidates[near].fill(0.0);
            }
            let high = maximum(candidates);
            if high > best.map_or(0.0, |(high, ..)| high) {
                let x = candidates.iter().position(|value| *value >= high)?;
                best = Some((high, x, y));
            }
        }
        best.map(|(_, x, y)| self.fit_top(x, y))
    }
}

/// Returns the highest value, minus infinity without any; NaN is skipped.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn maximum(values: &[f32]) -> f32 {
    let mut lanes = [f32::NEG_INFINITY; LANES];
    let chunks = values.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane = if *value > *lane { *value } else { *lane };
        }
    }
    lanes.iter().chain(rest).fold(f32::NEG_INFINITY, |high, value| if *value > high { *value } else { high })
}

/// Copies the local maxima of `line` among their eight neighbours; 0 elsewhere and at both ends.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn local_maxima(above: &[f32], line: &[f32], below: &[f32], out: &mut [f32]) {
    let count = line.len();
    let (above, below, out) = (&above[..count], &below[..count], &mut out[..count]);
    out[0] = 0.0;
    out[count - 1] = 0.0;
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    for x in 1..count - 1 {
        let left = larger(larger(above[x - 1], line[x - 1]), below[x - 1]);
        let right = larger(larger(above[x + 1], line[x + 1]), below[x + 1]);
        let around = larger(larger(left, right), larger(above[x], below[x]));
        out[x] = if line[x] >= around { line[x] } else { 0.0 };
    }
}

/// Fits a paraboloid to a 3 x 3 patch by least squares and returns its top: dx, dy, in samples, and height.
///
/// `None` without a maximum within one sample of the middle. The patch is row-major.
pub(in crate::dic) fn fit_paraboloid(patch: &[f64; 9]) -> Option<(f64, f64, f64)> {
    let sum = |weight: fn(f64, f64) -> f64| -> f64 {
        patch.iter().enumerate().map(|(k, value)| value * weight((k % 3) as f64 - 1.0, (k / 3) as f64 - 1.0)).sum()
    };
    let (x, y) = (sum(|x, _| x) / 6.0, sum(|_, y| y) / 6.0);
    let xx = sum(|x, _| x * x - 2.0 / 3.0) / 2.0;
    let yy = sum(|_, y| y * y - 2.0 / 3.0) / 2.0;
    let xy = sum(|x, y| x * y) / 4.0;
    let mean = sum(|_, _| 1.0) / 9.0 - (xx + yy) * 2.0 / 3.0;
    let determinant = 4.0 * xx * yy - xy * xy;
    if xx >= 0.0 || determinant <= 0.0 {
        return None;
    }
    let (dx, dy) = ((xy * y - 2.0 * yy * x) / determinant, (xy * x - 2.0 * xx * y) / determinant);
    (dx.abs() <= 1.0 && dy.abs() <= 1.0).then_some((dx, dy, mean + 0.5 * (x * dx + y * dy)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bumps(centers: &[(f64, f64, f64)]) -> Vec<f32> {
        (0..21 * 25)
            .map(|k| {
                let (x, y) = (f64::from(k % 25), f64::from(k / 25));
                let height = |(cx, cy, h): &(f64, f64, f64)| {
                    h * (-((x - cx).powi(2) / 6.0 + (y - cy).powi(2) / 4.0 + (x - cx) * (y - cy) / 8.0)).exp()
                };
                centers.iter().map(height).sum::<f64>() as f32
            })
            .collect()
    }

    #[test]
    fn the_top_of_a_tilted_gaussian_is_exact() {
        for (x, y) in [(8.0, 9.0), (8.3, 9.4), (7.55, 8.61)] {
            let data = bumps(&[(x, y, 0.9)]);
            let surface = Surface { data: &data, columns: 25 };
            let (column, row) = surface.highest_sample().unwrap();
            let peak = surface.fit_top(column, row);
            assert!((column as f64 + peak.dx - x).abs() < 1e-4, "{peak:?}");
            assert!((row as f64 + peak.dy - y).abs() < 1e-4, "{peak:?}");
            assert!((peak.height - 0.9).abs() < 1e-4, "{peak:?}");
        }
    }

    #[test]
    fn the_second_peak_is_the_next_maximum_not_the_shoulder_of_the_first() {
        let data = bumps(&[(6.3, 6.2, 1.0), (17.2, 12.1, 0.7), (5.0, 17.0, 0.6)]);
        let surface = Surface { data: &data, columns: 25 };
        let (column, row) = surface.highest_sample().unwrap();
        let second = surface.second_peak(column, row, &mut [f32::NAN; 25]).unwrap();
        assert_eq!((second.column, second.row), (17, 12));
        assert!((second.height - 0.7).abs() < 1e-3, "{second:?}");
    }

    #[test]
    fn a_surface_without_samples_has_no_peak() {
        assert!(Surface { data: &[f32::NEG_INFINITY; 9], columns: 3 }.highest_sample().is_none());
    }
}
