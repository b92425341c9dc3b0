//! A frame prepared for correlation.

use multiversion::multiversion;

use super::interpolation::{InterpolatedImage, Interpolation};
use super::padded_image::PaddedImage;
use crate::dic::geometry::{GridPoint, Pixel};
use crate::image::{ImageView, is_saturated};
use crate::numeric::LANES;

/// A prepared frame: grey levels and gradients for use as reference, interpolated image for use as target.
///
/// Created by [`Correlator::prepare`](crate::dic::Correlator::prepare). A frame that is first a target and later a
/// reference needs to be prepared only once.
#[derive(Debug, Clone, Default)]
pub struct PreparedFrame {
    pub(in crate::dic) levels: PaddedImage,
    pub(in crate::dic) gradient_x: PaddedImage,
    pub(in crate::dic) gradient_y: PaddedImage,
    pub(in crate::dic) interpolated: InterpolatedImage,
    /// The offset subtracted from every grey level to keep single-precision sums exact, DN.
    pub(in crate::dic) offset: f32,
    /// The root mean square of the levels, which gives the relative gain of two frames, DN.
    pub(in crate::dic) contrast: f32,
    /// The saturation level minus the offset; infinite if the frame is not saturated.
    pub(in crate::dic) saturation: f32,
    /// The origin of the prepared part of the frame, px.
    origin: GridPoint,
    /// The size of the whole frame, px.
    size: (usize, usize),
}

impl PreparedFrame {
    /// The width of the whole frame, px.
    pub fn width(&self) -> usize {
        self.size.0
    }

    /// The height of the whole frame, px.
    pub fn height(&self) -> usize {
        self.size.1
    }

    /// The number of pixels that its memory holds.
    pub fn reserved_px(&self) -> usize {
        self.levels.reserved_px()
    }

    /// Whether the whole frame is prepared.
    pub(in crate::dic) fn is_whole(&self) -> bool {
        self.size == (self.levels.width(), self.levels.height())
    }

    /// Converts a position in the frame to one relative to the corner of the prepared part, px; negative left of it or
    /// above it.
    pub(in crate::dic) fn local(&self, point: GridPoint) -> Pixel {
        Pixel { x: point.x as i32 - self.origin.x as i32, y: point.y as i32 - self.origin.y as i32 }
    }

    /// Returns the approximate gain from this frame to `target`: the ratio of their contrasts, 1 if it is undefined.
    pub(in crate::dic) fn gain_to(&self, target: &Self) -> f32 {
        relative_gain(self.contrast, target.contrast)
    }

    /// Prepares the whole of `image`, reusing memory. See [`Self::fill_part`].
    pub(in crate::dic) fn fill(&mut self, image: ImageView<'_>, interpolation: Interpolation) {
        self.fill_part(image, [0, 0, image.width() as u32, image.height() as u32], interpolation);
    }

    /// Prepares a part of `image`, reusing memory: x, y, width and height, px, clipped to the image.
    ///
    /// Computes levels, gradients, interpolation coefficients, offset, contrast and saturation level. A part without
    /// pixels has no coefficients and no contrast.
    pub(in crate::dic) fn fill_part(&mut self, image: ImageView<'_>, part: [u32; 4], interpolation: Interpolation) {
        self.size = (image.width(), image.height());
        let (left, top) = ((part[0] as usize).min(self.size.0), (part[1] as usize).min(self.size.1));
        let (width, height) = ((part[2] as usize).min(self.size.0 - left), (part[3] as usize).min(self.size.1 - top));
        self.origin = GridPoint { x: left as u32, y: top as u32 };
        let row = |y: usize| &image.row(top + y)[left..left + width];
        let (highest, sum) = highest_and_sum((0..height).map(row));
        self.offset = (sum / (width * height).max(1) as f64).round() as f32;
        self.saturation = if is_saturated(highest) { highest - self.offset } else { f32::INFINITY };
        for plane in [&mut self.levels, &mut self.gradient_x, &mut self.gradient_y] {
            plane.reshape(width, height);
        }
        if width == 0 || height == 0 {
            self.interpolated.plane.reshape(0, 0);
            (self.contrast, self.interpolated.contrast) = (0.0, 0.0);
            return;
        }
        let squares: f64 = (0..height).map(|y| subtract_offset(row(y), self.offset, self.levels.row_mut(y))).sum();
        self.contrast = (squares / (width * height) as f64).sqrt() as f32;
        self.levels.mirror_margin();
        self.fill_gradients();
        self.interpolated.fill(&self.levels, interpolation);
        self.interpolated.contrast = self.contrast;
    }

