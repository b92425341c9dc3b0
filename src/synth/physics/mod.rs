//! Collision physics: a ball against a fixed surface.
//!
//! The normal contact follows Kelvin-Voigt or Hunt and Crossley. The tangential contact is a spring and a damper whose
//! force is limited by friction, so that the contact point slips, grips and slips again as in experiments.

mod collision;
mod law;

pub use collision::{Collision, CollisionSetup, Motion, Outcome, PhysicsError};
pub use law::{Friction, NormalLaw};
