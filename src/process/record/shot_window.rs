//! Start and end of a shot for each camera.

use super::super::reference_picture;
use super::*;
use crate::bus::FrameSample;
use crate::failure::Failure;
use crate::process::shot::FrameRange;

impl Recorder<'_> {
    /// Executes a trigger at this frame, the newest one if `None`, and starts its shot.
    ///
    /// The shot reaches from the block of the frame `trigger.pre_s` before the trigger, or the first whole block in the
    /// queue, to `trigger.post_s` after it. Without frames in the queue nothing happens.
    pub(super) fn trigger(&mut self, trigger_frame: Option<u64>, cause: &str) -> Result<(), Failure> {
        for feed in &mut self.feeds {
            feed.hold_frames(feed.limits.ring_frames + feed.limits.held_frames - 1, |_| false)?;
        }
        let feed = &mut self.feeds[0];
        let (Some(oldest), Some(newest)) = (feed.held.front(), feed.held.back()) else {
            return Ok(());
        };
        let (oldest, newest) = (oldest.header().sequence, *newest.header());
        let trigger_frame = trigger_frame.unwrap_or(newest.sequence);
        let block = feed.block_frames();
        let pre = self.config.pre_trigger_frames(feed.format.frame_rate_hz);
        let post = (self.config.trigger.post_s * feed.format.frame_rate_hz).ceil() as u64;
        // Blocks are measured independently, so a recording that begins with a block reproduces the same numbers.
        let wanted = trigger_frame.saturating_sub(pre) / block * block;
        let first = if wanted >= oldest { wanted } else { oldest.next_multiple_of(block) };
        let last = (trigger_frame + post).max(first);
        feed.held.retain(|sample| sample.header().sequence >= first);
        let half_ns = (0.5 * feed.period_ns()) as u64;
        let stamp_of = |frame: u64| {
            let ahead = (i128::from(frame) - i128::from(newest.sequence)) as f64 * feed.period_ns();
            (i128::from(newest.stamp_ns) + ahead.round() as i128).clamp(0, i128::from(u64::MAX)) as u64
        };
        // For a trigger within the stream's first block, the first frame is still to come.
        let start_ns = feed.held.front().map_or(newest.stamp_ns, |sample| sample.header().stamp_ns);
        let window = ShotWindow { from_ns: start_ns.saturating_sub(half_ns), to_ns: stamp_of(last) + half_ns };
        let stamp_ns = stamp_of(trigger_frame);
        self.execute(&TriggerCause {
            frame: FrameStamp { sequence: trigger_frame, stamp_ns },
            text: cause.to_owned(),
        })?;
        self.begin(window, start_ns, &format!("{cause} at frame {trigger_frame}"), last + 1 - first)?;
        if self.shot.is_none() { self.rearm() } else { self.begin_camera(0, first, Some(last + 1)) }
    }

    /// Starts the next waiting shot of the hardware trigger, unless one is being written. Shots that came while the rig
    /// is disarmed or within the quiet time are dropped.
    pub(super) fn start_waiting_shot(&mut self) -> Result<(), Failure> {
        while self.shot.is_none()
            && let Some(cause) = self.waiting.pop_front()
        {
            if !self.armed || !self.quiet.passes(cause.frame.stamp_ns) {
                continue;
            }
            self.execute(&cause)?;
            let FrameStamp { sequence: first, stamp_ns } = cause.frame;
            // The other cameras receive the same pulse; their clocks may differ by less than the silence.
            let half_ns = (0.5e9 * self.config.trigger.silence_s) as u64;
            let window = ShotWindow { from_ns: stamp_ns.saturating_sub(half_ns), to_ns: u64::MAX };
            self.begin(window, stamp_ns, &format!("{} at frame {first}", cause.text), 1)?;
            if self.shot.is_none() { self.rearm() } else { self.begin_camera(0, first, None) }?;
        }
        Ok(())
    }

    /// Ends a camera's part of a hardware-triggered shot at the silence after it, or at the next shot.
    pub(super) fn end_at_silence(&mut self, camera: usize) -> Result<(), Failure> {
        let is_open = |open: &&mut OpenShot| open.shot.has_begun(camera) && open.progress[camera].end.is_none();
        let Some(open) = self.shot.as_mut().filter(is_open) else { return Ok(()) };
        if self.config.trigger.mode != TriggerMode::Hardware {
            return Ok(());
        }
        let first = open.shot.first_frame(camera);
        let feed = &self.feeds[camera];
        let first_shot =
            feed.held.iter().find(|sample| sample.header().sequence >= first).map(|sample| sample.header().shot);
        let progress = &mut open.progress[camera];
        progress.shot = progress.shot.or(first_shot);
        // The next shot's first frame may come before the silence is announced.
        let is_later = |sample: &&FrameSample| {
            sample.header().sequence >= first && progress.shot.is_some_and(|shot| sample.header().shot > shot)
        };
        let next = feed.held.iter().find(is_later).map(|sample| sample.header().sequence);
        let silent = feed.stream.silences.iter().copied().find(|end| *end > first);
        // A dead camera process announces no silence.
        let begun = self.waiting.iter().map(|cause| cause.frame.sequence).find(|begun| camera == 0 && *begun > first);
        let Some(end) = silent.into_iter().chain(next).chain(begun).min() else { return Ok(()) };
        self.write(|open| open.set_end(camera, end)).map(drop)
    }

    /// Publishes a trigger and starts its actions.
    fn execute(&mut self, cause: &TriggerCause) -> Result<(), Failure> {
        self.feeds[0].reporter.publish_event(EventKind::Triggered, cause.frame, &cause.text)?;
        self.actions.start(cause);
        Ok(())
    }

    /// Starts the recording of a whole stream, once a frame of every camera has come or the wait for it is over.
    pub(super) fn begin_stream(&mut self) -> Result<(), Failure> {
        for camera in 0..self.feeds.len() {
            self.hold_frames(camera)?;
        }
        let fronts = self.feeds.iter().filter_map(|feed| Some(feed.held.front()?.header().stamp_ns));
        let Some(stamp_ns) = fronts.min() else { return Ok(()) };
        let is_there = |feed: &CameraFeed<'_>| !feed.held.is_empty() || feed.stream.end.is_some();
        let gather = self.gather.get_or_insert_with(|| Timeout::new(GATHER_TIMEOUT));
        if !self.feeds.iter().all(is_there) && !gather.has_expired() {
            return Ok(());
        }
        self.gather = None;
        self.begin(ShotWindow::ALL, stamp_ns, "none: the whole stream", 0)
    }

    /// Creates the recording of a shot, named by its first stamp; if that fails, `frames` are counted as lost. The
    /// parts of the cameras begin later, each with its first frame.
    fn begin(&mut self, window: ShotWindow, stamp_ns: u64, cause: &str, frames: u64) -> Result<(), Failure> {
        let path = free_path(&self.record.directory, &self.config.rig.name, stamp_ns);
        let info = self.info(cause);
        // The folder may have been removed since the last shot.
        let created = prepare_directory(self.record).and_then(|()| Shot::create(&path, self.config, &info));
        match created {
            Ok(shot) => self.shot = Some(OpenShot::new(shot, window, &self.feeds)),
            // For a stream, unrecorded frames are counted one by one.
            Err(error) => {
                self.failures += 1;
                self.give_up(&error, frames)?;
            }
        }
        Ok(())
    }

    /// Returns the recording's description of itself and its cameras.
    fn info(&self, cause: &str) -> RecordingInfo {
        let info_of = |feed: &CameraFeed<'_>| recording_info(feed.config, &feed.format, &feed.identity, cause);
        let mut info = info_of(&self.feeds[0]);
        for feed in &self.feeds {
            let png = reference_picture::stored_png(feed.config, &feed.bus);
            let picture = png.map(reference_picture::png_attachment);
            let named = |(name, kind, content): (String, String, Vec<u8>)| match feed.name.as_str() {
                "" => (name, kind, content),
                view => (format!("{view}/{name}"), kind, content),
            };
            info.attachments.extend(picture.map(named));
        }
        for feed in &self.feeds[1..] {
            let RecordingInfo { config_toml, metadata, bodies, .. } = info_of(feed);
            let bodies = if feed.is_measured() { bodies } else { Vec::new() };
            info.views.push(ViewInfo { name: feed.name.clone(), config_toml, metadata, bodies });
        }
        info
    }

    /// Begins the part of a camera with this frame; `end` is one past its last frame, if known.
    fn begin_camera(&mut self, camera: usize, first: u64, end: Option<u64>) -> Result<(), Failure> {
        let feed = &self.feeds[camera];
        let last = end.map(|end| end.saturating_sub(1));
        let range = FrameRange { first, last, max_delay_frames: feed.max_delay_frames() };
        if let Some(open) = &mut self.shot {
            open.shot.begin(camera, feed.tracker_params(), range);
            open.progress[camera].end = end;
        }
        let truth = feed.truth.clone();
        self.write(|open| open.shot.set_truth(camera, truth)).map(drop)
    }

    /// Holds the frames of a camera that belong to the shot, and ends its part if a frame after the shot has come.
    pub(super) fn hold_frames(&mut self, camera: usize) -> Result<(), Failure> {
        let (end, to_ns) = match &self.shot {
            None => (u64::MAX, u64::MAX),
            Some(open) if camera == 0 => (open.progress[0].end.unwrap_or(u64::MAX), u64::MAX),
            Some(open) => (open.progress[camera].end.unwrap_or(u64::MAX), open.window.to_ns),
        };
        let feed = &mut self.feeds[camera];
        let max = feed.limits.held_frames;
        feed.hold_frames(max, |newest| newest.header().sequence + 1 >= end || newest.header().stamp_ns > to_ns)?;
        self.find_end(camera)
    }

    /// Ends the part of a further camera with its first frame after the shot's window.
    fn find_end(&mut self, camera: usize) -> Result<(), Failure> {
        let Some(open) = self.shot.as_mut().filter(|open| camera > 0 && open.progress[camera].end.is_none()) else {
            return Ok(());
        };
        let (held, to_ns) = (&self.feeds[camera].held, open.window.to_ns);
        let beyond = held.partition_point(|sample| sample.header().stamp_ns <= to_ns);
        let Some(end) = held.get(beyond).map(|sample| sample.header().sequence) else { return Ok(()) };
        self.write(|open| open.set_end(camera, end)).map(drop)
    }

    /// Begins the part of a camera with its first frame in the shot, once that has come. In a whole stream, the frames
    /// before it that this recorder or its predecessor missed are counted as lost.
    pub(super) fn begin_part(&mut self, camera: usize) -> Result<(), Failure> {
        let Some(open) = self.shot.as_mut().filter(|open| !open.shot.has_begun(camera)) else {
            return Ok(());
        };
        let feed = &mut self.feeds[camera];
        let Some(seen) = feed.held.front().map(|sample| sample.header().sequence) else { return Ok(()) };
        let first = if open.window != ShotWindow::ALL {
            feed.first_from(open.window.from_ns)
        } else if feed.resumed {
            Some(seen.next_multiple_of(feed.block_frames()))
        } else {
            feed.stream.first
        };
        let Some(first) = first else { return Ok(()) };
        if open.window == ShotWindow::ALL {
            let due = self.feeds[camera].predecessor_end.take().unwrap_or(seen).min(seen);
            self.summary.lost += first.saturating_sub(due);
        }
        let end = open.progress[camera].end;
        self.begin_camera(camera, first, end)
    }

    /// Closes the shot once the parts of all cameras are complete, and starts the next waiting one.
    ///
    /// A further camera without frames for [`SILENCE`](super::SILENCE) ends its part early.
    pub(super) fn close_if_complete(&mut self) -> Result<(), Failure> {
        let Some(open) = &mut self.shot else { return Ok(()) };
        if !open.is_complete(0, &self.feeds[0]) {
            return Ok(());
        }
        for camera in 1..self.feeds.len() {
            let progress = &open.progress[camera];
            if progress.end.is_none() && open.window != ShotWindow::ALL && progress.silence.has_expired() {
                // It has died or never came: the shot of the others does not wait for it.
                let end = open.shot.next_frame(camera);
                if self.write(|open| open.set_end(camera, end))?.is_none() {
                    return Ok(());
                }
                let name = self.feeds[camera].name.clone();
                self.publish_event(
                    EventKind::Lost,
                    &format!("{name}: no frame came; its part of the shot ends early"),
                )?;
                self.summary.lost += 1;
                return Ok(());
            }
            if !open.is_complete(camera, &self.feeds[camera]) {
                return Ok(());
            }
        }
        if let Some(open) = self.shot.take() {
            self.close(open)?;
            self.rearm()?;
        }
        self.start_waiting_shot()
    }

    /// Ends the parts of cameras whose streams have ended, and closes a complete shot. Returns `true` if all streams
    /// have ended and nothing is left to write.
    pub(super) fn handle_stream_ends(&mut self) -> Result<bool, Failure> {
        for camera in 0..self.feeds.len() {
            let Some(end) = self.feeds[camera].stream.end else { continue };
            self.hold_frames(camera)?;
            // The shot may have begun since the last check.
            self.begin_part(camera)?;
            let feed = &mut self.feeds[camera];
            let is_all = feed.held.len() < feed.limits.held_frames;
            if is_all && self.shot.as_ref().is_some_and(|open| camera > 0 && !open.shot.has_begun(camera)) {
                // None of its frames belongs to this shot.
                feed.held.clear();
            }
            let Some(open) = self.shot.as_mut().filter(|_| self.feeds[camera].held.is_empty()) else { continue };
            if std::mem::replace(&mut open.progress[camera].drained, true) {
                continue;
            }
            let end = open.progress[camera].end.map_or(end, |wanted| wanted.min(end));
            if camera == 0 {
                // The main camera has no steps that wait for its end.
                open.progress[0].end = Some(end);
            } else {
                self.write(|open| open.set_end(camera, end))?;
            }
        }
        if !self.feeds.iter().all(|feed| feed.stream.end.is_some()) {
            return Ok(false);
        }
        self.close_if_complete()?;
        let streams = self.config.trigger.mode == TriggerMode::Off;
        Ok(self.shot.is_none() && (!streams || self.feeds.iter().all(|feed| feed.held.is_empty())))
    }
}
