//! State across frames: steps in frame order become tracks, velocities and impacts.
//!
//! [`Tracker`] is what the live tracker runs, what the recorder runs over a shot and what offline analysis runs. It is
//! pure, so that the same steps give the same rows everywhere.

mod body_tracker;
mod gating;
mod ordered_tracker;
mod reorder;
mod tracker;

pub use ordered_tracker::{Losses, OrderedTracker};
pub use reorder::Order;
pub use tracker::{Tracker, TrackerParams, TrackerRows};
