//! What is kept of a frame until its motion is measured.

use super::block::Measured;
use super::outline::Outline;
use crate::dic::Prepared;
use crate::image::FrameMeta;
use crate::results::{BodyStep, PointStatus, RigidStep};

/// How an outline is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// It was found in the frame.
    Seen,
    /// It was not looked for: the whole body was in sight and moved there.
    Spared,
    /// It was not found; its motion leads there.
    Carried,
}

/// A frame that waits for its target.
pub(super) struct Reference {
    pub(super) meta: FrameMeta,
    pub(super) block: u64,
    pub(super) prepared: Prepared,
    pub(super) outlines: Vec<Result<Outline, PointStatus>>,
    /// By body.
    pub(super) sources: Vec<Source>,
    /// By body and interval; `None` until the target came, or did not.
    pub(super) done: Vec<Option<Measured>>,
    /// The motion before each of them.
    pub(super) before: Vec<Option<RigidStep>>,
}

impl Reference {
    /// Whether a body's outline there can be held against that in a later frame, where it was seen.
    pub(super) fn leads_to(&self, target: &Self, body: usize) -> bool {
        self.sources[body] != Source::Carried && target.sources[body] == Source::Seen
    }

    /// The row of one of its bodies of which nothing is told yet.
    pub(super) fn untold(&self, body: usize, interval_frames: u32) -> BodyStep {
        BodyStep {
            is_carried: self.outlines[body].is_ok() && self.sources[body] != Source::Seen,
            drift: None,
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
