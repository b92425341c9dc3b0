//! Search of the bodies in a frame: the outlines of balls and rods, the poses of patches.

use super::consistency::{DetectedBall, OutlineMotion};
use super::measurer::Measurer;
use super::outline::{Finder, Outline, SearchRange};
use super::patch_finder::{AngleRange, FrameKey};
use super::pending_frame::{BodyKey, FoundOutline};
use crate::ball::Presence;
use crate::image::Frame;
use crate::results::{OutlineOrigin, PointStatus};

/// The number of frames from one detected outline to the next of a ball that is matched as a whole and not occluded.
pub const OUTLINE_INTERVAL_FRAMES: u64 = 4;

/// The number of frames from one search of a lost patch at every angle to the next.
const FULL_SEARCH_FRAMES: u64 = 16;

impl Measurer {
    /// Returns the outline of one body in the current frame.
    ///
    /// It is propagated where that is certain enough, else searched near its predicted position. If it is not there, a
    /// matched motion predicts it. Otherwise it is searched from scratch, and a ball may coast. A body whose results
    /// contradicted each other is ambiguous for a while.
    pub(super) fn find_outline(&mut self, body: usize, frame: &Frame<'_>, block: u64) -> FoundOutline {
        if matches!(self.finders[body], Finder::Patch(_)) {
            return FoundOutline { outline: self.find_patch(body, frame, block), origin: OutlineOrigin::Detected };
        }
        let (sequence, key) = (frame.meta.sequence, BodyKey { body, block });
        self.states.state_mut(key).renew_if_due(sequence);
        let state = *self.states.state_mut(key);
        if state.is_ambiguous {
            return FoundOutline { outline: Err(PointStatus::Ambiguous), origin: OutlineOrigin::Predicted };
        }
        let motion = state.motion.and(state.center_motion);
        let expected =
            state.outline.map(|(last, outline)| outline.predicted(motion.as_ref(), (sequence - last) as f64));
        if let Some((outline, true)) = expected
            && self.can_reuse_outline(key, sequence)
        {
            self.states.state_mut(key).outline = Some((sequence, outline));
            return FoundOutline { outline: Ok(outline), origin: OutlineOrigin::Reused };
        }
        let followed = expected.and_then(|(near, _)| self.follow_outline(key, frame, &near));
        // A matched motion is far more certain than an outline. If there is no outline, it predicts the centre. A motion
        // from outlines ends with the last of them: the ball may have struck something since.
        let is_matched = |near: &Outline| !matches!(near, Outline::Ball(_)) || motion.is_some_and(|m| m.has_rotation());
        let moved = expected.filter(|(_, is_measured)| *is_measured).map(|(near, _)| near.without_detection());
        let found = match (followed, moved) {
            (Some(outline), _) => FoundOutline::detected(outline),
            (None, Some(outline)) if is_matched(&outline) => {
                FoundOutline { outline: Ok(outline), origin: OutlineOrigin::Predicted }
            }
            (None, moved) => {
                let unseen_frames = sequence - state.detected_frame.unwrap_or(sequence);
                let coasted = moved.zip(motion).and_then(|(near, step)| near.coasted(&step, unseen_frames));
                self.search_outline(key, frame, coasted)
            }
        };
        self.note_outline(key, sequence, &found);
        found
    }

    /// Searches an outline near its predicted position `near`, first closely.
    fn follow_outline(&mut self, key: BodyKey, frame: &Frame<'_>, near: &Outline) -> Option<Outline> {
        // If the whole body was matched, and detected a moment ago, no other circle is its outline.
        let is_certain = self.is_detected_since(key, frame.meta.sequence.saturating_sub(OUTLINE_INTERVAL_FRAMES))
            && self.rigid_matcher.has_match(key, frame.meta.sequence);
        let presence = if is_certain { Presence::Certain } else { Presence::Uncertain };
        let finder = &mut self.finders[key.body];
        let view = self.image.unpack_box(frame, finder.search_box(near, SearchRange::Close));
        finder.follow_closely(view, near, presence).or_else(|| {
            let view = self.image.unpack_box(frame, finder.search_box(near, SearchRange::Wide));
            finder.follow(view, near).ok()
        })
    }

