//! The measurement: blocks of frames in, rows of results out.
//!
//! [`Measurer`] computes steps and displacement fields of the frames of one block. The correlation
//! workers run it. [`Tracker`] turns steps in frame order into tracks, velocities and impacts. The
//! live tracker, the recorder (over a shot) and the offline analysis run it. Both are pure: the same
//! frames give the same rows everywhere.

mod belief;
mod block;
mod body;
mod confirm;
mod error;
mod field;
mod known;
mod look;
mod order;
mod outline;
mod params;
mod part;
mod patch;
mod pattern;
mod picture;
mod reference;
mod rehearsal;
mod target;
mod tracker;
mod turn;
mod whole;

pub use block::{Measured, Measurer};
pub use error::MeasureError;
pub use look::OUTLINE_INTERVAL_FRAMES;
pub use order::Order;
pub use outline::BodyParams;
pub use params::{MeasureParams, Share};
pub use tracker::{Tracker, TrackerParams, TrackerRows};
pub use whole::whole_region;
