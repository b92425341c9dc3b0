//! Blocks of frames to steps and fields.

use super::confirm;
use super::error::MeasureError;
use super::field::{center_step, drift, first_look, rigid_step, start, swollen};
use super::known::Memory;
use super::outline::{Finder, Outline};
use super::params::{MeasureParams, Share};
use super::part::Part;
use super::pattern::Patterns;
use super::picture::Picture;
use super::reference::Reference;
use super::target::Target;
use super::turn::Turns;
use super::whole::{WholeStep, Wholes, is_hidden};
use crate::dic::{Correlator, Prepared, Start};
use crate::image::{Frame, FrameMeta, Image};
use crate::motion::Rotation;
use crate::results::{BodyStep, Estimate, PairField, PointStatus, RigidStep};
use std::collections::VecDeque;

/// One body in one frame: its step and the field the step came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The body, its outline and its motion.
    pub step: BodyStep,
    /// The displacement field behind the motion.
    pub field: Option<PairField>,
    /// Whether a match of the whole body speaks for the motion.
    pub(super) is_matched: bool,
}

/// Measures blocks of frames.
///
/// The step of a frame is a function of the frames of its own block up to
/// the longest interval after it, and of nothing else: not of frames before the
/// block, not of who else measures, not of when. At the start of a block every
/// body is looked for from scratch; within it each frame starts from the last.
pub struct Measurer {
    pub(super) correlator: Correlator,
    pub(super) finders: Vec<Finder>,
    pub(super) params: MeasureParams,
    pub(super) share: Share,
    pub(super) size: (usize, usize),
    pub(super) picture: Picture,
    /// Frames whose motion is not measured yet, oldest first.
    open: VecDeque<Reference>,
    pub(super) spare: Vec<Prepared>,
    pub(super) known: Memory,
    pub(super) wholes: Wholes,
    turns: Turns,
    patterns: Patterns,
}

impl Measurer {
    /// Plans the measurement of frames of this size.
    ///
    /// # Errors
    ///
    /// When a setting is out of range or cannot be measured with.
    pub fn new(params: &MeasureParams, share: Share, width_px: usize, height_px: usize) -> Result<Self, MeasureError> {
        let finders =
            params.bodies.iter().map(|body| Finder::new(body, width_px, height_px)).collect::<Result<_, _>>()?;
        Ok(Self {
            correlator: Correlator::new(&params.correlation, width_px, height_px)?,
            finders,
            share,
            size: (width_px, height_px),
            picture: Picture::new(width_px, height_px, params.correction(width_px, height_px)?),
            open: VecDeque::new(),
            spare: Vec::new(),
            known: Memory::default(),
            wholes: Wholes::default(),
            turns: Turns::default(),
            patterns: Patterns::new(params),
            params: params.clone(),
        })
    }

    /// Whether a picture is needed in which patches were drawn.
    pub fn needs_reference(&self) -> bool {
        self.finders.iter().any(|finder| matches!(finder, Finder::Patch(_)))
    }

    /// Takes the picture in which patches were drawn, the stream's first; without one they are lost.
    ///
    /// # Errors
    ///
    /// When it is of another size than planned.
    pub fn set_reference(&mut self, picture: &Image) -> Result<(), MeasureError> {
        let view = picture.view();
        let (width, height) = (view.width(), view.height());
        if (width, height) != self.size {
            let (expected_width_px, expected_height_px) = self.size;
            let (width_px, height_px) = (width as u32, height as u32);
            return Err(MeasureError::Size { sequence: 0, width_px, height_px, expected_width_px, expected_height_px });
        }
        let mut light = picture.clone();
        self.picture.correct(&mut light);
        let mut prepared = self.spare.pop().unwrap_or_default();
        self.correlator.prepare_part_into(light.view(), [0, 0, width as u32, height as u32], &mut prepared);
        for finder in &mut self.finders {
            if let Finder::Patch(finder) = finder {
                finder.set_reference(&prepared);
            }
        }
        self.spare.push(prepared);
        Ok(())
    }

