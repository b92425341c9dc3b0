//! What is kept of a frame until its motion is measured.

use super::block::Measured;
use super::outline::Outline;
use crate::dic::Prepared;
use crate::image::FrameMeta;
use crate::results::{PointStatus, RigidStep};

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
