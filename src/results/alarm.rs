//! What is told of a collision while it lasts.

use super::Estimate;

/// What was noticed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlarmKind {
    /// Contact began.
    Began,
    /// The body is thrown back: the deepest moment has passed.
    Turned,
    /// What was told as contact was none.
    Withdrawn,
}

/// A collision noticed while it lasts; its numbers come later, as an [`Impact`](super::Impact).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alarm {
    /// Index of the body in the configuration.
    pub body: u32,
    /// What was noticed.
    pub kind: AlarmKind,
    /// The frame by which it was noticed.
    pub frame: u64,
    /// When it happened, s after the first frame; as well as is known at once.
    pub at_s: Estimate,
    /// The same, ns since the Unix epoch.
    pub stamp_ns: u64,
}
