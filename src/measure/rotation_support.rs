//! Support of a measured rotation by the steps before and after it.
//!
//! A match may find a place at which marks and light happen to lie upon each other. Such a rotation has no neighbour that
//! is like it, while a body keeps its spin from frame to frame, and changes it over several.

use super::measurer::Measurer;
use super::outline::Outline;
use super::outline_motion::FoundOutline;
use super::pending_frame::{BodyKey, PendingFrame};
use crate::results::{BodyStep, MotionMethod, PointStatus, RigidStep};

/// The number of standard uncertainties by which a rotation may exceed those beside it.
const SAME_SIGMAS: f64 = 3.0;
/// The fraction of the only rotation beside it by which a rotation may exceed it.
const SAME_FRACTION: f64 = 0.5;
/// The difference between two rotations that is always allowed, deg.
const SAME_DEG: f64 = 1.5;

/// The rotation of a body in one step, per frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turn {
    deg: f64,
    sigma_deg: f64,
}

/// The step beside another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Neighbour {
    /// There is none in the block.
    Absent,
    /// Its rotation was not measured.
    Unmeasured,
    /// Its rotation was measured.
    Measured(Turn),
}

impl Neighbour {
    /// Returns the neighbour that a step is.
    fn of(step: &BodyStep) -> Self {
        match step.motion.filter(RigidStep::has_rotation) {
            Some(motion) if step.method != MotionMethod::Outlines => {
                Self::Measured(Turn { deg: motion.dtheta_deg, sigma_deg: motion.sigma_dtheta_deg })
            }
            _ => Self::Unmeasured,
        }
    }
}

impl Turn {
    /// Whether a rotation lies between those beside it, or about as far as one of them. One without a neighbour stands
    /// for itself.
    fn is_supported(&self, neighbours: [Neighbour; 2]) -> bool {
        if neighbours == [Neighbour::Absent; 2] {
            return true;
        }
        let turns = neighbours.iter().filter_map(|neighbour| match neighbour {
            Neighbour::Measured(turn) => Some(turn),
            _ => None,
        });
        // A change of the spin that goes on is seen on one side only.
        let fraction = if turns.clone().count() == 1 { SAME_FRACTION } else { 0.0 };
        let range = turns.map(|turn| {
            let tolerance_deg =
                SAME_SIGMAS * self.sigma_deg.hypot(turn.sigma_deg) + fraction * turn.deg.abs() + SAME_DEG;
            [turn.deg - tolerance_deg, turn.deg + tolerance_deg]
        });
        let range = range.reduce(|one, other| [one[0].min(other[0]), one[1].max(other[1])]);
        range.is_some_and(|[low, high]| (low..=high).contains(&self.deg))
    }
}

impl Measurer {
    /// Whether a finished frame has to wait for the motion of the next one in its block, which alone may support a
    /// rotation.
    pub(super) fn awaits_support(&self, frame: &PendingFrame, next: &PendingFrame) -> bool {
        let is_open = next.block == frame.block && next.done.iter().any(Option::is_none);
        is_open && (0..self.finders.len()).any(|body| self.unsupported(frame, body, Neighbour::Absent).is_some())
    }

    /// Replaces the motions of balls whose rotations no neighbour supports by those of their outlines.
    ///
    /// `next` is the next frame of the block, if it has one.
    pub(super) fn withdraw_unsupported(&mut self, frame: &mut PendingFrame, next: Option<&PendingFrame>) {
        let intervals = self.params.intervals_frames.len();
        for body in 0..self.finders.len() {
            let following = next.and_then(|next| next.done[body * intervals].as_ref());
            let after = following.map_or(Neighbour::Absent, |following| Neighbour::of(&following.step));
            if self.unsupported(frame, body, after).is_some() {
                let found =
                    next.map(|next| FoundOutline { outline: next.outlines[body].clone(), origin: next.origins[body] });
                self.withdraw(frame, body, found);
            }
            let shortest = frame.done[body * intervals].as_ref();
            let own = shortest.map_or(Neighbour::Absent, |measured| Neighbour::of(&measured.step));
            self.states.state_mut(BodyKey { body, block: frame.block }).last_turn = own;
        }
    }

    /// Returns the rotation of a ball in a frame if neither the step before nor the one after supports it.
    fn unsupported(&self, frame: &PendingFrame, body: usize, after: Neighbour) -> Option<Turn> {
        let (Ok(Outline::Ball(_)), Some(measured)) =
            (&frame.outlines[body], &frame.done[body * self.params.intervals_frames.len()])
        else {
            return None;
        };
        let Neighbour::Measured(turn) = Neighbour::of(&measured.step) else { return None };
        let before = self.states.last_turn(BodyKey { body, block: frame.block });
        (!turn.is_supported([before, after])).then_some(turn)
    }

    /// Replaces the motions of a ball from a frame by that of its outlines, if the next one was found.
    fn withdraw(&mut self, frame: &mut PendingFrame, body: usize, found: Option<FoundOutline>) {
        let intervals = self.params.intervals_frames.len();
        for measured in frame.done[body * intervals..(body + 1) * intervals].iter_mut().flatten() {
            measured.step = measured.step.without_motion();
        }
        let Some(found) = found else { return };
        let state = self.states.state_mut(BodyKey { body, block: frame.block });
        // The motions of later frames are known already.
        let newest = (state.motion, state.center_motion);
        self.move_by_outlines(frame, body, found);
        let state = self.states.state_mut(BodyKey { body, block: frame.block });
        (state.motion, state.center_motion) = newest;
        if let Some(measured) = &mut frame.done[body * intervals]
            && measured.step.motion.is_some()
        {
            measured.step.rotation_status = PointStatus::Ambiguous;
        }
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
        let is_supported = |deg: f64, before, after| Turn { deg, sigma_deg: 0.1 }.is_supported([before, after]);
        assert!(is_supported(8.0, turned(7.9), turned(8.1)));
        assert!(is_supported(8.0, Unmeasured, turned(8.1)) && is_supported(8.0, turned(7.9), Absent));
        assert!(is_supported(8.0, Absent, Absent), "the only step of its block");
        assert!(!is_supported(-20.0, Unmeasured, Unmeasured) && !is_supported(-20.0, Absent, Unmeasured));
        assert!(!is_supported(1.6, turned(8.0), turned(8.0)) && !is_supported(-4.7, turned(-0.4), Unmeasured));
        // A collision changes the spin over several frames, or within one.
        assert!(is_supported(1.0, turned(0.1), turned(3.0)) && is_supported(-2.0, turned(3.0), turned(-8.0)));
    }
}
