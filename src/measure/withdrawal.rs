//! Withdrawal of rotations that no neighbouring step supports.

use super::measurer::Measurer;
use super::outline_motion::FoundOutline;
use super::pending_frame::{BodyKey, PendingFrame};
use super::rotation_support::{Changes, Neighbour, Turn};
use crate::results::PointStatus;

impl Measurer {
    /// Whether a finished frame has to wait for the motion of the next one in its block, which alone may support a
    /// rotation.
    pub(super) fn awaits_support(&self, frame: &PendingFrame, next: &PendingFrame) -> bool {
        let is_open = next.block == frame.block && next.done.iter().any(Option::is_none);
        let awaits = |body: usize| {
            let shown = self.turn(frame, body);
            shown.is_some_and(|(turn, before)| !turn.is_supported([before, Neighbour::Absent], Changes::Excluded))
        };
        is_open && (0..self.finders.len()).any(awaits)
    }

    /// Replaces the motions of balls whose rotations no neighbour supports by those of their outlines.
    ///
    /// `next` is the next frame of the block, if it has one.
    pub(super) fn withdraw_unsupported(&mut self, frame: &mut PendingFrame, next: Option<&PendingFrame>) {
        let intervals = self.params.intervals_frames.len();
        for body in 0..self.finders.len() {
            let following = next.and_then(|next| next.done[body * intervals].as_ref());
            let after = following.map_or(Neighbour::Absent, |following| Neighbour::of(&following.step));
            let shown = self.turn(frame, body);
            if shown.is_some_and(|(turn, before)| !turn.is_supported([before, after], Changes::Allowed)) {
                let found = next.map(|next| FoundOutline { outline: next.outlines[body], origin: next.origins[body] });
                self.withdraw(frame, body, found);
            }
            let shortest = frame.done[body * intervals].as_ref();
            let own = shortest.map_or(Neighbour::Absent, |measured| Neighbour::of(&measured.step));
            self.states.state_mut(BodyKey { body, block: frame.block }).last_turn = own;
        }
    }

    /// Returns the rotation of a ball from a frame, and the step before; `None` without a rotation.
    fn turn(&self, frame: &PendingFrame, body: usize) -> Option<(Turn, Neighbour)> {
        let measured = frame.done[body * self.params.intervals_frames.len()].as_ref();
        let Neighbour::Measured(turn) = Neighbour::of(&measured.filter(|_| frame.has_ball(body))?.step) else {
            return None;
        };
        Some((turn, self.states.last_turn(BodyKey { body, block: frame.block })))
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
