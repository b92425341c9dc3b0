//! What crosses a process border: fixed-size `repr(C)` values with versioned names.
//!
//! A program in C, Python or Rust reads a topic by declaring the same layout
//! under the same type name (`ricochet.Velocity.v1`). A change that only uses
//! reserved space keeps the version; any other change raises it, and readers of
//! the old version are refused by the bus instead of misreading.
//!
//! Numbers that were not measured have `known = 0` in their [`Number`].

mod control;
mod event;
mod field;
mod frame;
mod impact;
mod number;
mod rod;
mod status;
mod track;
mod velocity;

pub use control::{Command, Reply, ReplyCode, Request};
pub use event::{EVENT_TEXT_BYTES, Event, EventKind};
pub use field::{FieldHeader, FieldPointMessage};
pub use frame::FrameHeader;
pub use impact::{EstimateMessage, ImpactMessage};
pub use number::Number;
pub use rod::RodMessage;
pub use status::{Progress, Role, StatusMessage};
pub use track::TrackMessage;
pub use velocity::VelocityMessage;
