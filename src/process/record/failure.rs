//! When a recording cannot be written: the loss is told and counted, the part file stays, the rig goes on.

use super::Recorder;
use super::active::Active;
use crate::config::TriggerMode;
use crate::message::EventKind;
use crate::process::clock::Patience;
use crate::process::storage::prepare_directory;
use crate::recording::RecordingError;
use std::time::Duration;

/// How long a stream goes unrecorded after its recording failed; twice as long after each failure in a row.
const PAUSE: Duration = Duration::from_secs(1);
/// Failures in a row after which the pause grows no more.
const MOST_DOUBLINGS: u32 = 6;

impl Recorder<'_> {
    /// Gives up the shot under way; its part file stays.
    pub(super) fn abandon(&mut self, error: &RecordingError) -> anyhow::Result<()> {
        let Some(active) = self.shot.take() else { return Ok(()) };
        let end = active.ends()[0];
        let missing = active.shot.missing_before(end).max(1);
        self.failures = if active.shot.frames() > missing { 0 } else { self.failures + 1 };
        self.give_up(error, missing)?;
        self.rearm()
    }

    /// Tells that a recording failed, and how many of its frames may be missing; the rig goes on.
    pub(super) fn give_up(&mut self, error: &RecordingError, missing: u64) -> anyhow::Result<()> {
        self.summary.lost += missing;
        let text = format!("up to {missing} frames are missing: {error}");
        log::warn!("{text}");
        self.event(EventKind::Lost, &text)?;
        if self.config.trigger.mode == TriggerMode::Off {
            self.pause = Some(Patience::new(PAUSE * (1 << self.failures.min(MOST_DOUBLINGS))));
        }
        Ok(())
    }

    /// Whether a stream still has to go unrecorded.
    pub(super) fn is_paused(&mut self) -> anyhow::Result<bool> {
        let Some(pause) = &mut self.pause else { return Ok(false) };
        if !pause.is_over() {
            return Ok(true);
        }
        pause.renew();
        if prepare_directory(self.record).is_err() || !self.storage.has_room_to_begin() {
            return Ok(true);
        }
        self.pause = None;
        self.feeds.iter_mut().for_each(|feed| feed.resumed = true);
        self.event(EventKind::Storage, "recording again")?;
        Ok(false)
    }

    /// Lets a frame go that cannot be recorded.
    pub(super) fn pass_by(&mut self) -> anyhow::Result<bool> {
        let mut passed = false;
        for camera in 0..self.feeds.len() {
            self.hold(camera)?;
            let feed = &mut self.feeds[camera];
            let Some(sample) = feed.held.pop_front() else { continue };
            let header = *sample.header();
            self.summary.lost += 1;
            feed.newest = (header.sequence, header.stamp_ns);
            feed.reporter.progress(header.sequence + 1, false)?;
            passed = true;
        }
        Ok(passed)
    }

    /// Tells when the room for recordings becomes too little, and when it is enough again.
    pub(super) fn look_at_storage(&mut self) -> anyhow::Result<()> {
        let left = |active: &Active| Some(active.courses[0].end?.saturating_sub(active.shot.next_frame(0)));
        let left = self.shot.as_ref().and_then(left);
        if self.shot.is_none() && !self.armed && self.config.trigger.mode != TriggerMode::Off {
            return Ok(());
        }
        if let Some(text) = self.storage.look(left) {
            if self.storage.is_troubled() {
                log::warn!("{text}");
            }
            self.event(EventKind::Storage, &text)?;
        }
        Ok(())
    }
}