    /// Forgets every frame, for another stream.
    pub fn reset(&mut self) {
        self.spare.extend(self.open.drain(..).map(|reference| reference.prepared));
        self.known.clear();
        self.wholes.clear();
        self.patterns.clear();
    }

    /// Whether a frame is needed here at all: it belongs to a block of this share, or is a target of one.
    pub fn wants(&self, sequence: u64) -> bool {
        let block_frames = u64::from(self.params.block_frames);
        let owns = |sequence: u64| self.share.holds(sequence / block_frames);
        let is_target_over = |interval: &u32| sequence.checked_sub(u64::from(*interval)).is_some_and(owns);
        owns(sequence) || self.params.intervals_frames.iter().any(is_target_over)
    }

    /// Takes the next frame of the stream; appends what became known, in order.
    ///
    /// Frames come with rising sequence numbers; those it does not want may be left out.
    ///
    /// # Errors
    ///
    /// When the frame is not what its header says, or of another size than planned.
    pub fn push(&mut self, frame: &Frame<'_>, measured: &mut Vec<Measured>) -> Result<(), MeasureError> {
        let meta = frame.meta;
        if !self.wants(meta.sequence) {
            return Ok(());
        }
        self.check_size(&meta)?;
        frame.check().map_err(|source| MeasureError::Frame { sequence: meta.sequence, source })?;
        self.picture.begin();
        let block = meta.sequence / u64::from(self.params.block_frames);
        let own = self.measure_open(frame, block);
        if self.share.holds(block) {
            self.open_reference(frame, block, own);
            self.confirm();
        } else {
            self.spare.extend(own.map(|(prepared, _)| prepared));
        }
        self.give_out(measured);
        Ok(())
    }

    /// Measures what leads to the frame at hand; gives the frame as it was made ready for `block`, and the part that was.
    ///
    /// Every block has the frame made ready for itself, where its own frames say that the bodies are: what is measured
    /// in one block depends on no other.
    fn measure_open(&mut self, frame: &Frame<'_>, block: u64) -> Option<(Prepared, Part)> {
        let mut open = std::mem::take(&mut self.open);
        let mut own = None;
        let mut first = 0;
        while let Some(of) = open.get(first).map(|reference| reference.block) {
            let last = open.partition_point(|reference| reference.block <= of);
            let sequence = frame.meta.sequence;
            let mut prepared = self.spare.pop().unwrap_or_default();
            let narrow = self.known.narrow_part(of, sequence, &self.params.correlation, &self.wholes);
            let mut part = narrow.unwrap_or_else(|| self.known.part(of, sequence, &self.params.correlation));
            self.prepare(frame, part, &mut prepared);
            let mut is_narrow = narrow.is_some();
            for reference in open.range_mut(first..last) {
                if !self.measure(reference, Some(Target { sequence, prepared: &prepared, is_narrow })) {
                    (part, is_narrow) = (self.known.part(of, sequence, &self.params.correlation), false);
                    self.prepare(frame, part, &mut prepared);
                    self.measure(reference, Some(Target { sequence, prepared: &prepared, is_narrow }));
                }
            }
            match of == block {
                true => own = Some((prepared, part)),
                false => self.spare.push(prepared),
            }
            first = last;
        }
        self.open = open;
        own
    }

    /// Makes a part of the frame at hand ready.
    fn prepare(&mut self, frame: &Frame<'_>, part: Part, prepared: &mut Prepared) {
        let view = self.picture.part(frame, part.rectangle());
        self.correlator.prepare_part_into(view, part.rectangle(), prepared);
    }

