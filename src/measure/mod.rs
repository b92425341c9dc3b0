//! The measurement: blocks of frames in, rows of results out.
//!
//! [`Measurer`] computes steps and displacement fields of the frames of one block. The correlation
//! workers run it. [`Tracker`] turns steps in frame order into tracks, velocities and impacts. The
//! live tracker, the recorder (over a shot) and the offline analysis run it. Both are pure: the same
//! frames give the same rows everywhere.

mod block_state;
mod body_motion;
mod bounding_box;
mod consistency;
mod error;
mod fixed_pattern;
mod frame_image;
mod measurer;
mod outline;
mod outline_search;
mod params;
mod patch_finder;
mod pending_frame;
mod rigid_match;
mod ring_rotation;
mod target;
mod warm_up;

pub use crate::track::Order;
pub use crate::track::{Tracker, TrackerParams, TrackerRows};
pub use error::MeasureError;
pub use measurer::{Measured, Measurer};
pub use outline::BodyParams;
pub(crate) use outline::body_circle;
pub use outline_search::OUTLINE_INTERVAL_FRAMES;
pub use params::{MeasureParams, Share};
pub use rigid_match::whole_region;
