//! From displacements in pixels to velocities in metres per second.
//!
//! Steps are added up to poses ([`Chain`]), poses give rates by local fits
//! ([`smooth`]), rates become velocities along the surface's axes
//! ([`physical`]), the only place where y turns from down to up.

mod center_filter;
mod params;
mod pose_integration;
mod random_walk;
mod rectify;
mod scale;
mod surface_axes;
mod systematic;
mod velocity_fit;

pub use crate::numeric::{MAX_ORDER, Polynomial, Sample};
pub use center_filter::{Anchor, Center};
pub use params::{Form, MotionParams, RingLimits, Rotation, Scale, View};
pub use pose_integration::{Chain, Node};
pub use random_walk::{Kept, Renewal, Walk, subset_walk};
pub use rectify::{Calibration, Rectifier, RectifierError};
pub use rectify::{Distortion, Lens};
pub use scale::RunningRadius;
pub use surface_axes::{Axes, MetresPerPixel, PixelRates, Surface, gravity_px, physical};
pub use systematic::Sums;
pub use systematic::{Drift, Here};
pub use systematic::{Growth, Seen, surely};
pub use systematic::{Rolling, Shutter};
pub use systematic::{RunningShare, Shortening, Spans};
pub use velocity_fit::{AUTO_AHEAD_FRAMES, Known, Regime, lag_frames, local_fit, smooth};
