//! A shot that is being written.

use super::SILENCE;
use super::camera_feed::CameraFeed;
use super::frame_matching::Matcher;
use crate::image::Frame;
use crate::process::clock::Timeout;
use crate::process::shot::Shot;
use crate::recording::RecordingError;
use crate::results::{BodyStep, PairField};

/// The time window of a shot, ns since the Unix epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ShotWindow {
    pub(super) from_ns: u64,
    pub(super) to_ns: u64,
}

impl ShotWindow {
    /// A whole stream.
    pub(super) const ALL: Self = Self { from_ns: 0, to_ns: u64::MAX };
}

/// The progress of one camera in a shot.
pub(super) struct CameraProgress {
    /// One past its last frame, once known.
    pub(super) end: Option<u64>,
    /// Time without a step, or for further cameras without a frame.
    pub(super) silence: Timeout,
    /// Whether no more frames will come.
    pub(super) drained: bool,
    /// The number of its hardware-triggered shot, once a frame of it came.
    pub(super) shot: Option<u32>,
    /// Steps near the end, until it is known which ones lead out of the shot.
    waiting: Vec<(BodyStep, Option<PairField>)>,
    /// Number of frames at its end that never came.
    missing_at_end: u64,
}

/// A shot that is being written.
pub(super) struct OpenShot {
    pub(super) shot: Shot,
    pub(super) window: ShotWindow,
    /// One per camera.
    pub(super) progress: Vec<CameraProgress>,
    /// One per further camera.
    pub(super) matchers: Vec<Matcher>,
}

impl OpenShot {
    /// Wraps a recording that was just created.
    pub(super) fn new(shot: Shot, window: ShotWindow, feeds: &[CameraFeed<'_>]) -> Self {
        let progress = |_: &CameraFeed<'_>| CameraProgress {
            end: None,
            silence: Timeout::new(SILENCE),
            drained: false,
            shot: None,
            waiting: Vec::new(),
            missing_at_end: 0,
        };
        let period_ns = feeds.first().map_or(0.0, CameraFeed::period_ns);
        Self {
            shot,
            window,
            progress: feeds.iter().map(progress).collect(),
            matchers: feeds.iter().skip(1).map(|_| Matcher::new((0.5 * period_ns) as u64)).collect(),
        }
    }

    /// Writes a frame of a camera and adds its stamp to the matching of the cameras.
    pub(super) fn add_frame(&mut self, camera: usize, frame: &Frame<'_>) -> Result<(), RecordingError> {
        self.shot.write_frame(camera, frame)?;
        let stamp_ns = frame.meta.stamp_ns;
        match camera.checked_sub(1) {
            None => self.matchers.iter_mut().for_each(|matcher| matcher.add_main(stamp_ns)),
            Some(view) => {
                self.matchers[view].add_other(stamp_ns);
                self.progress[camera].silence.renew();
            }
        }
        Ok(())
    }

    /// Sets the end of a camera's part, and writes the steps that waited for it.
    pub(super) fn set_end(&mut self, camera: usize, end: u64) -> Result<(), RecordingError> {
        self.progress[camera].end = Some(end);
        self.shot.set_end(camera, end);
        for (step, field) in std::mem::take(&mut self.progress[camera].waiting) {
            self.shot.write_step(camera, step, field)?;
        }
        Ok(())
    }

    /// Writes a step, or keeps it until it is known whether it leads out of the shot. Returns `false` if it lies
    /// outside the shot; a kept one counts as inside. `period_ns` is the frame period.
    pub(super) fn add_step(
        &mut self,
        camera: usize,
        period_ns: f64,
        step: BodyStep,
        field: Option<PairField>,
    ) -> Result<bool, RecordingError> {
        let ahead_ns = (period_ns * f64::from(step.interval_frames + 2)).ceil() as u64;
        let may_lead_out = step.stamp_ns.saturating_add(ahead_ns) > self.window.to_ns;
        if self.progress[camera].end.is_none() && may_lead_out {
            self.progress[camera].waiting.push((step, field));
            return Ok(true);
        }
        self.shot.write_step(camera, step, field)
    }

    /// Whether everything of a camera is written, or will never come.
    pub(super) fn is_complete(&self, camera: usize, feed: &CameraFeed<'_>) -> bool {
        let progress = &self.progress[camera];
        let Some(end) = progress.end else { return false };
        let passed = feed.held.front().is_some_and(|sample| sample.header().sequence >= end);
        let whole = self.shot.next_frame(camera) >= end || passed || progress.drained;
        whole
            && (self.shot.has_steps_before(camera, end)
                || feed.is_measured_before(end)
                || progress.silence.has_expired())
    }

    /// Ends a camera's part with its last frame, if the frames after it will never come: the camera has died. The file
    /// then has the rows of its frames alone.
    pub(super) fn shorten(&mut self, camera: usize) -> Result<(), RecordingError> {
        let (next, Some(end)) = (self.shot.next_frame(camera), self.progress[camera].end) else { return Ok(()) };
        if next >= end || !self.shot.has_begun(camera) {
            return Ok(());
        }
        self.progress[camera].missing_at_end += end - next;
        self.set_end(camera, next)
    }

    /// Returns the number of frames of a camera that are missing in the shot so far, with those cut off at its end.
    pub(super) fn lost(&self, camera: usize) -> u64 {
        self.shot.lost(camera) + self.progress[camera].missing_at_end
    }

    /// Returns the end of each camera's part, one past its last frame: the set end, or else that of the written frames.
    pub(super) fn ends(&self) -> Vec<u64> {
        let end = |(camera, progress): (usize, &CameraProgress)| progress.end.unwrap_or(self.shot.next_frame(camera));
        self.progress.iter().enumerate().map(end).collect()
    }
}
