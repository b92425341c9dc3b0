//! The search of balls that were lost in a block, once its background is known.

use super::bounding_box::BoundingBox;
use super::consistency::{self, OutlinePair};
use super::measurer::Measurer;
use super::outline::{Finder, Outline};
use super::pending_frame::{BodyKey, FoundOutline, Measured, PendingFrame, Target};
use super::surface::Surface;
use crate::image::Frame;
use crate::numeric::median;
use crate::results::{BodyStep, Circle, OutlineOrigin, PointStatus};

/// The minimum number of frames of a block in which a ball stands out from the background.
const MIN_FOUND: usize = 3;
/// The maximum deviation of their radii from the median, as a fraction of it, and in standard uncertainties.
const SAME_RADIUS: [f64; 2] = [0.1, 5.0];
/// The number of backgrounds that are tried.
const BACKGROUNDS: usize = 3;
/// The minimum distance of a ball in two frames of the background, in radii.
const SEPARATION: f64 = 2.1;
/// The maximum distance of a frame of the background from one in which the ball was found, frames.
const MAX_DISTANCE_FRAMES: u64 = 4;

/// A ball that stands out from the background in a frame.
#[derive(Debug, Clone, Copy)]
struct FoundBall {
    sequence: u64,
    circle: Circle,
}

/// Whether a ball left its place between the three frames of a background, so that it is not a part of it.
///
/// A ball that covers a pixel in two of them would leave its own image in the background.
fn is_sound(sources: &[u64; 3], found: &[FoundBall]) -> bool {
    let place = |source: &u64| {
        let nearest = found.iter().min_by_key(|ball| ball.sequence.abs_diff(*source))?;
        (nearest.sequence.abs_diff(*source) <= MAX_DISTANCE_FRAMES).then_some(nearest.circle)
    };
    let places: Vec<Circle> = sources.iter().filter_map(place).collect();
    (0..places.len()).all(|a| (0..a).all(|b| distance_px(&places[a], &places[b]) > SEPARATION * places[a].radius_px))
}

/// Removes the circles that no ball can reach from those before and after, the farthest first.
fn keep_track(found: &mut Vec<FoundBall>) {
    while found.len() >= MIN_FOUND {
        let excess = (0..found.len()).map(|index| excess_px(found, index));
        let Some((worst, excess)) = excess.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)) else { return };
        if excess <= 0.0 {
            return;
        }
        found.remove(worst);
    }
}

/// Returns the distance of a circle from the line through its two neighbours, px, beyond what a bounce explains.
///
/// A bounce changes the displacement from frame to frame by at most twice its length.
fn excess_px(found: &[FoundBall], index: usize) -> f64 {
    let last = found.len() - 1;
    let [a, b] = if index == 0 {
        [1, 2]
    } else if index == last {
        [last - 2, last - 1]
    } else {
        [index - 1, index + 1]
    };
    let [at, a, b] = [index, a, b].map(|index| found[index]);
    let frames = |from: FoundBall, to: FoundBall| to.sequence as f64 - from.sequence as f64;
    let step = [(b.circle.x_px - a.circle.x_px), (b.circle.y_px - a.circle.y_px)].map(|moved| moved / frames(a, b));
    let since = frames(a, at);
    let apart =
        (at.circle.x_px - a.circle.x_px - since * step[0]).hypot(at.circle.y_px - a.circle.y_px - since * step[1]);
    let distance = frames(a, at).abs().min(frames(b, at).abs());
    apart - at.circle.radius_px - 2.0 * distance * step[0].hypot(step[1])
}

/// Returns the three kept frames in which a ball is farthest apart, by their place among the kept ones.
fn farthest_apart(found: &[FoundBall], sequences: &[u64]) -> Option<[usize; 3]> {
    let (mut best, mut frames) = (0.0, None);
    for (k, c) in found.iter().enumerate() {
        for (j, b) in found[..k].iter().enumerate() {
            for a in &found[..j] {
                let [ab, ac, bc] = [(a, b), (a, c), (b, c)].map(|(a, b)| distance_px(&a.circle, &b.circle));
                if ab.min(ac).min(bc) > best {
                    (best, frames) = (ab.min(ac).min(bc), Some([a, b, c]));
                }
            }
        }
    }
    let [a, b, c] = frames?.map(|ball| sequences.iter().position(|sequence| *sequence == ball.sequence));
    Some([a?, b?, c?])
}

fn distance_px(a: &Circle, b: &Circle) -> f64 {
    (a.x_px - b.x_px).hypot(a.y_px - b.y_px)
}

impl Measurer {
    /// Keeps a frame in which a ball was not detected, until the background of its block is known.
    pub(super) fn keep_if_lost(&mut self, frame: &Frame<'_>, outlines: &[FoundOutline]) {
        let is_lost = |body: usize| matches!(self.finders[body], Finder::Ball(_)) && outlines[body].is_missing();
        if (0..outlines.len()).any(is_lost) {
            self.background.keep(frame);
        }
    }

