//! Digital image correlation (DIC): measures the displacement of image subsets.
//!
//! A [`Correlator`] is planned once for an image size and a set of [`CorrelationParams`]. It prepares frames
//! ([`Prepared`]) and measures the displacement of subsets on a grid ([`grid`]) between two of them. [`rigid_fit()`]
//! fits the motion of a rigid body to a displacement field.

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
pub use body::{BodyMotion, RigidBody, Ring, STALE_DEG, Turn, Veil, find_at_any_angle, find_hidden_within_angle};
pub use correlate::{Correlator, KeptReference, Parts, Series, Start, arithmetic};
pub use error::CorrelationError;
pub use field::{CenterVector, RigidMotion, Sphere, Swell, center_fit, rigid_fit, rigid_fit_near, swell};
pub use geometry::{GridPoint, Patch, Region, grid};
pub use image::Prepared;
pub use params::{CorrelationParams, Interpolation, Method, Shape, WindowShape};
pub use uncertainty::FixedPattern;
pub use zncc::zncc;
