//! Withdrawal of rotations, jumps and lone outlines that no neighbouring frame supports.

use super::jump::is_jump;
use super::measurer::Measurer;
use super::outline::Outline;
use super::pending_frame::{BodyKey, FoundOutline, Measured, PendingFrame};
use super::rotation_support::{Changes, Neighbour, Turn};
use crate::results::{OutlineOrigin, PointStatus, RigidStep};

impl Measurer {
    /// Whether a finished frame has to wait for the next one in its block, which alone may support it.
    ///
    /// The outlines of the frames from `awaited` on may still be found.
    pub(super) fn awaits_support(&self, frame: &PendingFrame, next: &PendingFrame, awaited: u64) -> bool {
        let is_open =
            next.block == frame.block && (next.done.iter().any(Option::is_none) || next.meta.sequence >= awaited);
        let awaits = |body: usize| {
            let shown = self.turn(frame, body);
            shown.is_some_and(|(turn, before)| !turn.is_supported([before, Neighbour::Absent], Changes::Excluded))
                || self.leads_away(frame, body, frame.before[body * self.params.intervals_frames.len()].as_ref())
                || self.is_lone(frame, Some(next), body)
        };
        is_open && (0..self.finders.len()).any(awaits)
    }

    /// Withdraws what no neighbour supports: the rotation of a ball, so that its outlines alone give its motion, a jump
    /// to another object, and an outline that was found in one frame alone.
    ///
    /// `next` is the next frame of the block, if it has one.
    pub(super) fn withdraw_unsupported(&mut self, frame: &mut PendingFrame, next: Option<&PendingFrame>) {
        let intervals = self.params.intervals_frames.len();
        for body in 0..self.finders.len() {
            self.withdraw_other_object(frame, next, body);
            let following = next.and_then(|next| next.done[body * intervals].as_ref());
            let after = following.map_or(Neighbour::Absent, |following| Neighbour::of(&following.step));
            let shown = self.turn(frame, body);
            if shown.is_some_and(|(turn, before)| !turn.is_supported([before, after], Changes::Allowed)) {
                let found = next.map(|next| next.outlines[body]);
                self.withdraw(frame, body, found);
            }
            self.withdraw_untested(frame, body);
            let shortest = frame.done[body * intervals].as_ref();
            let status = shortest.map_or(PointStatus::Valid, |measured| measured.step.status);
            let own = shortest.map_or(Neighbour::Absent, |measured| Neighbour::of(&measured.step));
            let state = self.states.state_mut(BodyKey { body, block: frame.block });
            (state.last_turn, state.last_status) = (own, status);
            state.was_found = Some(frame.outlines[body].outline.is_ok());
        }
    }

    /// Withdraws what may belong to another object: a motion that leads to it, the outline that it leads to, and an outline
    /// that was found in one frame alone.
    fn withdraw_other_object(&mut self, frame: &mut PendingFrame, next: Option<&PendingFrame>, body: usize) {
        let intervals = self.params.intervals_frames.len();
        let slots = body * intervals..(body + 1) * intervals;
        let before = frame.before[slots.start];
        let leads_away = self.leads_away(frame, body, motion_after(next, slots.start, before).as_ref());
        let is_lone = self.is_lone(frame, next, body);
        let state = self.states.state_mut(BodyKey { body, block: frame.block });
        let is_led_away = std::mem::replace(&mut state.is_led_away, leads_away);
        for measured in frame.done[slots].iter_mut().flatten() {
            match () {
                () if is_led_away => measured.withdraw_outline(PointStatus::Ambiguous),
                () if is_lone => measured.withdraw_outline(PointStatus::Lost),
                () if leads_away => measured.withdraw_motion(PointStatus::Ambiguous),
                () => {}
            }
        }
    }

    /// Gives the last frame of a stream the status of the one before. No motion from it was measured that could confirm or
    /// contradict what was found.
    fn withdraw_untested(&mut self, frame: &mut PendingFrame, body: usize) {
        let intervals = self.params.intervals_frames.len();
        let status = self.states.state_mut(BodyKey { body, block: frame.block }).last_status;
        let is_open = |measured: &Measured| {
            measured.field.is_none() && measured.step.motion.is_none() && measured.step.status == PointStatus::Valid
        };
        let measured = frame.done[body * intervals..(body + 1) * intervals].iter_mut().flatten();
        if status != PointStatus::Valid {
            measured.filter(|measured| is_open(measured)).for_each(|measured| measured.withdraw_motion(status));
        }
    }

    /// Whether the motion of a ball from a frame to the next one leads to another object.
    fn leads_away(&self, frame: &PendingFrame, body: usize, after: Option<&RigidStep>) -> bool {
        let slot = body * self.params.intervals_frames.len();
        let measured = frame.done[slot].as_ref().filter(|_| frame.has_ball(body));
        measured.is_some_and(|measured| is_jump(&measured.step, frame.before[slot].as_ref(), after))
    }

    /// Whether a ball or a rod was found in a frame, but neither in the one before nor in the next one of the block.
    ///
    /// Something that looks like it for a moment is no evidence. A frame that is alone in its block stands for itself.
    fn is_lone(&self, frame: &PendingFrame, next: Option<&PendingFrame>, body: usize) -> bool {
        let is_outlined = matches!(frame.outlines[body].outline, Ok(Outline::Ball(_) | Outline::Rod(_)));
        let is_absent = |frame: &PendingFrame| frame.outlines[body].outline.is_err();
        let before = self.states.was_found(BodyKey { body, block: frame.block });
        is_outlined
            && frame.outlines[body].origin == OutlineOrigin::Detected
            && match (before, next) {
                (None, None) => false,
                (before, next) => before != Some(true) && next.is_none_or(is_absent),
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

/// Returns the motion of a body from the next frame, by its place among the results; the one `before` the frame, if the
/// next one is ambiguous: whatever was there led away from the body.
fn motion_after(next: Option<&PendingFrame>, slot: usize, before: Option<RigidStep>) -> Option<RigidStep> {
    let measured = next.and_then(|next| next.done[slot].as_ref())?;
    if measured.step.status == PointStatus::Ambiguous { before } else { measured.step.motion }
}
