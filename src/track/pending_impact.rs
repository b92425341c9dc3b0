//! The collision that is measured again while the flight after it grows.

use crate::impact::Contact;

/// The lengths of the flight after the end of contact at which an impact is measured again; the last is final, frames.
pub(super) const REVISIONS_FRAMES: [f64; 2] = [16.0, 64.0];

/// The last collision, which is measured again as the flight after it grows.
#[derive(Debug, Clone)]
pub(super) struct PendingImpact {
    pub(super) contact: Contact,
    pub(super) number: u32,
    pub(super) revision: u32,
    pub(super) measured_to_frames: f64,
    /// The number of [`REVISIONS_FRAMES`] that are reached.
    pub(super) stage: usize,
    /// The standard uncertainty of the last published restitution.
    pub(super) sigma: f64,
    /// The time of the last measurement, with or without a result.
    pub(super) tried_frames: f64,
}

/// The kind of a measurement of a collision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Revision {
    /// Replaces an earlier one if it is more certain.
    Preliminary,
    /// Replaces all earlier ones.
    Final,
}

/// Returns the number of revisions that are due once the flight after contact is known for `known_frames`.
pub(super) fn due_revisions(known_frames: f64) -> usize {
    REVISIONS_FRAMES.iter().filter(|after| known_frames >= **after).count()
}
