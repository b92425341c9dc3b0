//! Support of a measured rotation by the steps before and after it.
//!
//! A match may find a place at which marks and light happen to lie upon each other. Such a rotation has no neighbour that
//! is like it, while a body keeps its spin from frame to frame, and changes it over several.

use crate::results::{BodyStep, MotionMethod, RigidStep};

/// The number of standard uncertainties by which a rotation may exceed those of its neighbours.
const SAME_SIGMAS: f64 = 3.0;
/// The fraction of its only neighbour by which a rotation may exceed it.
const SAME_FRACTION: f64 = 0.5;
/// The difference between two rotations that is always allowed, deg.
const SAME_DEG: f64 = 1.5;

/// The rotation of a body in one step, per frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turn {
    deg: f64,
    sigma_deg: f64,
}

/// The step before or after another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Neighbour {
    /// There is none in the block.
    Absent,
    /// Its rotation was not measured.
    Unmeasured,
    /// Its rotation was measured.
    Measured(Turn),
}

/// Whether the spin may change by a part of itself from the only neighbour with a rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Changes {
    Allowed,
    Excluded,
}

impl Neighbour {
    /// Returns the neighbour that a step is.
    pub(super) fn of(step: &BodyStep) -> Self {
        match step.motion.filter(RigidStep::has_rotation) {
            Some(motion) if step.method != MotionMethod::Outlines => {
                Self::Measured(Turn { deg: motion.dtheta_deg, sigma_deg: motion.sigma_dtheta_deg })
            }
            _ => Self::Unmeasured,
        }
    }
}

impl Turn {
    /// Whether the rotation lies between those of the neighbouring frames, or about as far as one of them. Without
    /// neighbours it is accepted.
    pub(super) fn is_supported(&self, neighbours: [Neighbour; 2], changes: Changes) -> bool {
        if neighbours == [Neighbour::Absent; 2] {
            return true;
        }
        let turns = neighbours.iter().filter_map(|neighbour| match neighbour {
            Neighbour::Measured(turn) => Some(turn),
            _ => None,
        });
        // A change of the spin that goes on is seen on one side only.
        let is_open = changes == Changes::Allowed && turns.clone().count() == 1;
        let fraction = if is_open { SAME_FRACTION } else { 0.0 };
        let range = turns.map(|turn| {
            let tolerance_deg =
                SAME_SIGMAS * self.sigma_deg.hypot(turn.sigma_deg) + fraction * turn.deg.abs() + SAME_DEG;
            [turn.deg - tolerance_deg, turn.deg + tolerance_deg]
        });
        let range = range.reduce(|one, other| [one[0].min(other[0]), one[1].max(other[1])]);
        range.is_some_and(|[low, high]| (low..=high).contains(&self.deg))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(deg: f64) -> Neighbour {
        Neighbour::Measured(Turn { deg, sigma_deg: 0.1 })
    }

    #[test]
    fn a_rotation_needs_a_neighbour_that_is_like_it() {
        use Neighbour::{Absent, Unmeasured};
        let is_supported =
            |deg: f64, before, after| Turn { deg, sigma_deg: 0.1 }.is_supported([before, after], Changes::Allowed);
        assert!(is_supported(8.0, turned(7.9), turned(8.1)));
        assert!(is_supported(8.0, Unmeasured, turned(8.1)) && is_supported(8.0, turned(7.9), Absent));
        assert!(is_supported(8.0, Absent, Absent), "the only step of its block");
        assert!(!is_supported(-20.0, Unmeasured, Unmeasured) && !is_supported(-20.0, Absent, Unmeasured));
        assert!(!is_supported(1.6, turned(8.0), turned(8.0)) && !is_supported(-4.7, turned(-0.4), Unmeasured));
        // A collision changes the spin over several frames, or within one.
        assert!(is_supported(1.0, turned(0.1), turned(3.0)) && is_supported(-2.0, turned(3.0), turned(-8.0)));
    }
}
