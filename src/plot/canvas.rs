//! A frame in grey with lines, circles and numbers drawn over it, placed in the pixels of the frame.

use super::pixel_font;
use image::{Rgb, RgbImage};

/// The width to which small frames are enlarged, by a whole number, px.
const WIDTH_PX: u32 = 640;
/// The maximum number of dots of a line or a circle.
const MAX_DOTS: f32 = 100_000.0;

/// A colour: red, green and blue.
pub type Color = [u8; 3];

/// Stretches grey levels linearly, so that the lowest becomes 0 and the highest 255; equal levels become 0.
pub fn stretched_levels(levels: &[u8]) -> Vec<u8> {
    let low = levels.iter().copied().min().unwrap_or(0);
    let range = u32::from((levels.iter().copied().max().unwrap_or(255) - low).max(1));
    levels.iter().map(|level| (u32::from(*level - low) * 255 / range) as u8).collect()
}

/// A frame that is drawn on.
#[derive(Debug, Clone)]
pub struct Canvas {
    picture: RgbImage,
    /// The width of a pixel of the frame in the picture, px.
    zoom: f32,
    /// The first column and row of the frame in the picture.
    origin: [f32; 2],
    /// The width of lines in the picture, px.
    line_px: u32,
}

impl Canvas {
    /// Shows grey levels from 0 to 255 of a frame of this width, row by row.
    ///
    /// A frame narrower than 640 px is enlarged by a whole factor, at most 4.
    pub fn from_levels(levels: &[u8], width_px: u32) -> Self {
        let height_px = levels.len() as u32 / width_px.max(1);
        let zoom = WIDTH_PX.div_ceil(width_px.max(1)).clamp(1, 4);
        Self::from_part(levels, width_px, [0, 0, width_px, height_px], zoom)
    }

    /// Shows a part (x, y, width, height) of a frame, each pixel `zoom` px wide.
    ///
    /// # Panics
    ///
    /// If the part reaches below the last row or over the right edge of the frame.
    pub fn from_part(levels: &[u8], width_px: u32, part_px: [u32; 4], zoom: u32) -> Self {
        let [left, top, width, height] = part_px;
        assert!(left + width <= width_px, "columns {left} to {} of {width_px}", left + width);
        let picture = RgbImage::from_fn(width * zoom, height * zoom, |x, y| {
            Rgb([levels[((top + y / zoom) * width_px + left + x / zoom) as usize]; 3])
        });
        Self { picture, zoom: zoom as f32, origin: [left as f32, top as f32], line_px: 1 }
    }

    /// Draws on a picture in which a pixel of the frame is one pixel.
    pub(super) fn from_picture(picture: RgbImage) -> Self {
        Self { picture, zoom: 1.0, origin: [0.0; 2], line_px: 1 }
    }

    /// Draws lines of this width from now on, px of the picture.
    #[must_use]
    pub fn with_line(mut self, line_px: u32) -> Self {
        self.line_px = line_px;
        self
    }

    /// Returns the picture.
    pub fn into_picture(self) -> RgbImage {
        self.picture
    }

    /// Draws a dot as wide as lines, at a position in pixels of the frame; outside of it nothing is drawn.
    pub fn dot(&mut self, at: [f32; 2], color: Color) {
        // The centre of pixel (0, 0) is (0, 0).
        let half = (self.line_px - 1) as f32 / 2.0;
        let place = |at: f32, origin: f32| ((at - origin + 0.5) * self.zoom - half).floor();
        let (left, top) = (place(at[0], self.origin[0]), place(at[1], self.origin[1]));
        for (dx, dy) in (0..self.line_px).flat_map(|dy| (0..self.line_px).map(move |dx| (dx, dy))) {
            let (x, y) = (left + dx as f32, top + dy as f32);
            if x >= 0.0 && y >= 0.0 && x < self.picture.width() as f32 && y < self.picture.height() as f32 {
                self.picture.put_pixel(x as u32, y as u32, Rgb(color));
            }
        }
    }