    /// Finds the bodies in the frame at hand, and keeps it until its targets have come.
    fn open_reference(&mut self, frame: &Frame<'_>, block: u64, own: Option<(Prepared, Part)>) {
        let meta = frame.meta;
        let (outlines, sources): (Vec<_>, Vec<_>) =
            (0..self.finders.len()).map(|body| self.find(body, frame, block)).unzip();
        let mut needed = Part::default();
        let subset_px = self.params.correlation.subset_size_px;
        outlines.iter().flatten().for_each(|outline| needed.add(&outline.around(subset_px), 0.0));
        let (mut prepared, part) = own.unwrap_or_else(|| (self.spare.pop().unwrap_or_default(), Part::default()));
        if part.is_empty() || !part.holds(&needed) {
            self.prepare(frame, needed, &mut prepared);
        }
        let oldest = self.open.front().map_or(block, |reference| reference.block);
        self.known.forget_before(oldest);
        self.wholes.forget_before(oldest);
        self.patterns.forget_before(oldest);
        self.finders.iter_mut().for_each(|finder| finder.forget_before(oldest));
        for (body, outline) in outlines.iter().enumerate() {
            // What hides a ball from its subsets is seen by a match of the whole of it, whatever tells its motion.
            if let Ok(Outline::Ball(circle)) = outline
                && (self.params.rotation == Rotation::Rigid || is_hidden(circle))
            {
                self.wholes.begin((body, block), meta.sequence, &prepared, circle);
            }
        }
        let slots = self.finders.len() * self.params.intervals_frames.len();
        let (done, before) = (vec![None; slots], vec![None; slots]);
        self.open.push_back(Reference { meta, block, prepared, outlines, sources, done, before });
    }

    /// Holds the motions to the newest frame against what was seen there; withdraws those that cannot be.
    fn confirm(&mut self) {
        let Some(target) = self.open.pop_back() else { return };
        let intervals = self.params.intervals_frames.len();
        let mut open = std::mem::take(&mut self.open);
        for reference in open.iter_mut().filter(|reference| reference.block == target.block) {
            self.try_again(reference, &target);
            let frames = target.meta.sequence - reference.meta.sequence;
            for slot in 0..reference.done.len() {
                let (body, place) = (slot / intervals, slot % intervals);
                let seen = reference.leads_to(&target, body);
                let Some(measured) = reference.done[slot].as_mut().filter(|_| self.params.is_interval(place, frames))
                else {
                    continue;
                };
                let outlines = (&reference.outlines[body], &target.outlines[body]);
                if confirm::holds(measured, reference.before[slot].as_ref(), outlines, seen) {
                    continue;
                }
                measured.step = BodyStep { status: PointStatus::Ambiguous, ..measured.step.without_motion() };
                if place == 0 {
                    self.confuse(body, target.block);
                }
            }
        }
        self.open = open;
        self.open.push_back(target);
    }

    /// Measures balls that turned too far to be matched, now that they were seen in the newest frame.
    fn try_again(&mut self, reference: &mut Reference, target: &Reference) {
        let intervals = self.params.intervals_frames.len();
        let frames = target.meta.sequence - reference.meta.sequence;
        for body in 0..self.finders.len() {
            let slot = body * intervals;
            let seen = reference.leads_to(target, body) && self.params.is_interval(0, frames);
            let is_lost = |measured: &Measured| measured.step.step.is_none() && measured.field.is_some();
            if !seen || !reference.done[slot].as_ref().is_some_and(is_lost) {
                continue;
            }
            let (Ok(Outline::Ball(from)), Ok(Outline::Ball(to))) = (&reference.outlines[body], &target.outlines[body])
            else {
                continue;
            };
            let pair = (&reference.prepared, &target.prepared);
            let Some(rate) = self.turns.between(from, to, pair, frames as f64) else { continue };
            let known = self.known.of(body, reference.block);
            (known.motion, known.center) = (Some(rate), Some(rate));
            let whole = Target { sequence: target.meta.sequence, prepared: &target.prepared, is_narrow: false };
            let again = self.measure_body(reference, slot, Some(whole));
            if again.as_ref().is_some_and(|again| again.step.step.is_some()) {
                reference.done[slot] = again;
            }
        }
    }

    /// Follows a body no more within a block: something else may be taken for it.
    fn confuse(&mut self, body: usize, block: u64) {
        self.wholes.forget(body, block);
        let known = self.known.of(body, block);
        (known.motion, known.confused) = (None, true);
    }

