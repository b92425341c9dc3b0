//! The measurement of blocks of frames: steps and displacement fields.

use super::background::Background;
use super::block_state::BlockStates;
use super::bounding_box::BoundingBox;
use super::error::MeasureError;
use super::fixed_pattern::FixedPatterns;
use super::frame_image::FrameImage;
use super::outline::{Finder, Outline};
use super::params::{ImageSize, MeasureParams, Share};
use super::pending_frame::{BodyKey, FoundOutline, Measured, PendingFrame, Span, Target};
use super::rigid_match::{RigidMatcher, is_occluded};
use super::ring_rotation::RingCorrelator;
use super::spare_frames::SpareFrames;
use super::surface::Surface;
use crate::dic::{Correlator, PreparedFrame};
use crate::image::{Frame, FrameMeta, Image};
use crate::motion::Rotation;
use std::collections::VecDeque;

/// Measures blocks of frames.
///
/// The step of a frame is a function of the frames from the start of its block to the
/// target of the longest interval. It depends neither on earlier frames, nor on other
/// workers, nor on time. At the start of a block every body is searched from scratch.
/// Within the block each search starts from the previous frame.
pub struct Measurer {
    pub(super) correlator: Correlator,
    pub(super) finders: Vec<Finder>,
    pub(super) params: MeasureParams,
    pub(super) share: Share,
    /// A block of its share that it leaves out.
    skipped: Option<u64>,
    pub(super) size: ImageSize,
    pub(super) image: FrameImage,
    /// Frames whose motion is not measured yet, oldest first.
    pub(super) pending: VecDeque<PendingFrame>,
    pub(super) spare: SpareFrames,
    pub(super) states: BlockStates,
    pub(super) rigid_matcher: RigidMatcher,
    pub(super) ring_rotation: RingCorrelator,
    fixed_patterns: FixedPatterns,
    pub(super) background: Background,
}

impl Measurer {
    /// Plans the measurement of frames of this size.
    ///
    /// # Errors
    ///
    /// Returns an error if a setting is out of range or the settings do not allow a measurement.
    pub fn new(params: &MeasureParams, share: Share, width_px: usize, height_px: usize) -> Result<Self, MeasureError> {
        let finders =
            params.bodies.iter().map(|body| Finder::new(body, width_px, height_px)).collect::<Result<_, _>>()?;
        Ok(Self {
            correlator: Correlator::new(&params.correlation, width_px, height_px)?,
            finders,
            share,
            skipped: None,
            size: ImageSize { width: width_px, height: height_px },
            image: FrameImage::new(width_px, height_px, params.correction(width_px, height_px)?),
            pending: VecDeque::new(),
            spare: SpareFrames::default(),
            states: BlockStates::default(),
            rigid_matcher: RigidMatcher::default(),
            ring_rotation: RingCorrelator::default(),
            fixed_patterns: FixedPatterns::new(params),
            background: Background::new(width_px, height_px),
            params: params.clone(),
        })
    }

    /// Reserves the memory of the frames that are kept for reuse, so that a lost body, which is searched in whole frames,
    /// takes no more.
    pub fn reserve(&mut self) {
        let blank = Image::new(self.size.width, self.size.height);
        let whole = [0, 0, self.size.width as u32, self.size.height as u32];
        for _ in 0..SpareFrames::MAX_FRAMES {
            let mut prepared = PreparedFrame::default();
            self.correlator.prepare_part_into(blank.view(), whole, &mut prepared);
            self.spare.put(prepared);
        }
    }

    /// Whether there are patches, which need the image that they were drawn in.
    pub fn needs_reference(&self) -> bool {
        self.finders.iter().any(|finder| matches!(finder, Finder::Patch(_)))
    }

