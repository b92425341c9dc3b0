//! What a camera does to the light, undone.

use super::defects::REACH_PX;
use super::{Defects, Frame, Image, ShapeError, Tone};

/// What grey levels are corrected by before anything is measured in them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Correction {
    /// The tone curve of a camera whose grey levels are not light.
    pub tone: Option<Tone>,
    /// Pixels that do not see.
    pub defects: Option<Defects>,
}

impl Correction {
    /// Unpacks a part of a frame, corrected: left, top, right and bottom, px, the last two outside and within the frame.
    ///
    /// What it gives there does not depend on how much is asked for. Around it the image changes as well.
    ///
    /// # Errors
    ///
    /// When the frame's bytes are fewer than its header says.
    pub fn unpack(&self, frame: &Frame<'_>, part: [u32; 4], image: &mut Image) -> Result<(), ShapeError> {
        let reach = if self.defects.is_some() { REACH_PX } else { 0 };
        let (width, height) = (frame.meta.width_px, frame.meta.height_px);
        let [left, top, right, bottom] = part;
        let (left, top) = (left.saturating_sub(reach), top.saturating_sub(reach));
        let (right, bottom) = ((right + reach).min(width), (bottom + reach).min(height));
        frame.unpack_part([left, top, right - left, bottom - top], image)?;
        if let Some(tone) = &self.tone {
            tone.straighten(image, [left, top, right, bottom]);
        }
        if let Some(defects) = &self.defects {
            defects.fill(image, part);
        }
        Ok(())
    }

    /// Corrects a whole picture of grey levels.
    pub fn correct(&self, image: &mut Image) {
        let all = [0, 0, image.view().width() as u32, image.view().height() as u32];
        if let Some(tone) = &self.tone {
            tone.straighten(image, all);
        }
        if let Some(defects) = &self.defects {
            defects.fill(image, all);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{FrameMeta, PixelFormat};

    #[test]
    fn a_part_is_as_it_is_in_the_whole() {
        let meta = FrameMeta { width_px: 16, height_px: 12, stride_bytes: 16, ..FrameMeta::default() };
        let bytes: Vec<u8> = (0..192_u32).map(|k| (k * k * 7 % 251) as u8).collect();
        let frame = Frame { meta, bytes: &bytes };
        let defects = Defects::new(&[[4, 4], [9, 4], [4, 9], [5, 9], [0, 0], [12, 8]], 16, 12).unwrap();
        let correction = Correction { tone: Tone::new(0.5, PixelFormat::Mono8), defects };
        let (mut whole, mut image) = (Image::new(16, 12), Image::new(16, 12));
        correction.unpack(&frame, [0, 0, 16, 12], &mut whole).unwrap();
        for part in [[4, 4, 10, 10], [0, 0, 5, 5], [9, 3, 16, 12], [12, 8, 13, 9]] {
            correction.unpack(&frame, part, &mut image).unwrap();
            let [left, top, right, bottom] = part.map(|edge| edge as usize);
            for (x, y) in (top..bottom).flat_map(|y| (left..right).map(move |x| (x, y))) {
                assert_eq!(image.view().at(x, y), whole.view().at(x, y), "{part:?}: {x}, {y}");
            }
        }
    }
}
