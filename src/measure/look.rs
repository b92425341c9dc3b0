//! Where the bodies are in a frame: the outlines of balls and rods, the poses of patches.

use super::block::Measurer;
use super::outline::{Finder, Outline};
use super::reference::Source;
use crate::image::Frame;
use crate::results::PointStatus;

/// A ball that is matched as a whole, with nothing before it, has its outline looked at once in so many frames.
pub const OUTLINE_FRAMES: u64 = 4;

impl Measurer {
    /// The outline of one body in the frame at hand: near where it must be, or from scratch.
    pub(super) fn find(
        &mut self,
        body: usize,
        frame: &Frame<'_>,
        block: u64,
    ) -> (Result<Outline, PointStatus>, Source) {
        if matches!(self.finders[body], Finder::Patch(_)) {
            return (self.find_patch(body, frame, block), Source::Seen);
        }
        let meta = &frame.meta;
        let known = *self.known.of(body, block);
        if known.confused {
            return (Err(PointStatus::Ambiguous), Source::Carried);
        }
        let carried_by = known.motion.and(known.center);
        let expected = known
            .outline
            .map(|(sequence, outline)| outline.carried(carried_by.as_ref(), (meta.sequence - sequence) as f64));
        if let Some((outline, true)) = expected
            && self.is_spared(body, block, meta.sequence)
        {
            self.known.of(body, block).outline = Some((meta.sequence, outline));
            return (Ok(outline), Source::Spared);
        }
        // Where the whole body was matched, and seen a moment ago, no other circle is its outline.
        let is_there = self.is_seen_since(body, block, meta.sequence.saturating_sub(OUTLINE_FRAMES))
            && self.wholes.sees((body, block), meta.sequence);
        let finder = &mut self.finders[body];
        let followed = expected.and_then(|(near, _)| {
            let close = self.picture.some(frame, finder.part_around(&near, true));
            finder.follow_closely(close, &near, is_there).or_else(|| {
                let wider = self.picture.some(frame, finder.part_around(&near, false));
                finder.follow(wider, &near).ok()
            })
        });
        // The motion is known far better than an outline is: where the outline cannot be told, it carries the centre.
        let carried = expected.filter(|(_, is_measured)| *is_measured).map(|(near, _)| near.by_motion_alone());
        let (found, source) = match (followed, carried) {
            (Some(outline), _) => (Ok(outline), Source::Seen),
            (None, Some(outline)) => (Ok(outline), Source::Carried),
            (None, None) => (finder.find(self.picture.whole(frame)), Source::Seen),
        };
        let known = self.known.of(body, block);
        known.outline = found.ok().map(|outline| (meta.sequence, outline));
        if source == Source::Seen && found.is_ok() {
            known.seen = Some(meta.sequence);
        }
        (found, source)
    }

    /// Whether an outline need not be looked at: the whole body was matched in this frame, nothing hides it, and it was
    /// seen a moment ago.
    ///
    /// What outlines of neighbouring frames are off by is mostly the same, and motion leads from one to the next ten
    /// times better than they are known.
    fn is_spared(&mut self, body: usize, block: u64, frame: u64) -> bool {
        // Motion over several frames says less of the last of them.
        self.params.intervals_frames.first() == Some(&1)
            && self.is_seen_since(body, block, (frame + 1).saturating_sub(OUTLINE_FRAMES))
            && self.wholes.sees_all((body, block), frame)
    }

    /// Whether an outline was looked at and seen in a frame or a later one.
    fn is_seen_since(&mut self, body: usize, block: u64, frame: u64) -> bool {
        self.known.of(body, block).seen.is_some_and(|seen| seen >= frame)
    }

    /// A patch in the frame at hand: as the motion to it said, or from scratch.
    fn find_patch(&mut self, body: usize, frame: &Frame<'_>, block: u64) -> Result<Outline, PointStatus> {
        let of = (block, frame.meta.sequence);
        let Finder::Patch(finder) = &mut self.finders[body] else { return Err(PointStatus::Lost) };
        let found = match finder.known(of.0, of.1) {
            Some(Ok(pose)) => Ok(pose),
            before => {
                let thorough = !self.known.of(body, block).searched;
                let (width, height) = (self.size.0 as u32, self.size.1 as u32);
                let mut whole = self.spare.pop().unwrap_or_default();
                let view = self.picture.whole(frame);
                self.correlator.prepare_part_into(view, [0, 0, width, height], &mut whole);
                let found = finder.find(of, &whole, thorough);
                self.spare.push(whole);
                // What hides it is known better from where it was followed to.
                let is_hidden = matches!(before, Some(Err(PointStatus::Occluded)));
                found.map_err(|_| if is_hidden { PointStatus::Occluded } else { PointStatus::Lost })
            }
        };
        let known = self.known.of(body, block);
        (known.searched, known.outline) = (true, found.ok().map(|pose| (frame.meta.sequence, Outline::Patch(pose))));
        if found.is_err() {
            known.motion = None;
        }
        found.map(Outline::Patch)
    }
}
