//! The results: the rows of every topic and table.
//!
//! A number that could not be measured is `None`, and a status gives the reason. There is never a NaN or a zero in its
//! place.

mod alarm;
mod body_kind;
mod coding;
mod columns;
mod estimate;
mod field;
mod impact;
mod measured_frames;
mod named;
mod reason;
mod rod;
mod rod_lines;
mod status;
mod step;
mod track;
mod velocity;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use alarm::{Alarm, AlarmKind};
pub use body_kind::BodyKind;
pub use coding::FrameCoding;
pub(crate) use columns::Part;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use columns::{Cell, Column, Heading, Kind, Sample};
pub use estimate::Estimate;
pub(crate) use field::field_row;
pub use field::{Displacement, FieldPoint, PairField};
pub(crate) use impact::impact_row;
pub use impact::{ForceLaw, IMPACT_NUMBERS, Impact};
pub use measured_frames::{FrequentStatus, MeasuredFrames};
pub use named::UnknownName;
pub(crate) use named::named_enum;
pub use reason::Reason;
pub use rod::{ROD_EDGES, Rod, RodEdge};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use rod_lines::{Segment, segments};
pub use status::{Phase, PointStatus};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use step::{BodyStep, Circle, MotionMethod, Outline, OutlineOrigin, OutlineShape, RigidStep};
pub use track::TrackSample;
pub(crate) use track::track_row;
pub(crate) use velocity::velocity_row;
pub use velocity::{BodyVelocity, MotionSample, VelocitySample};
