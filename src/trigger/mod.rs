//! What starts a shot.

mod motion;

pub use motion::MotionTrigger;
