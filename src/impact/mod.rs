//! Collisions: the times of contact and its effect on the body.
//!
//! [`Detector`] detects contact while positions arrive. [`solve`] measures it once it has ended, from the flights on
//! both sides and from contact laws fitted to the positions between them.

mod contact;
mod contact_detector;
mod contact_law;
mod contact_onset;
mod departure;
mod flight_watch;
mod force_free;
mod free_fall;
mod interval;
mod law_fit;
mod law_motion;
mod model_selection;
mod out_of_plane;
mod quantities;
mod regime_history;
mod slip_end;
mod solver;
mod trajectory;

pub use contact::Contact;
pub use contact_detector::{Detector, Event};
pub use contact_law::{ContactEstimates, Family, Findings, Parameters, Units};
pub use interval::ImpactContext;
pub use law_fit::{Expected, LawFit, fit_law};
pub use model_selection::{ForceLawPosterior, InitialGuess, PositionErrors, select_law};
pub use out_of_plane::{DilatationRates, OutOfPlane};
pub use solver::{deepest_so_far, solve};
pub use trajectory::{ANGLE, SurfaceNode, nodes_between};