    /// Computes the gradients of the levels by fourth-order central differences, DN/px.
    ///
    /// They are of second order one pixel from the edge, and one-sided on it.
    fn fill_gradients(&mut self) {
        let (width, height) = (self.levels.width(), self.levels.height());
        for y in 0..height {
            let row = self.levels.row(y);
            gradient_along_row(row, self.gradient_x.row_mut(y));
            let distance = y.min(height - 1 - y);
            let start = self.levels.index(0, y as isize) as isize;
            let stride = self.levels.stride() as isize;
            let data = self.levels.data();
            let shifted = |rows: isize| {
                let from = (start + rows * stride) as usize;
                &data[from..from + width]
            };
            let target = self.gradient_y.row_mut(y);
            if distance >= 2 {
                fourth_order_difference([shifted(-2), shifted(-1), shifted(1), shifted(2)], target);
            } else {
                let (up, down) = (isize::from(y > 0), isize::from(y + 1 < height));
                let scale = 1.0 / (up + down).max(1) as f32;
                for (out, (b, c)) in target.iter_mut().zip(shifted(-up).iter().zip(shifted(down))) {
                    *out = (c - b) * scale;
                }
            }
        }
    }
}

/// Subtracts an offset from the pixels and returns the sum of squares of the differences, DN^2.
///
/// Pixels after the last whole group of eight are not summed: the sum gives an approximate contrast only.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn subtract_offset(pixels: &[f32], offset: f32, out: &mut [f32]) -> f64 {
    let mut sums = [0.0_f32; LANES];
    let (chunks, rest) = pixels.as_chunks::<LANES>();
    let (out, out_rest) = out[..pixels.len()].as_chunks_mut::<LANES>();
    for (out, chunk) in out.iter_mut().zip(chunks) {
        for lane in 0..LANES {
            out[lane] = chunk[lane] - offset;
            sums[lane] += out[lane] * out[lane];
        }
    }
    out_rest.iter_mut().zip(rest).for_each(|(out, pixel)| *out = pixel - offset);
    sums.iter().map(|sum| f64::from(*sum)).sum()
}

/// Returns the approximate gain from a reference to a target of these contrasts, DN; 1 if it is undefined.
pub(in crate::dic) fn relative_gain(contrast: f32, target_contrast: f32) -> f32 {
    let gain = target_contrast / contrast;
    if gain.is_finite() { gain } else { 1.0 }
}

/// Computes the gradient along one row, DN/px, by fourth-order central differences.
///
/// They are of second order one pixel from either end and one-sided at it. A row of fewer than five pixels has no
/// others.
fn gradient_along_row(row: &[f32], gradient: &mut [f32]) {
    let width = row.len();
    for x in (0..width.min(2)).chain(width.saturating_sub(2)..width) {
        let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
        gradient[x] = (row[right] - row[left]) / (right - left).max(1) as f32;
    }
    if width < 5 {
        return;
    }
    let inner = &mut gradient[2..width - 2];
    fourth_order_difference([row, &row[1..], &row[3..], &row[4..]], inner);
}

