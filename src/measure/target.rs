//! Target frames of a motion.

use crate::dic::PreparedFrame;

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
