//! Parameters of the measurement and its distribution over workers.

use crate::ball::BallParams;
use crate::dic::{CorrelationParams, Patch};
use crate::image::{Correction, DefectError, Defects, Tone};
use crate::motion::Rotation;
use crate::rod::RodParams;

/// The parameters that the frames of a rig are measured with.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasureParams {
    /// The parameters of the subset correlation.
    pub correlation: CorrelationParams,
    /// The intervals from reference to target, shortest first, frames.
    pub intervals_frames: Vec<u32>,
    /// The method for the motion of a ball; the motion of a rod always comes from its subsets.
    pub rotation: Rotation,
    /// The kind of each body and the region it is searched in.
    pub bodies: Vec<BodyParams>,
    /// The tone curve of the camera, if its grey levels are not proportional to light.
    pub tone: Option<Tone>,
    /// The defective pixels of the camera: column and row.
    pub defective_px: Vec<[u32; 2]>,
    /// The number of frames per block; blocks begin at sequence numbers divisible by it.
    pub block_frames: u32,
}

impl MeasureParams {
    /// Returns the correction of images of this size.
    ///
    /// # Errors
    ///
    /// Returns an error if a defective pixel lies outside the image or has no sound neighbour.
    pub fn correction(&self, width_px: usize, height_px: usize) -> Result<Correction, DefectError> {
        let defects = Defects::new(&self.defective_px, width_px, height_px)?;
        Ok(Correction { tone: self.tone.clone(), defects })
    }

    /// Whether the interval at `index` has this number of frames.
    pub(super) fn is_interval(&self, index: usize, frames: u64) -> bool {
        u64::from(self.intervals_frames[index]) == frames
    }
}

/// The kind of a body and the region it is searched in.
#[derive(Debug, Clone, PartialEq)]
pub enum BodyParams {
    /// A ball.
    Ball(BallParams),
    /// An upright rod with tapes around it.
    Rod(RodParams),
    /// The pixels inside a polygon that was drawn in the first image of the stream.
    Patch(Patch),
}

impl From<BallParams> for BodyParams {
    fn from(ball: BallParams) -> Self {
        Self::Ball(ball)
    }
}

/// The size of the frames, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ImageSize {
    pub(super) width: usize,
    pub(super) height: usize,
}

/// The blocks that one worker measures: those with number modulo `of` equal to `index`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    /// The index of the worker, less than `of`.
    pub index: u32,
    /// The number of workers.
    pub of: u32,
}

impl Share {
    /// All blocks.
    pub const ALL: Self = Self { index: 0, of: 1 };

    /// Whether the worker measures a block.
    pub(super) fn contains(self, block: u64) -> bool {
        block % u64::from(self.of) == u64::from(self.index)
    }
}
