//! The messages between processes: fixed-size `repr(C)` values with versioned names.
//!
//! A program in C, Python or Rust reads a topic by declaring the same layout under the same type name
//! (`ricochet.Velocity.v1`). A change that only uses reserved space keeps the version. Any other change raises it, and the
//! bus refuses readers of the old version, which would misread it.
//!
//! A number that was not measured has `known = 0` in its [`Number`].

mod control;
mod datagram;
mod event;
mod field;
mod frame;
mod impact;
mod layout;
mod number;
mod rod;
mod sample;
mod status;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use control::Request;
pub use control::{Command, Reply, ReplyCode};
pub use datagram::VelocityDatagram;
pub use event::{EVENT_TEXT_BYTES, Event, EventKind};
pub use field::FieldHeader;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use field::FieldPointMessage;
pub use frame::FrameHeader;
pub use impact::{EstimateMessage, ImpactMessage};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use layout::{Described, Field, FieldKind, LayoutField, MessageLayout};
pub use number::Number;
pub use rod::RodMessage;
pub use sample::{TrackMessage, VelocityMessage};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use status::Progress;
pub use status::{Role, StatusMessage};

/// Returns the layouts of all messages; each comes after those that it contains.
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub fn layouts() -> Vec<MessageLayout> {
    vec![
        Number::layout(),
        EstimateMessage::layout(),
        RodMessage::layout(),
        FrameHeader::layout(),
        FieldHeader::layout(),
        FieldPointMessage::layout(),
        TrackMessage::layout(),
        VelocityMessage::layout(),
        VelocityDatagram::layout(),
        ImpactMessage::layout(),
        Event::layout(),
        StatusMessage::layout(),
        Progress::layout(),
        Request::layout(),
        Reply::layout(),
    ]
}
