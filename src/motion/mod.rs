//! From displacements in pixels to velocities in metres per second.
//!
//! Steps are integrated to poses ([`PoseIntegrator`]), poses give rates by local fits ([`smooth`]), and rates become velocities
//! along the surface's axes ([`physical`]). This is the only place where y turns from down to up.

mod center_filter;
mod form;
mod lone_step;
mod params;
mod patch_repeat;
mod pose_integration;
mod random_walk;
mod rectify;
mod scale;
mod scatter;
mod shutter;
mod surface_axes;
mod systematic;
mod velocity_fit;

pub use center_filter::{Center, CenterFilter};
pub use form::Form;
pub use lone_step::widened_by_neighbours;
pub use params::{MotionParams, RingLimits, Rotation, Scale, View};
pub use pose_integration::{Pose, PoseIntegrator};
pub use random_walk::{KeptReference, RandomWalk, Renewal, subset_walk};
pub use rectify::{Calibration, Rectifier, RectifierError};
pub use rectify::{Distortion, Lens};
pub use scale::RunningRadius;
pub use scatter::Scatter;
pub use shutter::Shutter;
pub use surface_axes::{Axes, MetresPerPixel, PixelRates, Surface, gravity_px, physical};
pub use systematic::CumulativeSums;
pub use systematic::RollingShutter;
pub use systematic::{Intervals, PlanarRates, RunningBias, SpeedBias};
pub use systematic::{LocalDrift, OutlineDrift};
pub use systematic::{SizeChange, ViewPosition, shrink_insignificant};
pub use velocity_fit::{DEFAULT_LAG_FRAMES, KnownMotion, Regime, smooth};
