//! Where a shot begins and ends, for each camera.

use super::*;
use crate::bus::FrameSample;
use crate::process::shot::Extent;

impl Recorder<'_> {
    /// Takes the whole queue as it stands and starts a shot around frame `at` (the newest when `None`).
    pub(super) fn trigger(&mut self, at: Option<u64>, cause: &str) -> anyhow::Result<()> {
        for feed in &mut self.feeds {
            feed.hold(feed.limits.ring_frames + feed.limits.held_frames - 1, |_| false)?;
        }
        let feed = &mut self.feeds[0];
        let (Some(oldest), Some(newest)) = (feed.held.front(), feed.held.back()) else {
            return Ok(());
        };
        let (oldest, newest) = (oldest.header().sequence, *newest.header());
        let at = at.unwrap_or(newest.sequence);
        let block = feed.block();
        let pre = self.config.pre_trigger_frames(feed.format.frame_rate_hz);
        let post = (self.config.trigger.post_s * feed.format.frame_rate_hz).ceil() as u64;
        // Blocks are measured on their own, so a recording that begins with a block gives the same numbers again.
        let wanted = at.saturating_sub(pre) / block * block;
        let first = if wanted >= oldest { wanted } else { oldest.next_multiple_of(block) };
        let last = (at + post).max(first);
        feed.held.retain(|sample| sample.header().sequence >= first);
        let half_ns = (0.5 * feed.period_ns()) as u64;
        let stamp_of = |frame: u64| {
            let ahead = (i128::from(frame) - i128::from(newest.sequence)) as f64 * feed.period_ns();
            (i128::from(newest.stamp_ns) + ahead.round() as i128).clamp(0, i128::from(u64::MAX)) as u64
        };
        // A trigger within the stream's first block has its first frame still to come.
        let start_ns = feed.held.front().map_or(newest.stamp_ns, |sample| sample.header().stamp_ns);
        let window = Window { from_ns: start_ns.saturating_sub(half_ns), to_ns: stamp_of(last) + half_ns };
        self.event_of_frame(EventKind::Triggered, at, newest.stamp_ns, cause)?;
        self.actions.fire(&Cause { frame: at, stamp_ns: newest.stamp_ns, text: cause.to_owned() });
        self.begin(window, start_ns, &format!("{cause} at frame {at}"), last + 1 - first)?;
        let Some(active) = &mut self.shot else { return self.rearm() };
        let feed = &self.feeds[0];
        let extent = Extent { first, last: Some(last), patience_frames: feed.patience_frames() };
        active.shot.begin(0, feed.measured_with(), extent);
        active.courses[0].end = Some(last + 1);
        self.add_truth(0)
    }

    /// Starts the shot that the camera's line began first, if nothing else is written.
    pub(super) fn next_line(&mut self) -> anyhow::Result<()> {
        while self.shot.is_none()
            && let Some((first, stamp_ns, cause)) = self.waiting.pop_front()
        {
            if !self.armed || !self.quiet.passes(stamp_ns) {
                continue;
            }
            self.event_of_frame(EventKind::Triggered, first, stamp_ns, &cause)?;
            self.actions.fire(&Cause { frame: first, stamp_ns, text: cause.clone() });
            // The other cameras' pulse is the same; their clocks may differ by less than a silence.
            let half_ns = (0.5e9 * self.config.trigger.silence_s) as u64;
            let window = Window { from_ns: stamp_ns.saturating_sub(half_ns), to_ns: u64::MAX };
            self.begin(window, stamp_ns, &format!("{cause} at frame {first}"), 1)?;
            let Some(active) = &mut self.shot else {
                self.rearm()?;
                continue;
            };
            let feed = &self.feeds[0];
            let extent = Extent { first, last: None, patience_frames: feed.patience_frames() };
            active.shot.begin(0, feed.measured_with(), extent);
            self.add_truth(0)?;
        }
        Ok(())
    }

    /// A shot that a camera's line began ends where the camera was silent.
    pub(super) fn end_line(&mut self, camera: usize) -> anyhow::Result<()> {
        let Some(active) = self.shot.as_mut().filter(|active| active.shot.has_begun(camera)) else { return Ok(()) };
        if active.courses[camera].end.is_some() {
            return Ok(());
        }
        let first = active.shot.first_frame(camera);
        if self.config.trigger.mode != TriggerMode::Hardware {
            return Ok(());
        }
        let feed = &self.feeds[camera];
        let seen = feed.held.iter().find(|sample| sample.header().sequence >= first).map(|sample| sample.header().shot);
        let course = &mut active.courses[camera];
        course.shot = course.shot.or(seen);
        // The next shot's first frame may come before anybody was heard to tell of the silence.
        let is_later = |sample: &&FrameSample| {
            sample.header().sequence >= first && course.shot.is_some_and(|shot| sample.header().shot > shot)
        };
        let next = feed.held.iter().find(is_later).map(|sample| sample.header().sequence);
        let told = feed.stream.silences.iter().copied().find(|end| *end > first);
        // Of a camera whose process died, nobody tells the silence.
        let begun = self.waiting.iter().map(|waiting| waiting.0).find(|begun| camera == 0 && *begun > first);
        let Some(end) = told.into_iter().chain(next).chain(begun).min() else { return Ok(()) };
        match active.set_end(camera, end) {
            Ok(()) => Ok(()),
            Err(error) => self.abandon(&error),
        }
    }

    fn event_of_frame(&self, kind: EventKind, frame: u64, stamp_ns: u64, text: &str) -> anyhow::Result<()> {
        Ok(self.feeds[0].reporter.event(kind, frame, stamp_ns, text)?)
    }

    /// Starts the recording of a whole stream, once a frame of every camera has come or is not to be expected.
    pub(super) fn begin_stream(&mut self) -> anyhow::Result<()> {
        for camera in 0..self.feeds.len() {
            self.hold(camera)?;
        }
        let fronts = self.feeds.iter().filter_map(|feed| Some(feed.held.front()?.header().stamp_ns));
        let Some(stamp_ns) = fronts.min() else { return Ok(()) };
        let is_there = |feed: &Feed<'_>| !feed.held.is_empty() || feed.stream.end.is_some();
        let gather = self.gather.get_or_insert_with(|| Patience::new(GATHER));
        if !self.feeds.iter().all(is_there) && !gather.is_over() {
            return Ok(());
        }
        self.gather = None;
        self.begin(Window::ALL, stamp_ns, "none: the whole stream", 0)
    }

    /// Creates the recording; `frames` of it are lost when that fails. Each camera's part begins with its first frame.
    fn begin(&mut self, window: Window, stamp_ns: u64, cause: &str, frames: u64) -> anyhow::Result<()> {
        let path = free_path(&self.record.directory, &self.config.rig.name, stamp_ns);
        let info = self.info(cause);
        // The folder may have gone since the last shot.
        let created = prepare_directory(self.record).and_then(|()| Shot::create(&path, self.config, &info));
        match created {
            Ok(shot) => self.shot = Some(Active::new(shot, window, &self.feeds)),
            // Of a stream, the frames that pass by unrecorded are counted one by one.
            Err(error) => {
                self.failures += 1;
                self.give_up(&error, frames)?;
            }
        }
        Ok(())
    }

    /// What the recording says of itself and its cameras.
    fn info(&self, cause: &str) -> RecordingInfo {
        let of = |feed: &Feed<'_>| recording_info(feed.config, &feed.format, &feed.identity, cause);
        let mut info = of(&self.feeds[0]);
        for feed in &self.feeds {
            let picture = reference::kept(feed.config).map(reference::attached);
            let named = |(name, kind, content): (String, String, Vec<u8>)| match feed.name.as_str() {
                "" => (name, kind, content),
                view => (format!("{view}/{name}"), kind, content),
            };
            info.attachments.extend(picture.map(named));
        }
        for feed in &self.feeds[1..] {
            let RecordingInfo { config_toml, metadata, bodies, .. } = of(feed);
            let bodies = if feed.is_measured() { bodies } else { Vec::new() };
            info.views.push(ViewInfo { name: feed.name.clone(), config_toml, metadata, bodies });
        }
        info
    }

    fn add_truth(&mut self, camera: usize) -> anyhow::Result<()> {
        let (truth, Some(active)) = (self.feeds[camera].truth.clone(), &mut self.shot) else { return Ok(()) };
        match active.shot.set_truth(camera, truth) {
            Ok(()) => Ok(()),
            Err(error) => self.abandon(&error),
        }
    }

    /// Holds the frames of a camera that belong to the shot.
    pub(super) fn hold(&mut self, camera: usize) -> anyhow::Result<()> {
        let (end, to_ns) = match &self.shot {
            None => (u64::MAX, u64::MAX),
            Some(active) if camera == 0 => (active.courses[0].end.unwrap_or(u64::MAX), u64::MAX),
            Some(active) => (active.courses[camera].end.unwrap_or(u64::MAX), active.window.to_ns),
        };
        let feed = &mut self.feeds[camera];
        let most = feed.limits.held_frames;
        feed.hold(most, |newest| newest.header().sequence + 1 >= end || newest.header().stamp_ns > to_ns)?;
        self.find_end(camera)
    }

    /// A camera beside the first ends with the first frame that lies behind the moments of the shot.
    fn find_end(&mut self, camera: usize) -> anyhow::Result<()> {
        let Some(active) = self.shot.as_mut().filter(|active| camera > 0 && active.courses[camera].end.is_none())
        else {
            return Ok(());
        };
        let (held, to_ns) = (&self.feeds[camera].held, active.window.to_ns);
        let beyond = held.partition_point(|sample| sample.header().stamp_ns <= to_ns);
        let Some(end) = held.get(beyond).map(|sample| sample.header().sequence) else { return Ok(()) };
        match active.set_end(camera, end) {
            Ok(()) => Ok(()),
            Err(error) => self.abandon(&error),
        }
    }

    /// Begins the part of a camera with its first frame in the shot.
    pub(super) fn begin_take(&mut self, camera: usize) -> anyhow::Result<()> {
        let Some(active) = self.shot.as_mut().filter(|active| !active.shot.has_begun(camera)) else {
            return Ok(());
        };
        let feed = &mut self.feeds[camera];
        let Some(seen) = feed.held.front().map(|sample| sample.header().sequence) else { return Ok(()) };
        let first = if active.window != Window::ALL {
            feed.first_from(active.window.from_ns)
        } else if feed.resumed {
            Some(seen.next_multiple_of(feed.block()))
        } else {
            feed.stream.first
        };
        let Some(first) = first else { return Ok(()) };
        let extent = Extent {
            first,
            last: active.courses[camera].end.map(|end| end.saturating_sub(1)),
            patience_frames: feed.patience_frames(),
        };
        active.shot.begin(camera, feed.measured_with(), extent);
        if active.window == Window::ALL {
            self.summary.lost += first.saturating_sub(seen);
        }
        self.add_truth(camera)
    }

    pub(super) fn close_if_complete(&mut self) -> anyhow::Result<()> {
        let Some(active) = &mut self.shot else { return Ok(()) };
        if !active.is_complete(0, &self.feeds[0]) {
            return Ok(());
        }
        for camera in 1..self.feeds.len() {
            let course = &active.courses[camera];
            if course.end.is_none() && active.window != Window::ALL && course.silence.is_over() {
                // It has died, or never came: the others' shot does not wait for it.
                let end = active.shot.next_frame(camera);
                if let Err(error) = active.set_end(camera, end) {
                    return self.abandon(&error);
                }
                let name = self.feeds[camera].name.clone();
                self.event(EventKind::Lost, &format!("{name}: no frame came; its part of the shot ends early"))?;
                self.summary.lost += 1;
                return Ok(());
            }
            if !active.is_complete(camera, &self.feeds[camera]) {
                return Ok(());
            }
        }
        if let Some(active) = self.shot.take() {
            self.close(active)?;
            self.rearm()?;
        }
        self.next_line()
    }

    /// Sees which streams have ended; `true` when nothing is left to do.
    pub(super) fn is_over(&mut self) -> anyhow::Result<bool> {
        for camera in 0..self.feeds.len() {
            let Some(end) = self.feeds[camera].stream.end else { continue };
            self.hold(camera)?;
            // The shot may have begun since frames were looked for last.
            self.begin_take(camera)?;
            let feed = &mut self.feeds[camera];
            let is_all = feed.held.len() < feed.limits.held_frames;
            if is_all && self.shot.as_ref().is_some_and(|active| camera > 0 && !active.shot.has_begun(camera)) {
                // None of its frames belongs to this shot.
                feed.held.clear();
            }
            let Some(active) = self.shot.as_mut().filter(|_| self.feeds[camera].held.is_empty()) else { continue };
            if std::mem::replace(&mut active.courses[camera].drained, true) {
                continue;
            }
            let end = active.courses[camera].end.map_or(end, |wanted| wanted.min(end));
            // What the first camera's steps lead to was known from the start.
            let told = if camera == 0 {
                active.courses[0].end = Some(end);
                Ok(())
            } else {
                active.set_end(camera, end)
            };
            if let Err(error) = told {
                self.abandon(&error)?;
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
