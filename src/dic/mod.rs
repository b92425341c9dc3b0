//! Digital image correlation (DIC): measures the displacement of image subsets.
//!
//! A [`Correlator`] is planned once for an image size and a set of [`CorrelationParams`]. It prepares frames
//! ([`Prepared`]) and measures the displacement of subsets on a grid ([`grid`]) between two of them. [`rigid_fit()`]
//! fits the motion of a rigid body to a displacement field.

mod angle;
mod around;
mod body;
mod carried;
mod center;
mod columns;
mod correlation;
mod correlator;
mod error;
mod fft;
mod fine;
mod fixed;
pub mod grid;
mod growth;
mod lanes;
mod light;
mod likeness;
mod matcher;
mod median;
mod moments;
mod params;
mod parts;
mod patch;
mod peak;
mod plane;
mod prepared;
mod quadratic;
mod refine;
mod region;
mod residual;
mod rigid_fit;
mod ring;
mod rows;
mod sample;
mod series;
mod share;
mod sight;
mod sigma;
mod solve;
mod spline;
mod subset;
mod transform;
mod validate;
mod vector;
mod veil;
mod warp;
mod window;
mod zncc;

#[cfg(test)]
mod accuracy;
#[cfg(test)]
mod hostile;
#[cfg(test)]
mod methods;
#[cfg(test)]
mod patterns;
#[cfg(test)]
mod speckle;

pub use angle::{find_at_any_angle, find_hidden_within_angle};
pub use body::{BodyMotion, RigidBody, STALE_DEG};
pub use center::{CenterVector, center_fit};
pub use correlator::{Correlator, KeptReference, Start};
pub use error::CorrelationError;
pub use fixed::FixedPattern;
pub use grid::GridPoint;
pub use growth::{Sphere, Swell, swell};
pub use params::{CorrelationParams, Interpolation, Method, Shape, WindowShape};
pub use parts::{Parts, arithmetic};
pub use patch::Patch;
pub use prepared::Prepared;
pub use region::Region;
pub use rigid_fit::{RigidMotion, rigid_fit, rigid_fit_near};
pub use ring::{Ring, Turn};
pub use series::Series;
pub use vector::instruction_set;
pub use veil::Veil;
pub use zncc::zncc;