/// Computes derivatives per px by fourth-order central differences, from rows of samples at -2, -1, 1 and 2 px.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn fourth_order_difference(samples: [&[f32]; 4], out: &mut [f32]) {
    let [a, b, c, d] = samples.map(|part| &part[..out.len()]);
    for (out, ((a, d), (b, c))) in out.iter_mut().zip(a.iter().zip(d).zip(b.iter().zip(c))) {
        *out = ((a - d) + 8.0 * (c - b)) * (1.0 / 12.0);
    }
}

/// Returns the highest grey level of all rows, minus infinity without pixels, and the sum of all levels, DN.
fn highest_and_sum<'a>(rows: impl Iterator<Item = &'a [f32]>) -> (f32, f64) {
    rows.map(highest_and_sum_of_row)
        .fold((f32::NEG_INFINITY, 0.0), |(highest, sum), row| (highest.max(row.0), sum + row.1))
}

/// Returns the highest grey level and the sum of one row, DN.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl", "x86_64+avx2"))]
fn highest_and_sum_of_row(row: &[f32]) -> (f32, f64) {
    let (mut highest, mut sums) = ([f32::NEG_INFINITY; LANES], [0.0_f32; LANES]);
    let (chunks, rest) = row.as_chunks::<LANES>();
    for chunk in chunks {
        for lane in 0..LANES {
            sums[lane] += chunk[lane];
            highest[lane] = if chunk[lane] > highest[lane] { chunk[lane] } else { highest[lane] };
        }
    }
    for value in rest {
        sums[0] += value;
        highest[0] = highest[0].max(*value);
    }
    let highest = highest.into_iter().fold(f32::NEG_INFINITY, f32::max);
    (highest, sums.iter().map(|value| f64::from(*value)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    #[test]
    fn gradients_of_a_cubic_are_exact_inside_and_of_a_ramp_everywhere() {
        let mut cubic = Image::new(12, 11);
        let mut ramp = Image::new(12, 11);
        for (y, (a, b)) in cubic.rows_mut().zip(ramp.rows_mut()).enumerate() {
            for x in 0..12 {
                let (fx, fy) = (x as f32, y as f32);
                a[x] = 0.1 * fx * fx * fx + 0.2 * fy * fy;
                b[x] = 3.0 * fx - 2.0 * fy;
            }
        }
        let mut prepared = PreparedFrame::default();
        prepared.fill(cubic.view(), Interpolation::Optimised);
        assert!((prepared.gradient_x.row(5)[4] - 0.3 * 16.0).abs() < 1e-3);
        assert!((prepared.gradient_y.row(5)[4] - 0.4 * 5.0).abs() < 1e-3);
        prepared.fill(ramp.view(), Interpolation::Optimised);
        for y in 0..11 {
            assert!(prepared.gradient_x.row(y).iter().all(|g| (g - 3.0).abs() < 1e-4));
            assert!(prepared.gradient_y.row(y).iter().all(|g| (g + 2.0).abs() < 1e-4));
        }
    }

    #[test]
    fn a_part_without_pixels_keeps_nothing_of_the_frame_before() {
        let mut image = Image::new(40, 30);
        image.rows_mut().enumerate().for_each(|(y, row)| row.fill(5.0 * y as f32));
        let mut prepared = PreparedFrame::default();
        prepared.fill(image.view(), Interpolation::Optimised);
        assert!(prepared.contrast > 0.0 && prepared.interpolated.contrast > 0.0);
        prepared.fill_part(image.view(), [40, 0, 10, 10], Interpolation::Optimised);
        assert_eq!((prepared.interpolated.width(), prepared.interpolated.height()), (0, 0));
        assert!(prepared.contrast <= 0.0 && prepared.interpolated.contrast <= 0.0);
    }

    #[test]
    fn one_pixel_frames_are_prepared() {
        let mut prepared = PreparedFrame::default();
        prepared.fill(Image::new(1, 1).view(), Interpolation::Optimised);
        assert_eq!((prepared.width(), prepared.height()), (1, 1));
        assert_eq!(prepared.gradient_x.row(0), [0.0]);
    }
}
