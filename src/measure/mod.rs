//! The measurement itself: blocks of frames in, rows of results out.
//!
//! [`Measurer`] turns the frames of one block into steps and fields; it is
//! what a correlation worker runs. [`Tracker`] turns steps in frame order into
//! tracks, velocities and impacts; it is what the tracker runs live, what the
//! recorder runs over a shot and what offline analysis runs. Both are pure, so
//! that the same frames give the same rows everywhere.

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
pub use look::OUTLINE_FRAMES;
pub use order::Order;
pub use outline::BodyParams;
pub use params::{MeasureParams, Share};
pub use tracker::{Tracker, TrackerParams, TrackerRows};
pub use whole::whole_region;
