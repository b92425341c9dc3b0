//! A first look at a film: what moves in it, which kind of body that is, and what it strikes.
//!
//! A survey needs no rig file. It proposes one. The steps are:
//! 1. [`Sampler`] takes reduced images spread over the film. Their median in time is the background. What differs from it
//!    moves, and connected regions of such pixels are [`Mover`]s.
//! 2. [`identify()`] searches a ball, then a rod, in the frames that show a mover best. If neither is found in most of them,
//!    the mover is a patch.
//! 3. [`Follower`] follows the ball through all frames. The [`Path`] shows where it bounces, and which acceleration it has.
//! 4. [`find_surface_edge`] finds the edge in the background that the ball touches where it bounces.

mod components;
mod follower;
mod identify;
mod movement;
mod path;
mod path_fit;
mod sampler;
mod surface;

pub use follower::{Follower, TrackPoint};
pub use identify::{Examination, ExaminedFrame, Identified, identify, needed_frames};
pub use movement::{Appearance, Movement, Mover};
pub use path::{Acceleration, Bounce, Path};
pub use sampler::{ReducedImage, Sampler};
pub use surface::{SurfaceEdge, find_surface_edge};
