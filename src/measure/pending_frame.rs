//! Frames that wait until their motion is measured.

use super::outline::Outline;
use crate::dic::PreparedFrame;
use crate::image::FrameMeta;
use crate::results::{BodyStep, OutlineOrigin, PairField, PointStatus, RigidStep};

/// One body within one block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BodyKey {
    pub(super) body: usize,
    pub(super) block: u64,
}

/// The sequence numbers of a reference and its target.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval {
    pub(super) from: u64,
    pub(super) to: u64,
}

/// The prepared frames of a reference and its target.
#[derive(Debug, Clone, Copy)]
pub(super) struct FramePair<'a> {
    pub(super) reference: &'a PreparedFrame,
    pub(super) target: &'a PreparedFrame,
}

/// A target frame, prepared around the bodies of one block.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target<'a> {
    pub(super) sequence: u64,
    pub(super) prepared: &'a PreparedFrame,
    /// Whether it is prepared only around the predicted bodies, not over the full search range.
    pub(super) is_narrow: bool,
}

/// One body from a reference to its target.
#[derive(Clone, Copy)]
pub(super) struct Span<'a> {
    pub(super) body: usize,
    pub(super) reference: &'a PendingFrame,
    pub(super) target: Target<'a>,
}

impl Span<'_> {
    pub(super) fn key(&self) -> BodyKey {
        BodyKey { body: self.body, block: self.reference.block }
    }
}

/// One body in one frame: its step and the field that the step was computed from.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The outline of the body and its motion.
    pub step: BodyStep,
    /// The displacement field.
    pub field: Option<PairField>,
    /// Whether a match of the whole body confirms the motion.
    pub(super) is_matched: bool,
}

impl Measured {
    /// Withdraws the motion for this reason.
    pub(super) fn withdraw_motion(&mut self, status: PointStatus) {
        self.step = BodyStep { status, ..self.step.without_motion() };
    }

    /// Withdraws outline and motion for this reason.
    pub(super) fn withdraw_outline(&mut self, status: PointStatus) {
        self.step = BodyStep { outline: None, status, ..self.step.without_motion() };
    }
}

/// The outline of a body in one frame, or the reason why it has none.
#[derive(Debug, Clone, Copy)]
pub(super) struct FoundOutline {
    pub(super) outline: Result<Outline, PointStatus>,
    pub(super) origin: OutlineOrigin,
}

impl FoundOutline {
    /// Returns an outline that was found in the image of its frame.
    pub(super) fn detected(outline: Outline) -> Self {
        Self { outline: Ok(outline), origin: OutlineOrigin::Detected }
    }

    /// Whether the body was searched in the whole frame and not found.
    pub(super) fn is_missing(&self) -> bool {
        self.outline == Err(PointStatus::Lost) || self.origin == OutlineOrigin::Coasted
    }
}

/// A frame that waits for its targets.
pub(super) struct PendingFrame {
    pub(super) meta: FrameMeta,
    pub(super) block: u64,
    pub(super) prepared: PreparedFrame,
    /// The outline of each body.
    pub(super) outlines: Vec<FoundOutline>,
    /// The results by body and interval; `None` until the target came or was missed.
    pub(super) done: Vec<Option<Measured>>,
    /// The motion before each result.
    pub(super) before: Vec<Option<RigidStep>>,
}

impl PendingFrame {
    /// Whether the outline of a body can be compared with that in a later frame, where it was detected.
    pub(super) fn is_comparable(&self, target: &Self, body: usize) -> bool {
        matches!(self.outlines[body].origin, OutlineOrigin::Detected | OutlineOrigin::Reused)
            && target.outlines[body].origin == OutlineOrigin::Detected
    }

    /// Whether a body is a ball that has an outline in this frame.
    pub(super) fn has_ball(&self, body: usize) -> bool {
        matches!(self.outlines[body].outline, Ok(Outline::Ball(_)))
    }

    /// Returns the row of a body with its outline alone.
    pub(super) fn outline_step(&self, body: usize, interval_frames: u32) -> BodyStep {
        BodyStep {
            frame: self.meta.sequence,
            stamp_ns: self.meta.stamp_ns,
            body: u32::try_from(body).unwrap_or(u32::MAX),
            interval_frames,
            outline: self.outlines[body].outline.ok().map(|outline| outline.to_result(self.outlines[body].origin)),
            angle_deg: self.outlines[body].outline.ok().and_then(|outline| outline.angle_deg()),
            status: match (self.outlines[body].outline, self.outlines[body].origin) {
                (Err(status), _) => status,
                (Ok(_), OutlineOrigin::Coasted) => PointStatus::Predicted,
                (Ok(_), OutlineOrigin::Detected | OutlineOrigin::Predicted | OutlineOrigin::Reused) => {
                    PointStatus::Valid
                }
            },
            ..BodyStep::default()
        }
    }
}