    /// Draws a straight line between two positions in pixels of the frame.
    pub fn draw_line(&mut self, from: [f32; 2], to: [f32; 2], color: Color) {
        let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) * self.zoom).ceil().clamp(1.0, MAX_DOTS);
        for k in 0..=steps as u32 {
            let along = k as f32 / steps;
            self.dot([from[0] + along * (to[0] - from[0]), from[1] + along * (to[1] - from[1])], color);
        }
    }

    /// Draws the lines between consecutive points, px of the frame.
    pub fn path(&mut self, points: &[[f32; 2]], color: Color) {
        points.windows(2).for_each(|pair| self.draw_line(pair[0], pair[1], color));
    }

    /// Draws a circle, px of the frame.
    pub fn circle(&mut self, center: [f32; 2], radius_px: f32, color: Color) {
        let [x, y] = center;
        let steps = (8.0 * radius_px * self.zoom).clamp(16.0, MAX_DOTS) as u32;
        for k in 0..steps {
            let (sin, cos) = (std::f32::consts::TAU * k as f32 / steps as f32).sin_cos();
            self.dot([x + radius_px * cos, y + radius_px * sin], color);
        }
    }

    /// Draws a circle of separate dots, px of the frame.
    pub fn dotted_circle(&mut self, center: [f32; 2], radius_px: f32, color: Color) {
        let [x, y] = center;
        const DOT_DISTANCE_PX: f32 = 7.0;
        let count = (std::f32::consts::TAU * radius_px * self.zoom / DOT_DISTANCE_PX).clamp(12.0, MAX_DOTS) as u32;
        for k in 0..count {
            let (sin, cos) = (std::f32::consts::TAU * k as f32 / count as f32).sin_cos();
            self.dot([x + radius_px * cos, y + radius_px * sin], color);
        }
    }

    /// Draws an upright cross whose arms are `half_px` long, px of the frame.
    pub fn cross(&mut self, center: [f32; 2], half_px: f32, color: Color) {
        let [x, y] = center;
        self.draw_line([x - half_px, y], [x + half_px, y], color);
        self.draw_line([x, y - half_px], [x, y + half_px], color);
    }

    /// Draws the outline of a rectangle (x, y, width, height), px of the frame.
    pub fn rectangle(&mut self, rectangle: [f32; 4], color: Color) {
        let [x, y, width, height] = rectangle;
        let (right, bottom) = (x + width, y + height);
        self.path(&[[x, y], [right, y], [right, bottom], [x, bottom], [x, y]], color);
    }

    /// Mixes the pixels (x, y) of the frame for which `is_marked` holds with one third of a colour.
    pub fn tint(&mut self, is_marked: impl Fn(u32, u32) -> bool, color: Color) {
        let (zoom, origin) = (self.zoom, self.origin);
        for (x, y, pixel) in self.picture.enumerate_pixels_mut() {
            let at = |place: u32, origin: f32| (place as f32 / zoom + origin) as u32;
            if is_marked(at(x, origin[0]), at(y, origin[1])) {
                (0..3).for_each(|k| pixel.0[k] = ((2 * u16::from(pixel.0[k]) + u16::from(color[k])) / 3) as u8);
            }
        }
    }

    /// Writes a short text in black on a box of this colour, with the lower left corner at a position in pixels of the
    /// frame.
    ///
    /// The box is moved into the picture. The font has digits, minus, point and the letters of lengths: m, p, x.
    pub fn label(&mut self, corner: [f32; 2], text: &str, color: Color) {
        const FONT_SCALE: u32 = 3;
        let (width, height) = (pixel_font::width(text, FONT_SCALE) + 6, pixel_font::height(FONT_SCALE) + 6);
        let place = |at: f32, origin: f32| ((at - origin + 0.5) * self.zoom).max(0.0) as u32;
        let left = place(corner[0], self.origin[0]).min(self.picture.width().saturating_sub(width));
        let top =
            place(corner[1], self.origin[1]).saturating_sub(height).min(self.picture.height().saturating_sub(height));
        for (x, y) in (top..top + height).flat_map(|y| (left..left + width).map(move |x| (x, y))) {
            if x < self.picture.width() && y < self.picture.height() {
                self.picture.put_pixel(x, y, Rgb(color));
            }
        }
        pixel_font::write(&mut self.picture, left + 3, top + 3, FONT_SCALE, text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: Color = [255, 0, 0];

    #[test]
    fn a_part_is_drawn_on_in_the_pixels_of_the_frame() {
        let levels: Vec<u8> = (0..200).collect();
        let mut canvas = Canvas::from_part(&levels, 20, [10, 4, 6, 5], 3);
        canvas.dot([12.0, 6.0], RED);
        let picture = canvas.into_picture();
        assert_eq!(picture.dimensions(), (18, 15));
        assert_eq!((picture.get_pixel(0, 0).0, picture.get_pixel(17, 14).0), ([90; 3], [175; 3]));
        assert_eq!(picture.get_pixel(7, 7).0, RED, "the middle of the pixel");
    }

    #[test]
    #[should_panic(expected = "columns 3 to 9 of 8")]
    fn a_part_over_the_right_edge_is_refused() {
        Canvas::from_part(&[0; 64], 8, [3, 0, 6, 2], 1);
    }

    #[test]
    fn whatever_lies_outside_is_left_out() {
        let mut canvas = Canvas::from_part(&[0; 64], 8, [0, 0, 8, 8], 1).with_line(3);
        canvas.circle([100.0, 100.0], 5.0, RED);
        canvas.draw_line([-9.0, 3.0], [30.0, 3.0], RED);
        canvas.rectangle([-5.0, -5.0, 50.0, 50.0], RED);
        canvas.label([50.0, 50.0], "10 mm", RED);
        let picture = canvas.into_picture();
        assert_eq!((picture.get_pixel(4, 3).0, picture.get_pixel(4, 4).0, picture.get_pixel(4, 2).0), (RED, RED, RED));
    }
}