    /// Sets the image that the patches were drawn in, the first of the stream; without it patches are lost.
    ///
    /// # Errors
    ///
    /// Returns an error if the size of the image differs from the planned size.
    pub fn set_reference(&mut self, image: &Image) -> Result<(), MeasureError> {
        let view = image.view();
        let (width, height) = (view.width(), view.height());
        if (ImageSize { width, height }) != self.size {
            let ImageSize { width: expected_width_px, height: expected_height_px } = self.size;
            let (width_px, height_px) = (width as u32, height as u32);
            return Err(MeasureError::Size { sequence: 0, width_px, height_px, expected_width_px, expected_height_px });
        }
        let mut corrected = image.clone();
        self.image.correct_other(&mut corrected);
        let mut prepared = self.spare.take();
        self.correlator.prepare_part_into(corrected.view(), [0, 0, width as u32, height as u32], &mut prepared);
        for finder in &mut self.finders {
            if let Finder::Patch(finder) = finder {
                finder.set_reference(&prepared);
            }
        }
        self.spare.put(prepared);
        Ok(())
    }

    /// Discards all frames, for another stream.
    pub fn reset(&mut self) {
        self.pending.drain(..).for_each(|reference| self.spare.put(reference.prepared));
        self.skipped = None;
        self.states.clear();
        self.rigid_matcher.clear();
        self.fixed_patterns.clear();
        self.background.clear();
    }

    /// Whether this measurer needs a frame, as a member of one of its blocks or as a target of one.
    pub fn needs(&self, sequence: u64) -> bool {
        let block_frames = u64::from(self.params.block_frames);
        let owns = |sequence: u64| self.measures(sequence / block_frames);
        let is_target_over = |interval: &u32| sequence.checked_sub(u64::from(*interval)).is_some_and(owns);
        owns(sequence) || self.params.intervals_frames.iter().any(is_target_over)
    }

    /// Whether a block belongs to its share.
    pub fn owns(&self, block: u64) -> bool {
        self.share.contains(block)
    }

    /// Leaves out a block of its share, of which no frame was added yet. Its frames remain targets of the block before.
    pub fn skip_block(&mut self, block: u64) {
        self.skipped = Some(block);
    }

    /// Whether a block belongs to its share and is not left out.
    fn measures(&self, block: u64) -> bool {
        self.share.contains(block) && self.skipped != Some(block)
    }

    /// Adds the next frame of the stream and appends finished results in order.
    ///
    /// Frames come with rising sequence numbers. Frames that are not [needed](Self::needs) may be left out.
    ///
    /// # Errors
    ///
    /// Returns an error if the frame does not match its header, or if its size differs from the planned size.
    pub fn push(&mut self, frame: &Frame<'_>, measured: &mut Vec<Measured>) -> Result<(), MeasureError> {
        let meta = frame.meta;
        if !self.needs(meta.sequence) {
            return Ok(());
        }
        self.check_size(&meta)?;
        frame.check().map_err(|source| MeasureError::Frame { sequence: meta.sequence, source })?;
        self.image.begin();
        let block_frames = u64::from(self.params.block_frames);
        let block = meta.sequence / block_frames;
        if let Some(awaited) = self.background.first_kept().map(|kept| kept / block_frames).filter(|kept| *kept < block)
        {
            self.recover_lost_balls(awaited);
        }
        let own = self.measure_pending(frame, block);
        if self.measures(block) {
            self.add_pending(frame, block, own);
            self.check_consistency();
        } else if let Some((prepared, _)) = own {
            self.spare.put(prepared);
        }
        self.complete_by_outlines(frame);
        if (meta.sequence + 1).is_multiple_of(block_frames) {
            self.recover_lost_balls(block);
        }
        self.emit_finished(measured);
        if self.background.first_kept().is_some() {
            self.release_settled();
        }
        Ok(())
    }

