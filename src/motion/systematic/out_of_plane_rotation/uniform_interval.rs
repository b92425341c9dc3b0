//! The interval around a moment in which the drift of a ball is uniform.

use crate::numeric::{Polynomial, Sample};

/// Lines through the sums of steps between two times, px, px and deg, and the sums.
pub(super) type Lines = [(Polynomial, Vec<Sample>); 3];

/// An interval of uniform drift.
#[derive(Debug)]
pub(super) struct UniformInterval {
    pub(super) from_frames: f64,
    pub(super) to_frames: f64,
    /// The rms scatter of its steps, px, px and deg per frame; 0 if they are uniform.
    pub(super) scatter: [f64; 3],
    /// The lines, if steps determine any.
    pub(super) lines: Option<Lines>,
}
