//! Displacement fields: outliers, the rigid motion that fits them, the centre of rotation, dilatation.

mod center_fit;
mod dilatation;
mod outliers;
mod rigid_fit;

pub use center_fit::{CenterVector, center_fit};
pub use dilatation::{Dilatation, Sphere, fit_dilatation};
pub(in crate::dic) use outliers::MedianTest;
pub use rigid_fit::{RigidMotion, rigid_fit, rigid_fit_near};