    /// Searches the lost balls of a block in the differences from its background, and measures their motion.
    ///
    /// The rows of these frames have waited for it.
    pub(super) fn recover_lost_balls(&mut self, block: u64) {
        let sequences = self.background.kept_sequences();
        self.background.forget();
        for body in 0..self.finders.len() {
            if let Some(found) = self.find_in_block(body, block, &sequences) {
                self.replace_lost(body, &found);
            }
        }
        self.background.release_frames();
    }

    /// Finds a ball in the kept frames of a block by the differences from their background.
    ///
    /// The first background is that of the first, the middle and the last frame. If the ball had not left its place
    /// between them, it is computed again from three frames between which it had. `None` if there are no such frames.
    fn find_in_block(&mut self, body: usize, block: u64, sequences: &[u64]) -> Option<Vec<FoundBall>> {
        if sequences.len() < MIN_FOUND || !matches!(self.finders[body], Finder::Ball(_)) {
            return None;
        }
        let mut frames = [0, sequences.len() / 2, sequences.len() - 1];
        for _ in 0..BACKGROUNDS {
            self.background.compute(block, frames, &self.image);
            let found = self.find_before_background(body, sequences);
            if found.len() < MIN_FOUND {
                break;
            }
            if is_sound(&frames.map(|index| sequences[index]), &found) {
                return Some(found);
            }
            let Some(apart) = farthest_apart(&found, sequences) else { break };
            frames = apart;
        }
        self.background.forget();
        None
    }

    /// Returns the circle of a ball that stands out from the background of a block in the current frame.
    pub(super) fn find_changed(&mut self, body: usize, frame: &Frame<'_>, block: u64) -> Option<Outline> {
        if !self.background.is_known(block) {
            return None;
        }
        let difference = self.background.difference(self.image.unpack_all(frame));
        self.finders[body].find_changed(difference).map(Outline::Ball)
    }

    /// Finds a ball of one size in the kept frames by their differences from the background.
    fn find_before_background(&mut self, body: usize, sequences: &[u64]) -> Vec<FoundBall> {
        let mut found: Vec<FoundBall> = Vec::new();
        for sequence in sequences {
            let Some(kept) = self.background.kept_frame(*sequence, &self.image) else { continue };
            let circle = self.finders[body].find_changed(kept.difference);
            found.extend(circle.map(|circle| FoundBall { sequence: *sequence, circle }));
        }
        let mut radii: Vec<f64> = found.iter().map(|ball| ball.circle.radius_px).collect();
        let middle = median(&mut radii).unwrap_or(0.0);
        found.retain(|FoundBall { circle, .. }| {
            let tolerance_px = (SAME_RADIUS[0] * middle).max(SAME_RADIUS[1] * circle.sigma_radius_px);
            (circle.radius_px - middle).abs() <= tolerance_px
        });
        keep_track(&mut found);
        found
    }

    /// Replaces the lost outlines of a ball, and measures the motions that they allow.
    fn replace_lost(&mut self, body: usize, found: &[FoundBall]) {
        let mut pending = std::mem::take(&mut self.pending);
        for ball in found {
            let Some(frame) = pending.iter_mut().find(|frame| frame.meta.sequence == ball.sequence) else { continue };
            if frame.outlines[body].outline.is_err() || frame.outlines[body].origin == OutlineOrigin::Coasted {
                frame.outlines[body] = FoundOutline::detected(Outline::Ball(ball.circle));
                self.prepare_again(frame);
                self.note_detection(body, frame, ball.circle);
            }
        }
        let frames = pending.make_contiguous();
        let intervals = self.params.intervals_frames.len();
        for index in 0..frames.len() {
            let (before, after) = frames.split_at_mut(index + 1);
            let Some(reference) = before.last_mut() else { continue };
            (body * intervals..(body + 1) * intervals).for_each(|slot| self.measure_again(reference, slot, after));
        }
        self.pending = pending;
    }

    /// Frees the prepared images of frames that only wait for the background of their block.
    ///
    /// Others may still become the reference or the target of a motion that is measured again.
    pub(super) fn release_settled(&mut self) {
        for index in 0..self.pending.len() {
            if !self.may_be_measured_again(&self.pending[index]) {
                self.spare.put(std::mem::take(&mut self.pending[index].prepared));
            }
        }
    }

    /// Whether a motion from a frame or to it is not measured, or was measured without a result.
    fn may_be_measured_again(&self, frame: &PendingFrame) -> bool {
        let intervals = &self.params.intervals_frames;
        let is_missing = |measured: &Option<Measured>| measured.as_ref().is_none_or(|done| done.step.motion.is_none());
        let misses_motion_to = |(index, interval): (usize, &u32)| {
            let sequence = frame.meta.sequence.checked_sub(u64::from(*interval));
            let reference = sequence
                .and_then(|from| self.pending.binary_search_by_key(&from, |pending| pending.meta.sequence).ok())
                .map(|at| &self.pending[at]);
            reference.is_some_and(|from| from.done.iter().skip(index).step_by(intervals.len()).any(is_missing))
        };
        frame.done.iter().any(is_missing) || intervals.iter().enumerate().any(misses_motion_to)
    }