    /// Measures the motions to `frame`. Returns it as prepared for `block`, if that has pending frames, and its box.
    ///
    /// The frame is prepared separately for each block, around the bodies of that block. The
    /// results of a block therefore do not depend on any other block.
    fn measure_pending(&mut self, frame: &Frame<'_>, block: u64) -> Option<(PreparedFrame, BoundingBox)> {
        let mut pending = std::mem::take(&mut self.pending);
        let mut own = None;
        let mut first = 0;
        while let Some(group) = pending.get(first).map(|reference| reference.block) {
            let last = pending.partition_point(|reference| reference.block <= group);
            let sequence = frame.meta.sequence;
            let mut prepared = self.spare.take();
            let predicted = self.states.predicted_box(group, sequence, &self.params.correlation, &self.rigid_matcher);
            let mut bounds =
                predicted.unwrap_or_else(|| self.states.search_box(group, sequence, &self.params.correlation));
            self.prepare(frame, bounds, &mut prepared);
            let mut is_narrow = predicted.is_some();
            for reference in pending.range_mut(first..last) {
                if !self.measure_due(reference, Some(Target { sequence, prepared: &prepared, is_narrow })) {
                    (bounds, is_narrow) = (self.states.search_box(group, sequence, &self.params.correlation), false);
                    self.prepare(frame, bounds, &mut prepared);
                    self.measure_due(reference, Some(Target { sequence, prepared: &prepared, is_narrow }));
                }
            }
            match group == block {
                true => own = Some((prepared, bounds)),
                false => self.spare.put(prepared),
            }
            first = last;
        }
        self.pending = pending;
        own
    }

    /// Unpacks and prepares the part of the current frame within `bounds`.
    fn prepare(&mut self, frame: &Frame<'_>, bounds: BoundingBox, prepared: &mut PreparedFrame) {
        let view = self.image.unpack(frame, bounds.rectangle().into());
        self.correlator.prepare_part_into(view, bounds.rectangle(), prepared);
    }

    /// Finds the bodies in the current frame, perhaps prepared as `own`, and keeps it until its targets have come.
    fn add_pending(&mut self, frame: &Frame<'_>, block: u64, own: Option<(PreparedFrame, BoundingBox)>) {
        let meta = frame.meta;
        let outlines: Vec<FoundOutline> =
            (0..self.finders.len()).map(|body| self.find_outline(body, frame, block)).collect();
        self.keep_if_lost(frame, &outlines);
        let mut needed = BoundingBox::default();
        let subset_px = self.params.correlation.subset_size_px;
        for outline in outlines.iter().filter_map(|found| found.outline.ok()) {
            needed.include_search(&outline.enclosing_circle(subset_px), 0.0);
        }
        let (mut prepared, bounds) = own.unwrap_or_else(|| (self.spare.take(), BoundingBox::default()));
        if bounds.is_empty() || !bounds.contains(&needed) {
            self.prepare(frame, needed, &mut prepared);
        }
        let oldest = self.pending.front().map_or(block, |reference| reference.block);
        self.states.forget_before(oldest);
        self.rigid_matcher.forget_before(oldest);
        self.fixed_patterns.forget_before(oldest);
        self.finders.iter_mut().for_each(|finder| finder.forget_before(oldest));
        for (body, found) in outlines.iter().enumerate() {
            // The match of the whole ball detects what occludes its subsets, whatever gives its motion.
            let Ok(Outline::Ball(circle)) = &found.outline else { continue };
            let state = self.states.state_mut(BodyKey { body, block });
            // A turning ball may show its marks only later.
            if Surface::is_open(state.surface) {
                state.surface = Some(Surface::classify(&prepared, circle, &mut self.ring_rotation));
            }
            if state.surface == Some(Surface::Textured)
                && (self.params.rotation == Rotation::Rigid || is_occluded(circle))
            {
                self.rigid_matcher.set_reference(BodyKey { body, block }, meta.sequence, &prepared, circle);
            }
        }
        let slots = self.finders.len() * self.params.intervals_frames.len();
        let (done, before) = (vec![None; slots], vec![None; slots]);
        self.pending.push_back(PendingFrame { meta, block, prepared, outlines, done, before });
    }

    /// Ends the stream: appends the results of the frames without a target.
    pub fn finish(&mut self, measured: &mut Vec<Measured>) {
        if let Some(kept) = self.background.first_kept() {
            self.recover_lost_balls(kept / u64::from(self.params.block_frames));
        }
        let mut pending = std::mem::take(&mut self.pending);
        for reference in &mut pending {
            self.measure_due(reference, None);
        }
        self.pending = pending;
        self.emit_finished(measured);
        self.states.clear();
    }

