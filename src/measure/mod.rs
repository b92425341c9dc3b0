//! The measurement: blocks of frames in, rows of results out.
//!
//! [`Measurer`] computes steps and displacement fields of the frames of one block. The correlation workers and the
//! offline analysis run it. It is pure: the same frames give the same rows everywhere.

mod background;
mod background_search;
mod block_state;
mod body_motion;
mod bounding_box;
mod consistency;
mod error;
mod fixed_pattern;
mod frame_image;
mod jump;
mod measurer;
mod outline;
mod outline_motion;
mod outline_search;
mod params;
mod patch_finder;
mod pending_frame;
mod reconcile;
mod rigid_match;
mod ring_rotation;
mod rotation_support;
mod spare_frames;
mod surface;
mod texture_match;
mod withdrawal;

pub use error::MeasureError;
pub use measurer::Measurer;
pub(crate) use outline::body_circle;
pub use outline_search::OUTLINE_INTERVAL_FRAMES;
pub use params::{BodyParams, MeasureParams, Share};
pub use pending_frame::Measured;
pub use rigid_match::matched_region;
