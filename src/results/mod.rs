//! What was measured: the rows every room, topic and table speaks.
//!
//! Plain values without behaviour. A number that could not be measured is
//! `None` and a status says why; there is no NaN and no zero in its place.

mod alarm;
mod field;
mod impact;
mod rod;
mod rod_lines;
mod status;
mod step;
mod track;
mod velocity;

pub use alarm::{Alarm, AlarmKind};
pub use field::{Displacement, FieldPoint, PairField};
pub use impact::{Estimate, ForceLaw, IMPACT_NUMBERS, Impact};
pub use rod::{ROD_EDGES, Rod, RodEdge};
pub use status::{Phase, PointStatus};
pub use step::{BodyStep, Circle, RigidStep};
pub use track::TrackSample;
pub use velocity::{BodyVelocity, VelocitySample};

pub use rod_lines::{Segment, segments};
