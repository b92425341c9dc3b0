//! The frame at hand, of which only the parts that are asked for are unpacked.

use super::part::Part;
use crate::image::{Correction, Frame, Image, ImageView};

/// Grey levels of one frame at a time.
pub(super) struct Picture {
    image: Image,
    correction: Correction,
    /// Left, top, right and bottom of what is unpacked, the last two outside.
    ready: [u32; 4],
}

impl Picture {
    /// Memory for frames of this size, of a camera that is corrected like this.
    pub(super) fn new(width_px: usize, height_px: usize, correction: Correction) -> Self {
        Self { image: Image::new(width_px, height_px), correction, ready: [0; 4] }
    }

    /// A picture that was unpacked elsewhere, corrected as frames are.
    pub(super) fn correct(&self, image: &mut Image) {
        self.correction.correct(image);
    }

    /// Another frame: nothing is unpacked of it yet.
    pub(super) fn begin(&mut self) {
        self.ready = [0; 4];
    }

    /// The frame, unpacked in a rectangle at least: x, y, width and height, clipped to the frame.
    ///
    /// What else it shows may be of frames before: do not look there.
    pub(super) fn part(&mut self, frame: &Frame<'_>, [x, y, width, height]: [u32; 4]) -> ImageView<'_> {
        let (right, bottom) = (frame.meta.width_px, frame.meta.height_px);
        let asked =
            [x.min(right), y.min(bottom), x.saturating_add(width).min(right), y.saturating_add(height).min(bottom)];
        let [left, top, right, bottom] = self.ready;
        let holds = left <= asked[0] && top <= asked[1] && right >= asked[2] && bottom >= asked[3];
        if !holds {
            let is_first = left >= right || top >= bottom;
            let both = [left.min(asked[0]), top.min(asked[1]), right.max(asked[2]), bottom.max(asked[3])];
            self.ready = if is_first { asked } else { both };
            // Its size and its bytes were looked at when it came.
            let _ = self.correction.unpack(frame, self.ready, &mut self.image);
        }
        self.image.view()
    }

    /// The frame, unpacked in a part at least; all of it with `None`.
    pub(super) fn some(&mut self, frame: &Frame<'_>, part: Option<Part>) -> ImageView<'_> {
        match part {
            Some(part) => self.part(frame, part.rectangle()),
            None => self.whole(frame),
        }
    }

    /// The frame, all of it.
    pub(super) fn whole(&mut self, frame: &Frame<'_>) -> ImageView<'_> {
        self.part(frame, [0, 0, u32::MAX, u32::MAX])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::FrameMeta;

    #[test]
    fn what_is_asked_for_is_of_the_frame_at_hand() {
        let meta = FrameMeta { width_px: 8, height_px: 6, stride_bytes: 8, ..FrameMeta::default() };
        let mut picture = Picture::new(8, 6, Correction::default());
        for round in 0..3_u8 {
            let bytes: Vec<u8> = (0..48).map(|k| k + 50 * round).collect();
            let frame = Frame { meta, bytes: &bytes };
            picture.begin();
            let level = |x: usize, y: usize| Some(f32::from(bytes[8 * y + x]));
            assert_eq!(picture.part(&frame, [2, 1, 3, 2]).at(4, 2), level(4, 2));
            let view = picture.part(&frame, [5, 4, 9, 9]);
            assert_eq!((view.at(7, 5), view.at(2, 1)), (level(7, 5), level(2, 1)));
            let view = picture.whole(&frame);
            assert!((0..48).all(|k| view.at(k % 8, k / 8) == level(k % 8, k / 8)));
        }
    }
}
