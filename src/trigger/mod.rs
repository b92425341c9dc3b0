//! The conditions that start a shot, and the state of a rig.

mod flight;
mod measured;
mod motion;
mod quiet;
mod state;

pub use measured::{BodyWatch, Condition, Decision, MeasuredTrigger};
pub use motion::MotionTrigger;
pub use quiet::Quiet;
pub use state::{Recorder, RigState, States};
