//! The correction of a camera's tone curve and defective pixels.

use super::defects::REACH_PX;
use super::{Defects, Frame, Image, PixelRect, ShapeError, Tone};

/// The corrections applied to grey levels before anything is measured in them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Correction {
    /// The tone curve of a camera whose grey levels are not proportional to the light.
    pub tone: Option<Tone>,
    /// The defective pixels.
    pub defects: Option<Defects>,
}

impl Correction {
    /// Unpacks a part of a frame and corrects it.
    ///
    /// The grey levels inside the part do not depend on its size. With defective pixels, a border of 2 px around it is
    /// unpacked and linearized too. `image` gets the size of the frame.
    ///
    /// # Errors
    ///
    /// [`ShapeError`] as from [`Frame::check`].
    pub fn unpack(&self, frame: &Frame<'_>, part: PixelRect, image: &mut Image) -> Result<(), ShapeError> {
        let reach_px = if self.defects.is_some() { REACH_PX } else { 0 };
        let read = part.grown(reach_px).clipped(PixelRect::whole(frame.meta.width_px, frame.meta.height_px));
        frame.unpack_part(read, image)?;
        self.apply(image, read, part);
        Ok(())
    }

    /// Linearizes all grey levels of an image in place and fills in its defective pixels.
    pub fn correct(&self, image: &mut Image) {
        let all = PixelRect::whole(image.view().width() as u32, image.view().height() as u32);
        self.apply(image, all, all);
    }

    /// Linearizes the pixels within `read` and fills in the defective ones within `part`, which lies inside `read`.
    fn apply(&self, image: &mut Image, read: PixelRect, part: PixelRect) {
        if let Some(tone) = &self.tone {
            tone.linearize(image, read);
        }
        if let Some(defects) = &self.defects {
            defects.fill(image, part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{FrameMeta, PixelFormat};

    #[test]
    fn a_part_equals_the_same_part_of_the_complete_frame() {
        let meta = FrameMeta { width_px: 16, height_px: 12, stride_bytes: 16, ..FrameMeta::default() };
        let bytes: Vec<u8> = (0..192_u32).map(|k| (k * k * 7 % 251) as u8).collect();
        let frame = Frame { meta, bytes: &bytes };
        let defects = Defects::new(&[[4, 4], [9, 4], [4, 9], [5, 9], [0, 0], [12, 8]], 16, 12).unwrap();
        let correction = Correction { tone: Tone::new(0.5, PixelFormat::Mono8), defects };
        let (mut whole, mut image) = (Image::new(16, 12), Image::new(16, 12));
        correction.unpack(&frame, PixelRect::whole(16, 12), &mut whole).unwrap();
        for [left, top, right, bottom] in [[4, 4, 10, 10], [0, 0, 5, 5], [9, 3, 16, 12], [12, 8, 13, 9]] {
            let part = PixelRect { left, top, right, bottom };
            correction.unpack(&frame, part, &mut image).unwrap();
            for (x, y) in (top..bottom).flat_map(|y| (left..right).map(move |x| (x as usize, y as usize))) {
                assert_eq!(image.view().at(x, y), whole.view().at(x, y), "{part:?}: {x}, {y}");
            }
        }
    }
}
