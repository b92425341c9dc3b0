//! From displacements in pixels to velocities in metres per second.
//!
//! Steps are added up to poses ([`Chain`]), poses give rates by local fits
//! ([`smooth`]), rates become velocities along the surface's axes
//! ([`physical`]), the only place where y turns from down to up.

mod anchor;
mod axes;
mod chain;
mod drift;
mod fixed;
mod growth;
mod lens;
mod params;
mod radius;
mod rectifier;
mod rolling;
mod smooth;
mod sums;
mod tapes;
mod walk;

pub use crate::numeric::{MAX_ORDER, Polynomial, Sample};
pub use anchor::{Anchor, Center};
pub use axes::{Axes, MetresPerPixel, PixelRates, Surface, gravity_px, physical};
pub use chain::{Chain, Node};
pub use drift::{Drift, Here};
pub use fixed::{RunningShare, Shortening, Spans};
pub use growth::{Growth, Seen, surely};
pub use lens::{Distortion, Lens};
pub use params::{Form, MotionParams, RingLimits, Rotation, Scale, View};
pub use radius::RunningRadius;
pub use rectifier::{Calibration, Rectifier, RectifierError};
pub use rolling::{Rolling, Shutter};
pub use smooth::{AUTO_AHEAD_FRAMES, Known, Regime, lag_frames, local_fit, smooth};
pub use sums::Sums;
pub use walk::{Kept, Renewal, Walk, subset_walk};
