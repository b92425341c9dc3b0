//! Alarms, which are published while a collision lasts.

use super::Estimate;

/// The kind of an alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AlarmKind {
    /// Contact began.
    Began,
    /// The body is thrown back, so the deepest position has passed.
    Turned,
    /// The contact is withdrawn: there was none.
    Withdrawn,
}

/// The detection of a collision while it lasts. Its numbers follow later, as an [`Impact`](super::Impact).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alarm {
    /// The index of the body in the configuration.
    pub body: u32,
    /// The kind.
    pub kind: AlarmKind,
    /// The frame by which it was detected.
    pub frame: u64,
    /// The first estimate of the time, s after the first frame.
    pub at_s: Estimate,
    /// The same time, ns since the Unix epoch.
    pub stamp_ns: u64,
}