    /// Returns an error if the size of a frame differs from the planned size.
    fn check_size(&self, meta: &FrameMeta) -> Result<(), MeasureError> {
        let ImageSize { width: expected_width_px, height: expected_height_px } = self.size;
        if (meta.width_px as usize, meta.height_px as usize) == (expected_width_px, expected_height_px) {
            return Ok(());
        }
        let FrameMeta { sequence, width_px, height_px, .. } = *meta;
        Err(MeasureError::Size { sequence, width_px, height_px, expected_width_px, expected_height_px })
    }

    /// Measures the motions to this target and those whose target was missed; all of them if there is no target.
    ///
    /// Returns `false` if more of the target has to be prepared first.
    fn measure_due(&mut self, reference: &mut PendingFrame, target: Option<Target<'_>>) -> bool {
        for slot in 0..reference.done.len() {
            let due = reference.meta.sequence
                + u64::from(self.params.intervals_frames[slot % self.params.intervals_frames.len()]);
            let is_due = target.is_none_or(|target| target.sequence >= due);
            if reference.done[slot].is_none() && is_due {
                let target = target.filter(|target| target.sequence == due);
                let body = slot / self.params.intervals_frames.len();
                let before = self.states.state_mut(BodyKey { body, block: reference.block }).motion;
                let Some(measured) = self.measure_body(reference, slot, target) else { return false };
                reference.before[slot] = before;
                reference.done[slot] = Some(measured);
            }
        }
        true
    }

    /// Appends the results of frames that are measured with all targets, oldest first.
    fn emit_finished(&mut self, measured: &mut Vec<Measured>) {
        let awaited = self.background.first_kept().unwrap_or(u64::MAX);
        let is_finished =
            |reference: &PendingFrame| reference.meta.sequence < awaited && reference.done.iter().all(Option::is_some);
        while let Some(front) = self.pending.front().filter(|front| is_finished(front)) {
            if self.pending.get(1).is_some_and(|next| self.awaits_support(front, next, awaited)) {
                return;
            }
            let Some(mut reference) = self.pending.pop_front() else { return };
            let (block, next) = (reference.block, self.pending.pop_front());
            self.withdraw_unsupported(&mut reference, next.as_ref().filter(|next| next.block == block));
            if let Some(next) = next {
                self.pending.push_front(next);
            }
            measured.extend(reference.done.into_iter().flatten());
            self.spare.put(reference.prepared);
        }
    }

    /// Measures the motion of one body from a frame; `None` if more of the target has to be prepared first.
    pub(super) fn measure_body(
        &mut self,
        reference: &PendingFrame,
        slot: usize,
        target: Option<Target<'_>>,
    ) -> Option<Measured> {
        let intervals = self.params.intervals_frames.len();
        let (body, interval_index) = (slot / intervals, slot % intervals);
        let key = BodyKey { body, block: reference.block };
        let step = reference.outline_step(body, self.params.intervals_frames[interval_index]);
        let target = target.filter(|_| self.outlines_only(key).is_none());
        let (Ok(outline), Some(target)) = (reference.outlines[body].outline, target) else {
            return Some(Measured { step, field: None, is_matched: false });
        };
        // Longer intervals start from the frame's own shortest step, whatever was measured since.
        let own = reference.done[slot - interval_index].as_ref().and_then(|shortest| shortest.step.motion);
        let known = if interval_index == 0 { self.states.state_mut(key).motion } else { own };
        let mut measured = self.match_textures(Span { body, reference, target }, &outline, step, known)?;
        if interval_index == 0 {
            let step = &mut measured.step;
            let state = self.states.state_mut(key);
            (state.motion, state.center_motion) = (step.motion, step.center_motion());
            step.fixed_fraction =
                step.motion.and_then(|_| self.fixed_patterns.bias_fraction(body, reference, &outline));
        }
        Some(measured)
    }
}
