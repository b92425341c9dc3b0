//! What is measured with, and which part of it where.

use super::outline::BodyParams;
use crate::dic::CorrelationParams;
use crate::image::{Correction, DefectError, Defects, Tone};
use crate::motion::Rotation;

/// What the frames of a rig are measured with.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasureParams {
    /// How subsets are correlated.
    pub correlation: CorrelationParams,
    /// From reference to target, frames; the shortest first.
    pub intervals_frames: Vec<u32>,
    /// What the motion of a ball is taken from; that of a rod always comes from its subsets.
    pub rotation: Rotation,
    /// What each body is and where it may be.
    pub bodies: Vec<BodyParams>,
    /// Tone curve of the camera, where its grey levels are not light.
    pub tone: Option<Tone>,
    /// Pixels of the camera that do not see: column and row.
    pub defective_px: Vec<[u32; 2]>,
    /// Frames of a block; blocks begin at sequence numbers divisible by it.
    pub block_frames: u32,
}

impl MeasureParams {
    /// What pictures of this size are corrected by.
    ///
    /// # Errors
    ///
    /// When a pixel that does not see is outside of them, or has no sound one near.
    pub fn correction(&self, width_px: usize, height_px: usize) -> Result<Correction, DefectError> {
        let defects = Defects::new(&self.defective_px, width_px, height_px)?;
        Ok(Correction { tone: self.tone.clone(), defects })
    }

    /// Whether the interval at `place` is so many frames.
    pub(super) fn is_interval(&self, place: usize, frames: u64) -> bool {
        u64::from(self.intervals_frames[place]) == frames
    }
}

/// Which blocks are measured here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    /// Every block whose number leaves this remainder ...
    pub index: u32,
    /// ... when divided by this.
    pub of: u32,
}

impl Share {
    /// All of them.
    pub const ALL: Self = Self { index: 0, of: 1 };

    pub(super) fn holds(self, block: u64) -> bool {
        block % u64::from(self.of) == u64::from(self.index)
    }
}