    /// The stream is over: tells the frames that have no target.
    pub fn finish(&mut self, measured: &mut Vec<Measured>) {
        let mut open = std::mem::take(&mut self.open);
        for reference in &mut open {
            self.measure(reference, None);
        }
        self.open = open;
        self.give_out(measured);
        self.known.clear();
    }

    fn check_size(&self, meta: &FrameMeta) -> Result<(), MeasureError> {
        let (expected_width_px, expected_height_px) = self.size;
        if (meta.width_px as usize, meta.height_px as usize) == self.size {
            return Ok(());
        }
        let FrameMeta { sequence, width_px, height_px, .. } = *meta;
        Err(MeasureError::Size { sequence, width_px, height_px, expected_width_px, expected_height_px })
    }

    /// Measures what leads to this target, and what led to targets that did not come; everything with no target.
    ///
    /// Gives false when more of the target is needed to go on.
    fn measure(&mut self, reference: &mut Reference, target: Option<Target<'_>>) -> bool {
        for slot in 0..reference.done.len() {
            let due = reference.meta.sequence
                + u64::from(self.params.intervals_frames[slot % self.params.intervals_frames.len()]);
            let is_due = target.is_none_or(|target| target.sequence >= due);
            if reference.done[slot].is_none() && is_due {
                let target = target.filter(|target| target.sequence == due);
                let before = self.known.of(slot / self.params.intervals_frames.len(), reference.block).motion;
                let Some(measured) = self.measure_body(reference, slot, target) else { return false };
                reference.before[slot] = before;
                reference.done[slot] = Some(measured);
            }
        }
        true
    }

    /// The frames that are measured with all their targets, oldest first.
    fn give_out(&mut self, measured: &mut Vec<Measured>) {
        while self.open.front().is_some_and(|reference| reference.done.iter().all(Option::is_some)) {
            let Some(reference) = self.open.pop_front() else { return };
            measured.extend(reference.done.into_iter().flatten());
            self.spare.push(reference.prepared);
        }
    }

    /// The motion of one body from a frame; `None` when more of the target is needed to tell it.
    fn measure_body(&mut self, reference: &Reference, slot: usize, target: Option<Target<'_>>) -> Option<Measured> {
        let intervals = self.params.intervals_frames.len();
        let (body, place) = (slot / intervals, slot % intervals);
        let outline = reference.outlines[body];
        let mut step = reference.untold(body, self.params.intervals_frames[place]);
        let Ok(outline) = outline else { return Some(Measured { step, field: None, is_matched: false }) };
        outline.tell(&mut step);
        let Some(target) = target else { return Some(Measured { step, field: None, is_matched: false }) };
        let Target { sequence: target_frame, prepared, is_narrow } = target;
        let mut field =
            PairField { frame: step.frame, target_frame, stamp_ns: step.stamp_ns, body: step.body, points: Vec::new() };
        let frames = f64::from(step.interval_frames);
        // Longer ones start from the frame's own shortest step, whatever was measured since.
        let own = reference.done[slot - place].as_ref().and_then(|shortest| shortest.step.step);
        let known = if place == 0 { self.known.of(body, reference.block).motion } else { own };
        if is_narrow && known.is_none() {
            return None;
        }
        let span = (reference, target, body);
        let points = self.finders[body].points(&outline, &self.params.correlation, self.size);
        self.correlator.set_region(self.finders[body].region(&outline, &self.params.correlation));
        let mut whole = known
            .or_else(|| first_look(&mut self.correlator, &self.params, (reference, &target), &outline, &points))
            .and_then(|rate| self.whole_step(span, &outline, &rate));
        let known = whole.map(|whole| whole.step).or(known);
        let start = known.map_or(Start::Search, |step| start(&step, outline.center_px(), frames));
        self.correlator.correlate(&reference.prepared, prepared, &points, start, &mut field.points);
        if is_narrow && (whole.is_none() || self.correlator.has_searched()) {
            return None;
        }
        self.leave_out(span, &mut field);
        let mut moved = self.by_subsets((reference, target), &outline, &mut field, &mut step, start);
        if let (None, Some(rate)) = (whole, step.step) {
            whole = self.whole_step(span, &outline, &rate);
            // What hides it is known now.
            if self.leave_out(span, &mut field) {
                moved = self.by_subsets((reference, target), &outline, &mut field, &mut step, start);
            }
        }
        if let Outline::Patch(_) = outline {
            // Subsets follow whatever is before the patch; where they led astray, it may be where it was.
            whole = whole.or_else(|| self.whole_step(span, &outline, &RigidStep::STILL));
            step.step = None;
        }
        let whole = whole.filter(|whole| {
            let agrees = step.step.is_none_or(|field| confirm::agree(&whole.step, &field, step.drift));
            // A pattern that moves over the body is not that of its reference for long.
            if !agrees || step.drifts() {
                self.wholes.forget(body, reference.block);
            }
            agrees
        });
        let is_told = self.params.rotation == Rotation::Rigid || matches!(outline, Outline::Patch(_));
        if let Some(whole) = whole.as_ref().filter(|_| is_told && !step.drifts()) {
            whole.tell(&mut step);
        }
        drift(&mut step, moved);
        if step.step.is_none() {
            step.status = confirm::why_not(&field);
        }
        if place == 0 {
            let known = self.known.of(body, reference.block);
            (known.motion, known.center) = (step.step, step.center_step());
            step.fixed_fraction = step.step.and_then(|_| self.patterns.share((body, reference), &outline));
        }
        Some(Measured { step, field: Some(field), is_matched: whole.is_some() })
    }

