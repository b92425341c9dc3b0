//! Warping of images by interpolation, as in the video generator of the speckle study.
//!
//! A [`World`](crate::synth::World) needs no interpolation and has no such error; this warp is for images of real balls.
//! Interpolation blurs details near one pixel in size. For speckles of at least 2 px^2 behind a lens blur of 0.7 px, a
//! displacement off the pixel grid has an error of 0.6 to 0.8 grey levels (rms over the ball, 8 bit) and up to
//! 0.0015 px.

use crate::image::{Image, ImageView};

/// An image ready to be warped: its cubic B-spline coefficients.
///
/// M. Unser, A. Aldroubi and M. Eden, IEEE Trans. Signal Process. 41 (1993) 821,
/// <https://doi.org/10.1109/78.193220>.
#[derive(Debug, Clone)]
pub struct PictureMover {
    coefficients: Vec<f64>,
    width: usize,
    height: usize,
}

impl PictureMover {
    /// Prepares an image of at least 4 x 4 pixels.
    ///
    /// # Panics
    ///
    /// If it is smaller.
    pub fn new(picture: ImageView<'_>) -> Self {
        let (width, height) = (picture.width(), picture.height());
        assert!(width >= 4 && height >= 4, "a picture of {width} x {height} pixels cannot be moved");
        let mut coefficients: Vec<f64> = picture.data().iter().copied().map(f64::from).collect();
        let mut line = Vec::new();
        for row in coefficients.chunks_exact_mut(width) {
            line.clear();
            line.extend_from_slice(row);
            spline_coefficients(&mut line);
            row.copy_from_slice(&line);
        }
        for column in 0..width {
            line.clear();
            line.extend(coefficients.iter().skip(column).step_by(width));
            spline_coefficients(&mut line);
            coefficients.iter_mut().skip(column).step_by(width).zip(&line).for_each(|(value, new)| *value = *new);
        }
        Self { coefficients, width, height }
    }

    /// Returns the image rotated about `center_px` by `angle_deg`, counter-clockwise on the screen, then shifted by
    /// `shift_px` (y down).
    ///
    /// Pixels from outside the image take the value of its border.
    pub fn moved(&self, center_px: [f64; 2], shift_px: [f64; 2], angle_deg: f64) -> Image {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let mut image = Image::new(self.width, self.height);
        for (row, pixels) in image.rows_mut().enumerate() {
            let dy = row as f64 - center_px[1] - shift_px[1];
            for (column, pixel) in pixels.iter_mut().enumerate() {
                let dx = column as f64 - center_px[0] - shift_px[0];
                // The inverse rotation: (x, y) came from (x cos - y sin, x sin + y cos).
                let x = center_px[0] + dx * cos - dy * sin;
                let y = center_px[1] + dx * sin + dy * cos;
                *pixel = self.at(x, y) as f32;
            }
        }
        image
    }

    /// Returns the interpolated grey level at a position, px; outside the image that of its border.
    pub fn at(&self, x_px: f64, y_px: f64) -> f64 {
        let (column, across) = place(x_px, self.width);
        let (row, down) = place(y_px, self.height);
        (0..4)
            .map(|step| {
                let start = mirrored(row + step, self.height) * self.width;
                let sum: f64 = (0..4)
                    .map(|step| across[step] * self.coefficients[start + mirrored(column + step, self.width)])
                    .sum();
                down[step] * sum
            })
            .sum()
    }
}

/// Returns the first of four coefficients, counted from one before the image, and their weights.
fn place(place_px: f64, length: usize) -> (usize, [f64; 4]) {
    let inside = place_px.clamp(0.0, (length - 1) as f64);
    let first = inside.floor();
    let t = inside - first;
    let s = 1.0 - t;
    let weights = [
        s * s * s / 6.0,
        (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
        (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
        t * t * t / 6.0,
    ];
    (first as usize, weights)
}

/// Returns the index of a coefficient counted from one before the image, which is mirrored at its border pixels.
fn mirrored(index: usize, length: usize) -> usize {
    match index {
        0 => 1,
        _ if index <= length => index - 1,
        _ => 2 * length - 1 - index,
    }
}

/// Converts values to cubic B-spline coefficients, in place; the line is mirrored at its ends.
fn spline_coefficients(line: &mut [f64]) {
    let pole = 3f64.sqrt() - 2.0;
    let last = line.len() - 1;
    // The powers of the pole vanish after some 30 steps.
    let reach = last.min(30);
    let start: f64 = (0..=reach).map(|step| line[step] * pole.powi(step as i32)).sum();
    line[0] = start;
    for index in 1..=last {
        line[index] += pole * line[index - 1];
    }
    line[last] = pole / (pole * pole - 1.0) * (line[last] + pole * line[last - 1]);
    for index in (0..last).rev() {
        line[index] = pole * (line[index + 1] - line[index]);
    }
    line.iter_mut().for_each(|value| *value *= 6.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::{MotionSetup, Scenario, World};

    /// Draws a static image and the same ball moved, both without interpolation.
    fn pair(shift_px: [f64; 2], angle_deg: f64) -> (Image, Image) {
        let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
        (scenario.camera.width_px, scenario.camera.height_px) = (150, 150);
        scenario.motion = MotionSetup::Constant {
            vx_px_frame: shift_px[0],
            vy_px_frame: shift_px[1],
            omega_deg_frame: angle_deg,
            start_px: [74.2, 74.6],
        };
        let world = World::new(&scenario).unwrap();
        (world.render_light(0), world.render_light(1))
    }

    #[test]
    fn a_picture_that_stays_is_unchanged() {
        let (picture, _) = pair([0.0, 0.0], 0.0);
        let moved = PictureMover::new(picture.view()).moved([74.2, 74.6], [0.0, 0.0], 0.0);
        for (here, there) in picture.view().data().iter().zip(moved.view().data()) {
            assert!((here - there).abs() < 1e-3, "{here} {there}");
        }
    }

    #[test]
    fn a_moved_picture_is_as_far_from_the_truth_as_stated() {
        for (shift_px, angle_deg) in [([0.5, 0.5], 0.0), ([0.37, -0.13], 0.0), ([1.23, 0.77], 2.0), ([0.0, 0.0], -1.3)]
        {
            let (picture, expected) = pair(shift_px, angle_deg);
            let moved = PictureMover::new(picture.view()).moved([74.2, 74.6], shift_px, angle_deg);
            let (moved, expected) = (moved.view(), expected.view());
            let (mut power, mut gradient, mut product, mut count) = (0.0, [0.0; 2], [0.0; 2], 0.0);
            for y in 15..135 {
                for x in 15..135 {
                    let at = |x: usize, y: usize| f64::from(expected.at(x, y).unwrap());
                    let difference = f64::from(moved.at(x, y).unwrap()) - at(x, y);
                    let slope = [0.5 * (at(x + 1, y) - at(x - 1, y)), 0.5 * (at(x, y + 1) - at(x, y - 1))];
                    power += difference * difference;
                    for axis in 0..2 {
                        gradient[axis] += slope[axis] * slope[axis];
                        product[axis] += slope[axis] * difference;
                    }
                    count += 1.0;
                }
            }
            let rms = f64::sqrt(power / count);
            let bias = [product[0] / gradient[0], product[1] / gradient[1]];
            eprintln!("{shift_px:?} {angle_deg} deg: {rms:.3} DN rms, bias {bias:.6?} px");
            assert!(rms < 0.9, "{shift_px:?}: {rms} DN");
            assert!(bias.iter().all(|part| part.abs() < 2e-3), "{shift_px:?}: {bias:?} px");
        }
    }
}
