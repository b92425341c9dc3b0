//! Sightings of a body: runs of frames in which it was found, however short.
//!
//! Whatever looks like a body for a moment is found in a few frames and then lost again: a mirror image, a part of the
//! background, the edge of a shadow.

use crate::results::{BodyStep, MotionMethod, PointStatus};

/// The number of frames in which a body must be found before it is lost again.
const MIN_FRAMES: u32 = 6;
/// The number of frames without an outline that do not end a run, since frames may be missing.
const MAX_GAP_FRAMES: u64 = 2;
/// The maximum number of runs kept.
const MAX_RUNS: usize = 64;

/// A run of frames in which a body had an outline, or another object was in its place.
#[derive(Debug, Clone, Copy)]
struct Run {
    first: u64,
    last: u64,
    /// The number of frames in which the outline was detected.
    detected: u32,
    /// Whether its texture was matched between two of the frames.
    is_matched: bool,
    /// Whether the body was lost in the frame before.
    follows_loss: bool,
}

/// The latest runs of frames in which a body was found, oldest first.
#[derive(Debug, Clone, Default)]
pub struct Sightings {
    runs: Vec<Run>,
    newest: Option<u64>,
}

impl Sightings {
    /// Adds the next step in frame order.
    pub fn push(&mut self, step: &BodyStep) {
        let is_first = self.newest.replace(step.frame).is_none();
        if step.outline.is_none() && step.status != PointStatus::Ambiguous {
            return;
        }
        let is_matched = step.motion.is_some() && step.method != MotionMethod::Outlines;
        let detected = u32::from(step.is_detected());
        match self.runs.last_mut().filter(|run| run.last + 1 + MAX_GAP_FRAMES >= step.frame) {
            Some(run) => {
                run.last = step.frame;
                run.detected = run.detected.saturating_add(detected);
                run.is_matched |= is_matched;
            }
            None => {
                if self.runs.len() == MAX_RUNS {
                    self.runs.remove(0);
                }
                let (first, last) = (step.frame, step.frame);
                self.runs.push(Run { first, last, detected, is_matched, follows_loss: !is_first });
            }
        }
    }

    /// Returns the status of a row: lost, if the body was found near its frame in too few frames to be known.
    pub fn status(&self, step: &BodyStep) -> PointStatus {
        let mut runs = self.runs.iter().filter(|run| (run.first..=run.last).contains(&step.frame));
        let is_brief = |run: &Run| run.follows_loss && !run.is_matched && run.detected < MIN_FRAMES;
        if runs.next().is_some_and(is_brief) { PointStatus::Lost } else { step.status }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Circle, RigidStep};

    fn step(frame: u64, is_found: bool, method: MotionMethod) -> BodyStep {
        let circle = Circle {
            x_px: 60.0,
            y_px: 90.0,
            radius_px: 14.0,
            sigma_center_px: 0.1,
            sigma_radius_px: 0.1,
            visible_fraction: 1.0,
        };
        let status = if is_found { PointStatus::Valid } else { PointStatus::Lost };
        let outline = is_found.then(|| circle.into());
        BodyStep { frame, outline, motion: is_found.then_some(RigidStep::STILL), method, status, ..BodyStep::default() }
    }

    /// Counts the valid rows of a film; `#` is a frame in which the body is found.
    fn valid(film: &str, method: MotionMethod) -> usize {
        let steps: Vec<BodyStep> =
            (0..).zip(film.chars()).map(|(frame, mark)| step(frame, mark == '#', method)).collect();
        let mut sightings = Sightings::default();
        steps.iter().for_each(|step| sightings.push(step));
        steps.iter().filter(|step| sightings.status(step) == PointStatus::Valid).count()
    }

    #[test]
    fn a_body_that_is_found_for_a_moment_is_lost() {
        let by_outline = |film: &str| valid(film, MotionMethod::Outlines);
        assert_eq!(by_outline("....##.....###....#####...##"), 0);
        assert_eq!(by_outline("....######...."), 6);
        assert_eq!(by_outline("....####.####...."), 8, "a frame is missing");
        assert_eq!(by_outline("###......"), 3, "it may have been there before the film");
        assert_eq!(valid("....##....", MotionMethod::WholeBody), 2, "its texture was matched");
    }
}
