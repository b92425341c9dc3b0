//! The background of a block in which a ball was lost: the median of three frames, in which the ball is at three places.

use super::frame_image::FrameImage;
use crate::image::{Frame, FrameMeta, Image, ImageView};

/// The number of frames of a block that are kept, whatever their size, and the maximum.
const KEPT_FRAMES: [usize; 2] = [16, 64];
/// The memory for more frames than the former, bytes.
const MAX_BYTES: usize = 64 << 20;

/// A copy of a frame in which a ball was not found.
#[derive(Debug)]
struct KeptFrame {
    meta: FrameMeta,
    bytes: Vec<u8>,
}

/// A kept frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct KeptImage<'a> {
    pub(super) image: ImageView<'a>,
    /// The difference from the background, DN.
    pub(super) difference: ImageView<'a>,
}

/// The frames of the current block in which a ball was not found, and the background of a block.
#[derive(Debug)]
pub(super) struct Background {
    kept: Vec<KeptFrame>,
    /// The block of the background, once it is known.
    source: Option<u64>,
    image: Image,
    /// The last requested frame, and its difference from the background.
    frame: Image,
    difference: Image,
}

impl Background {
    /// Allocates for frames of this size.
    pub(super) fn new(width_px: usize, height_px: usize) -> Self {
        let image = || Image::new(width_px, height_px);
        Self { kept: Vec::new(), source: None, image: image(), frame: image(), difference: image() }
    }

    /// Keeps a frame in which a ball was not found.
    pub(super) fn keep(&mut self, frame: &Frame<'_>) {
        let room = (MAX_BYTES / frame.bytes.len().max(1)).clamp(KEPT_FRAMES[0], KEPT_FRAMES[1]);
        if self.kept.len() < room {
            self.kept.push(KeptFrame { meta: frame.meta, bytes: frame.bytes.to_vec() });
        }
    }

    /// Returns the sequence number of the first kept frame. Its row, and those after it, wait for the background.
    pub(super) fn first_kept(&self) -> Option<u64> {
        self.kept.first().map(|first| first.meta.sequence)
    }

    /// Returns the sequence numbers of the kept frames.
    pub(super) fn kept_sequences(&self) -> Vec<u64> {
        self.kept.iter().map(|kept| kept.meta.sequence).collect()
    }

    /// Whether the background of a block is known.
    pub(super) fn is_known(&self, block: u64) -> bool {
        self.source == Some(block)
    }

    /// Discards the background.
    pub(super) fn forget(&mut self) {
        self.source = None;
    }

    /// Computes the background of a block from three kept frames, given by their place among the kept ones.
    ///
    /// It is their median: a body that covers a pixel in one of them at most is not in it.
    pub(super) fn compute(&mut self, block: u64, frames: [usize; 3], unpacker: &FrameImage) {
        let Self { kept, image, frame, difference, .. } = self;
        for (index, target) in frames.into_iter().zip([&mut *image, &mut *frame, &mut *difference]) {
            unpacker.unpack_into(&Frame { meta: kept[index].meta, bytes: &kept[index].bytes }, target);
        }
        let others = frame.view().data().iter().zip(difference.view().data());
        for (level, (b, c)) in image.data_mut().iter_mut().zip(others) {
            *level = level.max(b.min(*c)).min(b.max(*c));
        }
        self.source = Some(block);
    }

    /// Returns a kept frame and its difference from the background; `None` if it was not kept.
    pub(super) fn kept_frame(&mut self, sequence: u64, unpacker: &FrameImage) -> Option<KeptImage<'_>> {
        let kept = self.kept.iter().find(|kept| kept.meta.sequence == sequence)?;
        unpacker.unpack_into(&Frame { meta: kept.meta, bytes: &kept.bytes }, &mut self.frame);
        subtract(self.frame.view(), self.image.view(), &mut self.difference);
        Some(KeptImage { image: self.frame.view(), difference: self.difference.view() })
    }

    /// Returns the difference of an image from the background.
    pub(super) fn difference(&mut self, image: ImageView<'_>) -> ImageView<'_> {
        subtract(image, self.image.view(), &mut self.difference);
        self.difference.view()
    }

    /// Discards the kept frames and their memory; the background of their block stays.
    pub(super) fn release_frames(&mut self) {
        self.kept.clear();
    }

    /// Discards everything.
    pub(super) fn clear(&mut self) {
        self.release_frames();
        self.forget();
    }
}

/// Writes the difference of two images of the same size.
fn subtract(image: ImageView<'_>, background: ImageView<'_>, difference: &mut Image) {
    let levels = image.data().iter().zip(background.data());
    difference.data_mut().iter_mut().zip(levels).for_each(|(out, (level, ground))| *out = level - ground);
}
