//! A picture of the displacement vectors over the reference.

use crate::image::ImageView;
use crate::results::FieldPoint;

/// Converts grey levels in DN to 8 bits, with 0 black and the maximum white.
pub(super) fn grey_picture(image: ImageView<'_>) -> image::RgbImage {
    let high = image.data().iter().fold(1.0_f32, |high, level| high.max(*level));
    image::RgbImage::from_fn(image.width() as u32, image.height() as u32, |x, y| {
        let level = image.at(x as usize, y as usize).unwrap_or(0.0);
        image::Rgb([(255.0 * level / high) as u8; 3])
    })
}

/// Draws the reference in grey with an arrow per vector, scaled so that the longest spans one step.
///
/// A subset without a displacement is a blue dot.
pub fn draw_vectors(image: ImageView<'_>, field: &[FieldPoint], step_px: u32) -> image::RgbImage {
    let mut picture = grey_picture(image);
    let longest = field.iter().filter_map(|p| p.displacement).map(|d| d.u_px.hypot(d.v_px)).fold(0.0, f32::max);
    let gain = if longest > 0.0 { step_px as f32 / longest } else { 0.0 };
    for point in field {
        let (color, end) = match point.displacement {
            Some(d) => ([255, 60, 40], [point.x_px + gain * d.u_px, point.y_px + gain * d.v_px]),
            None => ([40, 120, 255], [point.x_px, point.y_px]),
        };
        draw_line(&mut picture, [point.x_px, point.y_px], end, color);
    }
    picture
}

/// Draws a straight line with a dot at its start, in pixels of the image; clips it at the edge.
fn draw_line(picture: &mut image::RgbImage, from: [f32; 2], to: [f32; 2], color: [u8; 3]) {
    let span = [to[0] - from[0], to[1] - from[1]];
    let steps = span[0].abs().max(span[1].abs()).ceil().max(1.0) as i32;
    let mut dot = |x: f32, y: f32| {
        let (x, y) = (x.round(), y.round());
        if x >= 0.0 && y >= 0.0 && x < picture.width() as f32 && y < picture.height() as f32 {
            picture.put_pixel(x as u32, y as u32, image::Rgb(color));
        }
    };
    for k in 0..=steps {
        let along = k as f32 / steps as f32;
        dot(from[0] + along * span[0], from[1] + along * span[1]);
    }
    for (dx, dy) in [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)] {
        dot(from[0] + dx, from[1] + dy);
    }
}