    /// Leaves out the subsets that show what hides a body, where a match of the whole of it tells; tells whether there are any.
    fn leave_out(&self, (reference, target, body): (&Reference, Target<'_>, usize), field: &mut PairField) -> bool {
        let subset_px = self.params.correlation.subset_size_px;
        let frames = (reference.meta.sequence, target.sequence);
        self.wholes.leave_out((body, reference.block), frames, &mut field.points, subset_px)
    }

    /// Tells the step that subsets show, and gives the motion of a ball that turns about any axis.
    fn by_subsets(
        &mut self,
        (reference, target): (&Reference, Target<'_>),
        outline: &Outline,
        field: &mut PairField,
        step: &mut BodyStep,
        start: Start,
    ) -> Option<[Estimate; 3]> {
        let (frames, correlation) = (f64::from(step.interval_frames), &self.params.correlation);
        step.step = rigid_step(field, outline.center_px(), frames, correlation.subset_size_px, start);
        let moved = swollen(field, step, outline, correlation.subset_size_px);
        if let (Rotation::Center, Some(_)) = (self.params.rotation, &step.circle) {
            step.step = step.step.and_then(|_| center_step(field, outline.center_px(), frames, correlation));
        }
        if let (Rotation::Ring(limits), Some(found), Some(circle)) =
            (self.params.rotation, &mut step.step, &step.circle)
        {
            self.turns.replace(found, circle, (&reference.prepared, target.prepared), limits, frames);
        }
        drift(step, moved);
        moved
    }

    /// The motion of the whole body, near a rate a frame.
    fn whole_step(
        &mut self,
        (reference, target, body): (&Reference, Target<'_>, usize),
        outline: &Outline,
        rate: &RigidStep,
    ) -> Option<WholeStep> {
        let frames = (target.sequence - reference.meta.sequence) as f64;
        match (outline, &mut self.finders[body]) {
            (Outline::Ball(circle), _) => {
                let (sequence, prepared) = (reference.meta.sequence, &reference.prepared);
                let from = Target { sequence, prepared, is_narrow: false };
                self.wholes.step((body, reference.block), from, target, circle, rate)
            }
            (Outline::Patch(pose), Finder::Patch(finder)) => {
                let found = finder
                    .follow((reference.block, target.sequence), target.prepared, &pose.moved(rate, frames))
                    .ok()?;
                Some(WholeStep { step: pose.step_to(&found, frames), visible_fraction: None, lever: None })
            }
            _ => None,
        }
    }
}
