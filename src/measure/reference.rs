//! What is kept of a frame until its motion is measured.

use super::block::Measured;
use super::outline::Outline;
use crate::dic::Prepared;
use crate::image::FrameMeta;
use crate::results::{BodyStep, PointStatus, RigidStep};

/// A frame that waits for its target.
pub(super) struct Reference {
    pub(super) meta: FrameMeta,
    pub(super) block: u64,
    pub(super) prepared: Prepared,
    pub(super) outlines: Vec<Result<Outline, PointStatus>>,
    /// By body: whether the outline was seen in this frame, not carried to it.
    pub(super) seen: Vec<bool>,
    /// By body and interval; `None` until the target came, or did not.
    pub(super) done: Vec<Option<Measured>>,
    /// The motion before each of them.
    pub(super) before: Vec<Option<RigidStep>>,
}

impl Reference {
    /// The row of one of its bodies of which nothing is told yet.
    pub(super) fn untold(&self, body: usize, interval_frames: u32) -> BodyStep {
        BodyStep {
            is_carried: self.outlines[body].is_ok() && !self.seen[body],
            drift_px: None,
            is_whole: false,
            rim_fraction: None,
            fixed_fraction: None,
            growth_fraction: None,
            frame: self.meta.sequence,
            stamp_ns: self.meta.stamp_ns,
            body: u32::try_from(body).unwrap_or(u32::MAX),
            interval_frames,
            circle: None,
            rod: None,
            step: None,
            status: self.outlines[body].err().unwrap_or_default(),
        }
    }
}
