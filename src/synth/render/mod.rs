//! The drawing of a frame: balls, rods, speckle patterns, occluders, blurred edges.

mod ball;
mod blurred_edge;
mod body_light;
mod fuzzy_rim;
mod half_plane;
mod occluder;
mod patch;
mod regular_paint;
mod rod;
mod speckle_pattern;
mod speckled_sphere;
mod spherical_cap;
mod texture;

pub(in crate::synth) use ball::{Ball, EDGE_SIGMA, Moment, Surface};
pub(in crate::synth) use blurred_edge::total_sigma_px;
pub(in crate::synth) use half_plane::HalfPlane;
pub(in crate::synth) use occluder::{DiscOutline, Occluder, visible_fraction};
pub(in crate::synth) use patch::Patch;
pub(in crate::synth) use regular_paint::RegularPaint;
pub(in crate::synth) use rod::Rod;
pub(in crate::synth) use speckle_pattern::{Pattern, SpeckleRegion};
pub(in crate::synth) use speckled_sphere::SpeckledSphere;
pub(in crate::synth) use texture::smooth_noise;
