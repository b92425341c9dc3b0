//! State across frames: steps in frame order become tracks, velocities and impacts.
//!
//! The live tracker, the recorder (over a shot) and the offline analysis run a [`Tracker`]. It is pure: the same steps
//! give the same rows everywhere.

mod body_tracker;
mod gating;
mod moving_surface;
mod ordered_tracker;
mod pending_impact;
mod reorder;
mod rows;
mod sightings;
mod tracker;

pub use ordered_tracker::{Losses, OrderedTracker};
pub use reorder::ReorderBuffer;
pub use rows::TrackerRows;
pub use tracker::{Tracker, TrackerParams};
