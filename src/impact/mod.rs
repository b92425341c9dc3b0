//! Collisions: when contact begins and ends, and what it did to the body.
//!
//! [`Detector`] notices contact while positions come in; [`solve`] measures it
//! once it has ended, from the flights on both sides and from contact laws
//! fitted to the positions between.

mod approach;
mod departure;
mod detect;
mod fall;
mod family;
mod fit;
mod law;
mod onset;
mod passage;
mod slip;
mod solve;
mod trail;

pub use approach::{Approach, Beside};
pub use detect::{Contact, Detector, Event};
pub use family::{FirstGuess, Verdict, judge};
pub use fit::{Expected, LawFit, fit_law};
pub use law::{Family, Findings, Parameters, Units};
pub use passage::Passages;
pub use solve::{World, deepest_so_far, solve};
pub use trail::{SurfaceNode, between};
