//! Collision physics: a ball against a heavy flat.
//!
//! Normal contact after Kelvin-Voigt or Hunt and Crossley, tangential contact
//! by a spring and a damper whose force is limited by friction, so that the
//! contact point slips, grips and slips again as it does in experiments.

mod collision;
mod law;

pub use collision::{Collision, CollisionSetup, Motion, Outcome, PhysicsError};
pub use law::{Friction, NormalLaw};
