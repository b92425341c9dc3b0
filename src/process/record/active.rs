//! A shot under way.

use super::SILENCE;
use super::feed::Feed;
use super::matching::Matcher;
use crate::process::clock::Patience;
use crate::process::shot::Shot;
use crate::recording::RecordingError;
use crate::results::{BodyStep, PairField};

/// Which moments belong to a shot, ns since the Unix epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    pub(super) from_ns: u64,
    pub(super) to_ns: u64,
}

impl Window {
    /// A whole stream.
    pub(super) const ALL: Self = Self { from_ns: 0, to_ns: u64::MAX };
}

/// How far one camera has come.
pub(super) struct Course {
    /// One past its last frame, once that is known.
    pub(super) end: Option<u64>,
    /// Since when no step has come; of a camera beside the first, no frame either.
    pub(super) silence: Patience,
    /// No more frames will come.
    pub(super) drained: bool,
    /// Which of its line's shots this is, once a frame of it came.
    pub(super) shot: Option<u32>,
    /// Steps near the end, until it is known which lead out of the shot.
    waiting: Vec<(BodyStep, Option<PairField>)>,
}

/// A shot under way.
pub(super) struct Active {
    pub(super) shot: Shot,
    pub(super) window: Window,
    /// One a camera.
    pub(super) courses: Vec<Course>,
    /// One a camera beside the first.
    pub(super) matchers: Vec<Matcher>,
}

impl Active {
    pub(super) fn new(shot: Shot, window: Window, feeds: &[Feed<'_>]) -> Self {
        let course = |_: &Feed<'_>| Course {
            end: None,
            silence: Patience::new(SILENCE),
            drained: false,
            shot: None,
            waiting: Vec::new(),
        };
        let period_ns = feeds.first().map_or(0.0, Feed::period_ns);
        Self {
            shot,
            window,
            courses: feeds.iter().map(course).collect(),
            matchers: feeds.iter().skip(1).map(|_| Matcher::new((0.5 * period_ns) as u64)).collect(),
        }
    }

    /// Takes note of a frame that was written.
    pub(super) fn wrote(&mut self, camera: usize, stamp_ns: u64) {
        match camera.checked_sub(1) {
            None => self.matchers.iter_mut().for_each(|matcher| matcher.first(stamp_ns)),
            Some(view) => {
                self.matchers[view].other(stamp_ns);
                self.courses[camera].silence.renew();
            }
        }
    }

    /// Says where a camera's part ends, and lets the steps go that waited for it.
    pub(super) fn set_end(&mut self, camera: usize, end: u64) -> Result<(), RecordingError> {
        self.courses[camera].end = Some(end);
        self.shot.set_end(camera, end);
        for (step, field) in std::mem::take(&mut self.courses[camera].waiting) {
            self.shot.step(camera, step, field)?;
        }
        Ok(())
    }

    /// Takes a step, or keeps it until it is known whether it leads out of the shot; whether it belongs to it.
    pub(super) fn step(
        &mut self,
        feed: (usize, f64),
        step: BodyStep,
        field: Option<PairField>,
    ) -> Result<bool, RecordingError> {
        let (camera, period_ns) = feed;
        let ahead_ns = (period_ns * f64::from(step.interval_frames + 2)).ceil() as u64;
        let may_lead_out = step.stamp_ns.saturating_add(ahead_ns) > self.window.to_ns;
        if self.courses[camera].end.is_none() && may_lead_out {
            self.courses[camera].waiting.push((step, field));
            return Ok(true);
        }
        self.shot.step(camera, step, field)
    }

    /// Whether everything of a camera is there, or will never be.
    pub(super) fn is_complete(&self, camera: usize, feed: &Feed<'_>) -> bool {
        let course = &self.courses[camera];
        let Some(end) = course.end else { return false };
        let passed = feed.held.front().is_some_and(|sample| sample.header().sequence >= end);
        let whole = self.shot.next_frame(camera) >= end || passed || course.drained;
        whole && (self.shot.has_steps_before(camera, end) || course.silence.is_over())
    }

    /// Where each camera's part ends.
    pub(super) fn ends(&self) -> Vec<u64> {
        let end = |(camera, course): (usize, &Course)| course.end.unwrap_or(self.shot.next_frame(camera));
        self.courses.iter().enumerate().map(end).collect()
    }
}
