//! A picture of the displacement vectors over the reference.

use super::canvas::Canvas;
use crate::image::ImageView;
use crate::results::FieldPoint;

/// Converts grey levels in DN to 8 bits: 0 is black, and the maximum (at least 1 DN) white.
pub(super) fn grey_picture(image: ImageView<'_>) -> image::RgbImage {
    let high = image.data().iter().fold(1.0_f32, |high, level| high.max(*level));
    image::RgbImage::from_fn(image.width() as u32, image.height() as u32, |x, y| {
        let level = image.at(x as usize, y as usize).unwrap_or(0.0);
        image::Rgb([(255.0 * level / high) as u8; 3])
    })
}

/// The lengths in one or several fields that a common gain of their arrows follows from.
#[derive(Debug, Clone)]
pub struct ArrowScale {
    /// The longest displacement, px.
    longest_px: f32,
    /// The shortest distance of two consecutive points, px.
    step_px: f32,
}

impl Default for ArrowScale {
    fn default() -> Self {
        Self { longest_px: 0.0, step_px: f32::INFINITY }
    }
}

impl ArrowScale {
    /// Includes a field.
    pub fn add(&mut self, points: &[FieldPoint]) {
        let motions = points.iter().filter_map(|point| point.displacement);
        self.longest_px = motions.map(|d| d.u_px.hypot(d.v_px)).fold(self.longest_px, f32::max);
        let apart = points.windows(2).map(|pair| (pair[0].x_px - pair[1].x_px).hypot(pair[0].y_px - pair[1].y_px));
        self.step_px = apart.filter(|apart| *apart > 0.0).fold(self.step_px, f32::min);
    }

    /// Returns the gain with which the longest arrow spans this number of steps; 1 without a displacement.
    pub fn gain(&self, steps: f64) -> f64 {
        let gain = steps * f64::from(self.step_px) / f64::from(self.longest_px);
        if gain.is_finite() { gain } else { 1.0 }
    }
}

/// Draws the reference in grey with an arrow per displacement.
///
/// Arrows are scaled so that the longest spans one grid step, `step_px`. A subset without a displacement is a blue dot.
pub fn draw_vectors(image: ImageView<'_>, field: &[FieldPoint], step_px: u32) -> image::RgbImage {
    let mut canvas = Canvas::from_picture(grey_picture(image));
    let longest = field.iter().filter_map(|p| p.displacement).map(|d| d.u_px.hypot(d.v_px)).fold(0.0, f32::max);
    let gain = if longest > 0.0 { step_px as f32 / longest } else { 0.0 };
    for point in field {
        let start = [point.x_px, point.y_px];
        let (color, end) = match point.displacement {
            Some(d) => ([255, 60, 40], [start[0] + gain * d.u_px, start[1] + gain * d.v_px]),
            None => ([40, 120, 255], start),
        };
        canvas.draw_line(start, end, color);
        canvas.cross(start, 1.0, color);
    }
    canvas.into_picture()
}
