//! The place of a frame in its stream.

use crate::message::{Event, FrameHeader};

/// The sequence number and stamp of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct FrameStamp {
    pub(super) sequence: u64,
    pub(super) stamp_ns: u64,
}

impl From<&FrameHeader> for FrameStamp {
    fn from(header: &FrameHeader) -> Self {
        Self { sequence: header.sequence, stamp_ns: header.stamp_ns }
    }
}

impl From<&Event> for FrameStamp {
    fn from(event: &Event) -> Self {
        Self { sequence: event.sequence, stamp_ns: event.stamp_ns }
    }
}
