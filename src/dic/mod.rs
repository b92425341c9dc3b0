//! Digital image correlation (DIC): measures the displacement of image subsets.
//!
//! A [`Correlator`] is planned once for an image size and a set of [`CorrelationParams`]. It prepares frames
//! ([`PreparedFrame`]) and measures the displacement of subsets on a grid ([`grid`]) between two of them.
//! [`rigid_fit()`] fits the motion of a rigid body to a displacement field.

mod body;
mod correlate;
mod error;
mod field;
mod geometry;
mod image;
mod params;
mod refine;
mod search;
mod subset;
mod uncertainty;
mod zncc;

#[cfg(test)]
mod tests;

pub use crate::numeric::instruction_set;
pub use body::{
    BallDisc, BodyMotion, CenteredFrame, OcclusionMap, PolarCorrelator, Radii, RigidBody, RingPattern, RingRotation,
    STALE_DEG, find_at_any_angle, find_occluded_within_angle, has_texture, min_ring_contrast_dn,
};
pub use correlate::{Correlator, KeptReference, KernelBenchmark, Series, Start};
pub use error::CorrelationError;
pub use field::{CenterVector, Dilatation, RigidMotion, Sphere, center_fit, fit_dilatation, rigid_fit, rigid_fit_near};
pub use geometry::{GridPoint, Patch, PlanarMotion, Point, Region, Shape, WindowShape, grid};
pub use image::{Interpolation, PreparedFrame};
pub use params::{CorrelationParams, Method};
pub use uncertainty::FixedPattern;
pub use zncc::zncc;
