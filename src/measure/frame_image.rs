//! The current frame, of which only the requested boxes are unpacked.

use super::bounding_box::BoundingBox;
use crate::image::{Correction, Frame, Image, ImageView};

/// The grey levels of one frame at a time.
pub(super) struct FrameImage {
    image: Image,
    correction: Correction,
    /// Left, top, right and bottom of the unpacked rectangle, the last two outside.
    unpacked: [u32; 4],
}

impl FrameImage {
    /// Allocates an image for frames of this size, corrected for their camera.
    pub(super) fn new(width_px: usize, height_px: usize, correction: Correction) -> Self {
        Self { image: Image::new(width_px, height_px), correction, unpacked: [0; 4] }
    }

    /// Corrects an image that was unpacked elsewhere.
    pub(super) fn correct(&self, image: &mut Image) {
        self.correction.correct(image);
    }

    /// Begins a new frame, of which nothing is unpacked yet.
    pub(super) fn begin(&mut self) {
        self.unpacked = [0; 4];
    }

    /// Returns the frame, unpacked at least within a rectangle: x, y, width and height, clipped to the frame.
    ///
    /// Pixels outside the rectangle may belong to earlier frames.
    pub(super) fn unpack(&mut self, frame: &Frame<'_>, rectangle: [u32; 4]) -> ImageView<'_> {
        let [x, y, width, height] = rectangle;
        let (right, bottom) = (frame.meta.width_px, frame.meta.height_px);
        let requested =
            [x.min(right), y.min(bottom), x.saturating_add(width).min(right), y.saturating_add(height).min(bottom)];
        let [left, top, right, bottom] = self.unpacked;
        let holds = left <= requested[0] && top <= requested[1] && right >= requested[2] && bottom >= requested[3];
        if !holds {
            let is_first = left >= right || top >= bottom;
            let both =
                [left.min(requested[0]), top.min(requested[1]), right.max(requested[2]), bottom.max(requested[3])];
            self.unpacked = if is_first { requested } else { both };
            // The size and the bytes were checked when the frame arrived.
            let _ = self.correction.unpack(frame, self.unpacked, &mut self.image);
        }
        self.image.view()
    }

    /// Returns the frame, unpacked at least within a box, or fully if there is none.
    pub(super) fn unpack_box(&mut self, frame: &Frame<'_>, bounds: Option<BoundingBox>) -> ImageView<'_> {
        match bounds {
            Some(bounds) => self.unpack(frame, bounds.rectangle()),
            None => self.unpack_all(frame),
        }
    }

    /// Returns the full frame.
    pub(super) fn unpack_all(&mut self, frame: &Frame<'_>) -> ImageView<'_> {
        self.unpack(frame, [0, 0, u32::MAX, u32::MAX])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::FrameMeta;

    #[test]
    fn requested_pixels_belong_to_the_current_frame() {
        let meta = FrameMeta { width_px: 8, height_px: 6, stride_bytes: 8, ..FrameMeta::default() };
        let mut image = FrameImage::new(8, 6, Correction::default());
        for round in 0..3_u8 {
            let bytes: Vec<u8> = (0..48).map(|k| k + 50 * round).collect();
            let frame = Frame { meta, bytes: &bytes };
            image.begin();
            let level = |x: usize, y: usize| Some(f32::from(bytes[8 * y + x]));
            assert_eq!(image.unpack(&frame, [2, 1, 3, 2]).at(4, 2), level(4, 2));
            let view = image.unpack(&frame, [5, 4, 9, 9]);
            assert_eq!((view.at(7, 5), view.at(2, 1)), (level(7, 5), level(2, 1)));
            let view = image.unpack_all(&frame);
            assert!((0..48).all(|k| view.at(k % 8, k / 8) == level(k % 8, k / 8)));
        }
    }
}
