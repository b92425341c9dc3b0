//! The current frame, of which only the requested boxes are unpacked.

use super::bounding_box::BoundingBox;
use crate::image::{Correction, Frame, Image, ImageView, PixelRect};

/// The grey levels of one frame at a time.
pub(super) struct FrameImage {
    image: Image,
    correction: Correction,
    /// The unpacked part.
    unpacked: PixelRect,
}

impl FrameImage {
    /// Allocates an image for frames of this size, corrected for their camera.
    pub(super) fn new(width_px: usize, height_px: usize, correction: Correction) -> Self {
        Self { image: Image::new(width_px, height_px), correction, unpacked: PixelRect::default() }
    }

    /// Linearizes the grey levels of a complete image that was unpacked elsewhere, and fills in its defective pixels.
    pub(super) fn correct_other(&self, image: &mut Image) {
        self.correction.correct(image);
    }

    /// Unpacks and corrects a complete frame into another image.
    ///
    /// The size and the bytes of the frame were checked when it arrived.
    pub(super) fn unpack_into(&self, frame: &Frame<'_>, image: &mut Image) {
        let _ = self.correction.unpack(frame, PixelRect::whole(u32::MAX, u32::MAX), image);
    }

    /// Begins a new frame, of which nothing is unpacked yet.
    pub(super) fn begin(&mut self) {
        self.unpacked = PixelRect::default();
    }

    /// Returns the frame, unpacked at least within a part, clipped to the frame.
    ///
    /// Pixels outside the part may belong to earlier frames.
    pub(super) fn unpack(&mut self, frame: &Frame<'_>, part: PixelRect) -> ImageView<'_> {
        let part = part.clipped(PixelRect::whole(frame.meta.width_px, frame.meta.height_px));
        if !self.unpacked.contains(part) {
            self.unpacked = if self.unpacked.is_empty() { part } else { self.unpacked.union(part) };
            // The size and the bytes were checked when the frame arrived.
            let _ = self.correction.unpack(frame, self.unpacked, &mut self.image);
        }
        self.image.view()
    }

    /// Returns the frame, unpacked at least within a box, or fully if there is none.
    pub(super) fn unpack_box(&mut self, frame: &Frame<'_>, bounds: Option<BoundingBox>) -> ImageView<'_> {
        match bounds {
            Some(bounds) => self.unpack(frame, bounds.rectangle().into()),
            None => self.unpack_all(frame),
        }
    }

    /// Returns the full frame.
    pub(super) fn unpack_all(&mut self, frame: &Frame<'_>) -> ImageView<'_> {
        self.unpack(frame, PixelRect::whole(u32::MAX, u32::MAX))
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
            assert_eq!(image.unpack(&frame, [2, 1, 3, 2].into()).at(4, 2), level(4, 2));
            let view = image.unpack(&frame, [5, 4, 9, 9].into());
            assert_eq!((view.at(7, 5), view.at(2, 1)), (level(7, 5), level(2, 1)));
            let view = image.unpack_all(&frame);
            assert!((0..48).all(|k| view.at(k % 8, k / 8) == level(k % 8, k / 8)));
        }
    }
}
