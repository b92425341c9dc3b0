//! Failures of writing: the loss is reported and counted, the part file stays, and the rig continues.

use super::Recorder;
use super::open_shot::OpenShot;
use crate::config::TriggerMode;
use crate::failure::Failure;
use crate::message::EventKind;
use crate::process::clock::Timeout;
use crate::process::frame_stamp::FrameStamp;
use crate::process::storage::prepare_directory;
use crate::recording::RecordingError;
use std::time::Duration;

/// Pause of recording a stream after a failure; it doubles with each consecutive failure.
const PAUSE: Duration = Duration::from_secs(1);
/// Number of consecutive failures after which the pause no longer grows.
const MAX_DOUBLINGS: u32 = 6;

impl Recorder<'_> {
    /// Writes to the open shot, which is abandoned on an error; returns `None` without a shot or on an error.
    pub(super) fn write<R>(
        &mut self,
        write: impl FnOnce(&mut OpenShot) -> Result<R, RecordingError>,
    ) -> Result<Option<R>, Failure> {
        match self.shot.as_mut().map(write).transpose() {
            Ok(result) => Ok(result),
            Err(error) => self.abandon(&error).map(|()| None),
        }
    }

    /// Abandons the open shot; its part file stays.
    pub(super) fn abandon(&mut self, error: &RecordingError) -> Result<(), Failure> {
        let Some(open) = self.shot.take() else { return Ok(()) };
        let end = open.ends()[0];
        let missing = open.shot.missing_before(end).max(1);
        self.failures = if open.shot.frames() > missing { 0 } else { self.failures + 1 };
        self.give_up(error, missing)?;
        self.rearm()
    }

    /// Reports that a recording failed, and counts the frames that may be missing as lost. Recording of a stream
    /// pauses; the rig continues.
    pub(super) fn give_up(&mut self, error: &RecordingError, missing: u64) -> Result<(), Failure> {
        self.summary.lost += missing;
        let text = format!("up to {missing} frames are missing: {error}");
        log::warn!("{text}");
        self.publish_event(EventKind::Lost, &text)?;
        if self.config.trigger.mode == TriggerMode::Off {
            self.pause = Some(Timeout::new(PAUSE * (1 << self.failures.min(MAX_DOUBLINGS))));
        }
        Ok(())
    }

    /// Ends the pause after a failure if its time is over and the disk is usable again; returns whether recording is
    /// still paused.
    pub(super) fn update_pause(&mut self) -> Result<bool, Failure> {
        let Some(pause) = &mut self.pause else { return Ok(false) };
        if !pause.has_expired() {
            return Ok(true);
        }
        pause.renew();
        if prepare_directory(self.record).is_err() || !self.storage.has_room_to_begin() {
            return Ok(true);
        }
        self.pause = None;
        self.feeds.iter_mut().for_each(|feed| feed.resumed = true);
        self.publish_event(EventKind::Storage, "recording again")?;
        Ok(false)
    }

    /// Discards one frame per camera during a pause, counted as lost; returns whether there was one.
    pub(super) fn discard_frames(&mut self) -> Result<bool, Failure> {
        let mut discarded = false;
        for camera in 0..self.feeds.len() {
            self.hold_frames(camera)?;
            let feed = &mut self.feeds[camera];
            let Some(sample) = feed.held.pop_front() else { continue };
            let header = *sample.header();
            self.summary.lost += 1;
            feed.newest = FrameStamp::from(&header);
            feed.reporter.publish_progress(header.sequence + 1)?;
            discarded = true;
        }
        Ok(discarded)
    }

    /// Reports when free disk space becomes too small or the folder unusable, and when it is sufficient again. A
    /// disarmed recorder without an open shot needs no space.
    pub(super) fn check_storage(&mut self) -> Result<(), Failure> {
        let remaining = |open: &OpenShot| Some(open.progress[0].end?.saturating_sub(open.shot.next_frame(0)));
        let remaining = self.shot.as_ref().and_then(remaining);
        if self.shot.is_none() && !self.armed && self.config.trigger.mode != TriggerMode::Off {
            return Ok(());
        }
        if let Some(text) = self.storage.check(remaining) {
            if self.storage.has_problem() {
                log::warn!("{text}");
            }
            self.publish_event(EventKind::Storage, &text)?;
        }
        Ok(())
    }
}
