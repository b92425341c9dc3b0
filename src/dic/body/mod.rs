//! Whole bodies: matching all of a rigid body at once, where it is occluded, and how far it turned.

mod box_filter;
mod light_field;
mod median_residual;
mod motion;
mod occlusion;
mod occlusion_map;
mod polar;
mod registration;
mod rigid_body;
mod rotation_search;
mod sector_scatter;
mod texture;
mod visibility;

pub use motion::{BodyMotion, STALE_DEG};
pub use occlusion_map::OcclusionMap;
pub use polar::{CenteredFrame, PolarCorrelator, Radii, RingPattern, RingRotation};
pub use rigid_body::RigidBody;
pub use rotation_search::{find_at_any_angle, find_occluded_within_angle};
pub use texture::{BallDisc, has_texture, min_ring_contrast_dn};