    /// Prepares a kept frame around all its outlines.
    fn prepare_again(&mut self, frame: &mut PendingFrame) {
        let correlation = &self.params.correlation;
        let mut needed = BoundingBox::default();
        for outline in frame.outlines.iter().filter_map(|found| found.outline.ok()) {
            let range_px = f64::from(correlation.search_px);
            needed.include_search(&outline.enclosing_circle(correlation.subset_size_px), range_px);
        }
        if let Some(kept) = self.background.kept_frame(frame.meta.sequence, &self.image) {
            self.correlator.prepare_part_into(kept.image, needed.rectangle(), &mut frame.prepared);
        }
    }

    /// Classifies the surface of a ball that was detected, and stores its outline if it is the newest of its block.
    fn note_detection(&mut self, body: usize, frame: &PendingFrame, circle: Circle) {
        let state = self.states.state_mut(BodyKey { body, block: frame.block });
        if Surface::is_open(state.surface) {
            state.surface = Some(Surface::classify(&frame.prepared, &circle, &mut self.ring_rotation));
        }
        if state.outline.is_none_or(|(sequence, _)| sequence <= frame.meta.sequence) {
            state.outline = Some((frame.meta.sequence, Outline::Ball(circle)));
            state.detected_frame = Some(frame.meta.sequence);
        }
    }

    /// Measures a motion that was measured without a result, now that its outlines are known.
    ///
    /// `after` holds the frames after the reference. The target may not be among them.
    fn measure_again(&mut self, reference: &mut PendingFrame, slot: usize, after: &[PendingFrame]) {
        let intervals = self.params.intervals_frames.len();
        let (body, interval) = (slot / intervals, u64::from(self.params.intervals_frames[slot % intervals]));
        let is_missing = reference.done[slot].as_ref().is_some_and(|measured| measured.step.motion.is_none());
        if !is_missing || reference.outlines[body].outline.is_err() {
            return;
        }
        let due = reference.meta.sequence + interval;
        let target = after.iter().find(|target| target.meta.sequence == due && target.block == reference.block);
        // The newest motion of the block may be that of a later frame.
        let state = self.states.state_mut(BodyKey { body, block: reference.block });
        (state.motion, state.center_motion) = (None, None);
        let prepared = target.map(|target| Target { sequence: due, prepared: &target.prepared, is_narrow: false });
        let Some(measured) = self.measure_body(reference, slot, prepared) else { return };
        reference.done[slot] = Some(measured);
        let Some(target) = target else { return };
        self.check_motion(reference, slot, target);
        if slot.is_multiple_of(intervals)
            && reference.done[slot].as_ref().is_some_and(|done| done.step.motion.is_none())
        {
            self.move_by_outlines(reference, body, target.outlines[body]);
        }
    }

    /// Removes a motion that contradicts the outlines of its two frames.
    fn check_motion(&mut self, reference: &mut PendingFrame, slot: usize, target: &PendingFrame) {
        let body = slot / self.params.intervals_frames.len();
        let outlines = OutlinePair {
            reference: &reference.outlines[body].outline,
            target: &target.outlines[body].outline,
            are_detected: reference.is_comparable(target, body),
        };
        if let Some(measured) = &mut reference.done[slot]
            && !consistency::is_consistent(measured, None, outlines)
        {
            measured.step = BodyStep { status: PointStatus::LowCorrelation, ..measured.step.without_motion() };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(sequence: u64, x_px: f64, y_px: f64) -> FoundBall {
        let (radius_px, sigma) = (6.0, 0.1);
        let circle =
            Circle { x_px, y_px, radius_px, sigma_center_px: sigma, sigma_radius_px: sigma, visible_fraction: 1.0 };
        FoundBall { sequence, circle }
    }

    /// A ball that falls by 4 px a frame and bounces in frame 8.
    fn bounce() -> Vec<FoundBall> {
        (0..16_u32).map(|k| ball(k.into(), 50.0 + 0.5 * f64::from(k), 100.0 - 4.0 * f64::from(k.abs_diff(8)))).collect()
    }

    #[test]
    fn a_bounce_is_one_track_and_another_object_is_not_part_of_it() {
        let mut found = bounce();
        keep_track(&mut found);
        assert_eq!(found.len(), 16);
        for wrong in [0, 3, 8, 15] {
            let mut found = bounce();
            found[wrong] = ball(wrong as u64, 140.0, 20.0);
            keep_track(&mut found);
            assert!(found.len() >= 14 && found.iter().all(|ball| ball.circle.x_px < 60.0), "{wrong}: {found:?}");
        }
    }

    #[test]
    fn a_background_is_sound_only_if_the_ball_left_its_place() {
        let found = bounce();
        assert!(is_sound(&[0, 4, 8], &found));
        // The ball passes the same place on its way up.
        assert!(!is_sound(&[0, 8, 15], &found));
        let sequences: Vec<u64> = (0..16).collect();
        let frames = farthest_apart(&found, &sequences).unwrap();
        assert!(is_sound(&frames.map(|index| sequences[index]), &found), "{frames:?}");
        let still: Vec<FoundBall> = (0..16).map(|k| ball(k, 50.0, 60.0)).collect();
        assert!(!is_sound(&[0, 8, 15], &still));
    }
}
