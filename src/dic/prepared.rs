//! A frame made ready for correlation.

use super::plane::Plane;
use super::spline;
use crate::image::ImageView;

/// Grey levels at which common sensors saturate, DN.
const SATURATED_LEVELS: [f32; 5] = [255.0, 1023.0, 4095.0, 16383.0, 65535.0];

/// A frame made ready: grey levels and gradients for use as reference, spline
/// coefficients for use as target.
///
/// Made by [`Correlator::prepare`](super::Correlator::prepare); a frame that is
/// the target now and the reference later need only be prepared once.
#[derive(Debug, Clone, Default)]
pub struct Prepared {
    pub(super) levels: Plane,
    pub(super) gradient_x: Plane,
    pub(super) gradient_y: Plane,
    pub(super) coefficients: Plane,
    /// Taken off every grey level, so that sums in single precision lose nothing, DN.
    pub(super) offset: f32,
    /// The level at which the frame is saturated, offset taken off; infinite if it is not.
    pub(super) saturation: f32,
    scratch: Vec<f32>,
}

impl Prepared {
    /// Pixels a row.
    pub fn width(&self) -> usize {
        self.levels.width()
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.levels.height()
    }

    /// Makes `image` ready in this memory.
    pub(super) fn fill(&mut self, image: ImageView<'_>) {
        let (width, height) = (image.width(), image.height());
        let highest = image.data().iter().fold(f32::NEG_INFINITY, |high, level| high.max(*level));
        let sum: f64 = image.data().iter().map(|level| f64::from(*level)).sum();
        self.offset = (sum / (width * height).max(1) as f64).round() as f32;
        let saturated = SATURATED_LEVELS.iter().any(|level| (level - highest).abs() < 0.5);
        self.saturation = if saturated { highest - self.offset } else { f32::INFINITY };
        for plane in [&mut self.levels, &mut self.gradient_x, &mut self.gradient_y, &mut self.coefficients] {
            plane.reshape(width, height);
        }
        for y in 0..height {
            let offset = self.offset;
            let row = self.levels.row_mut(y);
            row.iter_mut().zip(image.row(y)).for_each(|(level, pixel)| *level = pixel - offset);
            self.coefficients.row_mut(y).copy_from_slice(row);
        }
        if width > 0 && height > 0 {
            self.levels.mirror_margin();
            self.fill_gradients();
            spline::prefilter(&mut self.coefficients, &mut self.scratch);
        }
    }

    /// Fourth-order central differences; second order one pixel from the edge, one-sided on it.
    fn fill_gradients(&mut self) {
        let (width, height) = (self.levels.width(), self.levels.height());
        for y in 0..height {
            let row = self.levels.row(y);
            gradient_along(row, self.gradient_x.row_mut(y));
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
                let pairs = shifted(-2).iter().zip(shifted(2)).zip(shifted(-1).iter().zip(shifted(1)));
                for (out, ((a, d), (b, c))) in target.iter_mut().zip(pairs) {
                    *out = ((a - d) + 8.0 * (c - b)) * (1.0 / 12.0);
                }
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

/// The gradient along one row.
fn gradient_along(row: &[f32], gradient: &mut [f32]) {
    let width = row.len();
    for x in (0..width).filter(|x| *x < 2 || *x + 2 >= width) {
        let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
        gradient[x] = (row[right] - row[left]) / (right - left).max(1) as f32;
    }
    if width < 5 {
        return;
    }
    let taps = row.iter().zip(&row[1..]).zip(row[3..].iter().zip(&row[4..]));
    for (out, ((a, b), (c, d))) in gradient[2..].iter_mut().zip(taps) {
        *out = ((a - d) + 8.0 * (c - b)) * (1.0 / 12.0);
    }
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
        let mut prepared = Prepared::default();
        prepared.fill(cubic.view());
        assert!((prepared.gradient_x.row(5)[4] - 0.3 * 16.0).abs() < 1e-3);
        assert!((prepared.gradient_y.row(5)[4] - 0.4 * 5.0).abs() < 1e-3);
        prepared.fill(ramp.view());
        for y in 0..11 {
            assert!(prepared.gradient_x.row(y).iter().all(|g| (g - 3.0).abs() < 1e-4));
            assert!(prepared.gradient_y.row(y).iter().all(|g| (g + 2.0).abs() < 1e-4));
        }
    }

    #[test]
    fn one_pixel_frames_are_prepared_without_a_fault() {
        let mut prepared = Prepared::default();
        prepared.fill(Image::new(1, 1).view());
        assert_eq!((prepared.width(), prepared.height()), (1, 1));
        assert_eq!(prepared.gradient_x.row(0), [0.0]);
    }
}