    /// Searches an outline in the whole frame. If there is none, the ball may have moved on to `coasted`.
    fn search_outline(&mut self, key: BodyKey, frame: &Frame<'_>, coasted: Option<Outline>) -> FoundOutline {
        let found = self.finders[key.body].find(self.image.unpack_all(frame));
        let found = found.or_else(|status| self.find_changed(key.body, frame, key.block).ok_or(status));
        if let (Err(_), Some(outline)) = (found, coasted) {
            return FoundOutline { outline: Ok(outline), origin: OutlineOrigin::Coasted };
        }
        // It was not where its motion would have led it.
        self.states.state_mut(key).motion = None;
        FoundOutline { outline: found, origin: OutlineOrigin::Detected }
    }

    /// Stores an outline in the state of its body.
    fn note_outline(&mut self, key: BodyKey, sequence: u64, found: &FoundOutline) {
        let state = self.states.state_mut(key);
        state.outline = found.outline.ok().map(|outline| (sequence, outline));
        let (Ok(outline), OutlineOrigin::Detected) = (found.outline, found.origin) else { return };
        state.detected_frame = Some(sequence);
        if let Outline::Ball(circle) = outline {
            let here = DetectedBall { frame: sequence, circle };
            let first = state.first_ball.get_or_insert(here);
            state.outline_motion = OutlineMotion::between(first, &here).or(state.outline_motion);
        }
    }

    /// Whether the outline can be predicted by the measured motion instead of being detected again.
    ///
    /// It can if the whole body was matched in this frame without occlusion, its outline was detected shortly before, and
    /// no outline contradicted its motion. Outlines of neighbouring frames have mostly the same error. The motion between
    /// them is ten times more certain.
    fn can_reuse_outline(&mut self, key: BodyKey, frame: u64) -> bool {
        // The motion over several frames says less about the last of them.
        self.params.intervals_frames.first() == Some(&1)
            && self.states.state_mut(key).doubts == 0
            && self.is_detected_since(key, (frame + 1).saturating_sub(OUTLINE_INTERVAL_FRAMES))
            && self.rigid_matcher.is_fully_visible(key, frame)
    }

    /// Whether an outline was detected in this frame or a later one.
    fn is_detected_since(&mut self, key: BodyKey, frame: u64) -> bool {
        self.states.state_mut(key).detected_frame.is_some_and(|detected| detected >= frame)
    }

    /// Returns the pose of a patch in the current frame, from the motion to it or searched from scratch.
    ///
    /// # Errors
    ///
    /// [`PointStatus::Occluded`] or [`PointStatus::Lost`] if it is not found, [`PointStatus::Ambiguous`] if it matches
    /// its own image at several places.
    fn find_patch(&mut self, body: usize, frame: &Frame<'_>, block: u64) -> Result<Outline, PointStatus> {
        let key = FrameKey { block, frame: frame.meta.sequence };
        let Finder::Patch(finder) = &mut self.finders[body] else { return Err(PointStatus::Lost) };
        let found = match finder.cached(key) {
            Some(Ok(pose)) => Ok(pose),
            before => {
                let state = *self.states.state_mut(BodyKey { body, block });
                // A patch that was just seen may have turned by any angle. One that stays lost is hidden, mostly.
                let is_new = !state.was_searched || state.outline.is_some();
                let is_due = key.frame.is_multiple_of(FULL_SEARCH_FRAMES);
                let angles = if is_new || is_due { AngleRange::Full } else { AngleRange::Small };
                let (width, height) = (self.size.width as u32, self.size.height as u32);
                let mut full_frame = self.spare.take();
                let view = self.image.unpack_all(frame);
                self.correlator.prepare_part_into(view, [0, 0, width, height], &mut full_frame);
                let found = finder.find(key, &full_frame, angles);
                self.spare.put(full_frame);
                // The match near the predicted pose detects an occlusion more reliably.
                let is_occluded = matches!(before, Some(Err(PointStatus::Occluded)));
                let unseen = if is_occluded { PointStatus::Occluded } else { PointStatus::Lost };
                found.map_err(|_| finder.refusal().unwrap_or(unseen))
            }
        };
        let state = self.states.state_mut(BodyKey { body, block });
        (state.was_searched, state.outline) =
            (true, found.ok().map(|pose| (frame.meta.sequence, Outline::Patch(pose))));
        if found.is_err() {
            state.motion = None;
        }
        found.map(Outline::Patch)
    }
}
