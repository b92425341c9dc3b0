//! Recording: from topics to files.
//!
//! While armed, the recorder reads nothing: its queue on the ring *is* the pre-trigger buffer, which costs no time and
//! no copy. At a trigger it takes the whole queue at once, holds the frames in place and writes them one by one.

mod camera_feed;
mod frame_matching;
mod open_shot;
mod remeasure;
mod requests;
mod retention;
mod shot_window;
mod write_failure;

use super::action::{Actions, TriggerCause};
use super::clock::{PeriodicTimer, Timeout};
use super::frame_stamp::FrameStamp;
use super::launch::Launch;
use super::live_trigger::LiveTrigger;
use super::shot::{Shot, free_path, recording_info};
use super::stop::Stop;
use super::storage::{Storage, prepare_directory};
use super::summary::Summary;
use crate::bus::{ControlServer, TopicListener};
use crate::config::{Config, Record, TriggerMode};
use crate::failure::Failure;
use crate::image::Frame;
use crate::message::{Command, Event, EventKind};
use crate::recording::{EventRow, RecordingInfo, ViewInfo};
use crate::trigger::Quiet;
use camera_feed::CameraFeed;
pub use frame_matching::{Matcher, Matching};
use open_shot::{OpenShot, ShotWindow};
use remeasure::{Incomplete, Remeasured, Remeasurer};
use retention::Retention;
use std::collections::VecDeque;
use std::path::Path;
use std::time::Duration;

/// Maximum wait for frames before the loop does its other work.
const WAIT: Duration = Duration::from_millis(2);
/// Pause between two looks for a trigger, in which frames wake nobody.
const IDLE_PAUSE: Duration = Duration::from_millis(4);
/// Interval at which an armed recorder connects to new writers; this consumes nothing.
const CONNECT_PERIOD: Duration = Duration::from_millis(100);
/// Time without results after which the rows of a worker's frames count as lost.
const SILENCE: Duration = Duration::from_secs(5);
/// Time for the first frame of every camera at the start of a recorded stream.
const GATHER_TIMEOUT: Duration = Duration::from_secs(2);

/// Records shots (or the whole stream) until the stream ends.
///
/// A disk that is full, gone or read-only ends the recording, not the recorder. The written part stays, the loss is
/// reported and counted, and the next shot is recorded again.
///
/// # Errors
///
/// If the folder cannot be used from the start, or shared memory cannot be used.
pub fn run(config: &Config, launch: &Launch, stop: &Stop) -> Result<Summary, Failure> {
    let Some(record) = &config.record else {
        return Err(Failure::internal(format!("{}: nothing to record: there is no [record] table", config.origin)));
    };
    if let Err(error) = prepare_directory(record) {
        if !launch.is_restart {
            return Err(error.into());
        }
        log::warn!("{error}");
    }
    let mut feeds = vec![CameraFeed::open("", config, launch)?];
    for view in &config.views {
        feeds.push(CameraFeed::open(&view.name, &view.config, launch)?);
    }
    let listener = feeds[0].bus.notification_subscriber("frames")?;
    feeds.iter().try_for_each(|feed| feed.bus.reserve())?;
    let mut recorder = Recorder {
        control: feeds[0].bus.control_server()?,
        shot: None,
        storage: Storage::new(config, record, feeds.iter().map(|feed| (&feed.format, &feed.limits))),
        retention: Retention::new(record, &config.rig.name),
        pause: None,
        gather: None,
        failures: 0,
        armed: config.trigger.mode != TriggerMode::Off,
        requested_arming: None,
        waiting: VecDeque::new(),
        connect_timer: PeriodicTimer::new(CONNECT_PERIOD),
        quiet: Quiet::new(config.trigger.quiet_s),
        actions: Actions::new(config),
        remeasurer: Remeasurer::default(),
        live_trigger: (!feeds[0].is_measured()).then(|| LiveTrigger::new(config)),
        summary: Summary::default(),
        published_losses: 0,
        feeds,
        config,
        record,
    };
    recorder.serve(&listener, stop)?;
    Ok(recorder.summary)
}

/// The recorder of a rig.
struct Recorder<'a> {
    /// One per camera, the main camera first.
    feeds: Vec<CameraFeed<'a>>,
    control: ControlServer,
    shot: Option<OpenShot>,
    storage: Storage,
    retention: Retention,
    /// Pause of recording a stream after a failure.
    pause: Option<Timeout>,
    /// Wait for the first frames of a stream.
    gather: Option<Timeout>,
    /// Number of consecutive recordings that failed before a frame was safely stored.
    failures: u32,
    armed: bool,
    /// Arming requested during a shot, for the time after it.
    requested_arming: Option<Command>,
    /// Shots of the hardware trigger that began while another one was written.
    waiting: VecDeque<TriggerCause>,
    connect_timer: PeriodicTimer,
    quiet: Quiet,
    actions: Actions,
    remeasurer: Remeasurer,
    /// The rig's state, if no tracker publishes it.
    live_trigger: Option<LiveTrigger>,
    summary: Summary,
    /// The number of lost frames in the newest status.
    published_losses: u64,
    config: &'a Config,
    record: &'a Record,
}

impl Recorder<'_> {
    /// Records until the streams of all cameras have ended or a stop is requested.
    fn serve(&mut self, listener: &TopicListener, stop: &Stop) -> Result<(), Failure> {
        while !stop.requested() {
            self.attach()?;
            self.answer_requests()?;
            for camera in 0..self.feeds.len() {
                let events = self.feeds[camera].stream.take_events();
                if let (0, Some(live_trigger)) = (camera, &mut self.live_trigger) {
                    live_trigger.handle_events(&events, &self.feeds[0].reporter)?;
                }
                self.handle_events(camera, &events)?;
            }
            let busy = self.advance()?;
            if self.handle_stream_ends()? {
                break;
            }
            self.check_storage()?;
            while let Some(outcome) = self.actions.next_outcome() {
                self.feeds[0].reporter.publish_outcome(&outcome)?;
            }
            if let Some(remeasured) = self.remeasurer.advance() {
                self.publish_remeasured(&remeasured)?;
            }
            self.check_retention()?;
            self.publish_status()?;
            if !busy {
                if self.shot.is_none() && self.config.trigger.mode != TriggerMode::Off {
                    std::thread::sleep(IDLE_PAUSE);
                }
                listener.wait(WAIT);
            }
        }
        if let Some(open) = self.shot.take() {
            self.close(open)?;
        }
        for feed in &mut self.feeds {
            let end = feed.stream.end.unwrap_or(0);
            feed.reporter.publish_done(end)?;
        }
        self.finish_remeasuring()?;
        for outcome in self.actions.wait_for_all() {
            self.feeds[0].reporter.publish_outcome(&outcome)?;
        }
        if let Some(mut live_trigger) = self.live_trigger.take() {
            // The recorder's own events of the last recording count too.
            let feed = &mut self.feeds[0];
            feed.stream.update()?;
            live_trigger.handle_events(&feed.stream.take_events(), &feed.reporter)?;
            live_trigger.end_stream(feed.newest, &feed.reporter)?;
        }
        let summary = &self.summary;
        self.feeds.iter_mut().try_for_each(|feed| feed.reporter.publish_status(summary, feed.newest))?;
        Ok(())
    }

    /// Attaches to newly announced runs, and publishes readiness once all cameras are prepared, so that they start
    /// together.
    ///
    /// A run that does not continue the previous one ends the open shot (main camera) or its part (further cameras).
    fn attach(&mut self) -> Result<(), Failure> {
        for camera in 0..self.feeds.len() {
            let feed = &mut self.feeds[camera];
            if !feed.stream.update()? {
                continue;
            }
            if camera == 0
                && !feed.stream.continues
                && let Some(open) = self.shot.take()
            {
                self.close(open)?;
            }
            let feed = &mut self.feeds[camera];
            if let (Some(open), false) = (&mut self.shot, feed.stream.continues) {
                open.progress[camera].drained = true;
                let end = open.shot.next_frame(camera);
                open.set_end(camera, end)?;
            }
            feed.attach();
        }
        if self.feeds.iter().all(CameraFeed::is_prepared) {
            self.feeds.iter_mut().try_for_each(CameraFeed::publish_ready)?;
        }
        Ok(())
    }

    /// Arms or disarms, as the command requests, and publishes it.
    fn arm(&mut self, command: Command) -> Result<(), Failure> {
        self.armed = command == Command::Arm;
        let kind = if self.armed { EventKind::Armed } else { EventKind::Disarmed };
        let during = if self.shot.is_some() { "; a shot is being written" } else { "" };
        self.publish_event(kind, &format!("{}{during}", kind.as_str()))
    }

    /// Publishes an event of the whole rig at the main camera's newest written frame.
    fn publish_event(&self, kind: EventKind, text: &str) -> Result<(), Failure> {
        let feed = &self.feeds[0];
        Ok(feed.reporter.publish_event(kind, feed.newest, text)?)
    }

    /// Executes triggers of other processes, and writes the events of a camera to the open shot.
    fn handle_events(&mut self, camera: usize, events: &[Event]) -> Result<(), Failure> {
        for event in events {
            self.feeds[camera].handle_event(event);
            let is_decided = camera == 0 && event.kind() == Some(EventKind::Decided);
            let text = event.text();
            let cause = text.split_once("; ").map_or(text.as_str(), |(what, _)| what);
            if is_decided && self.config.trigger.mode == TriggerMode::Hardware {
                // Checked for arming only when its turn comes, so that it is not lost to the previous shot.
                let text = cause.to_owned();
                self.waiting.push_back(TriggerCause { frame: event.into(), text });
                self.start_waiting_shot()?;
            } else if is_decided && self.armed && self.shot.is_none() && self.quiet.passes(event.stamp_ns) {
                self.trigger(Some(event.sequence), cause)?;
            }
            if let Some(kind) = event.kind() {
                let text = format!("{}frame {}: {text}", self.feeds[camera].prefix(), event.sequence);
                let row = EventRow { stamp_ns: event.stamp_ns, kind: kind.as_str().into(), text };
                self.write(|open| open.shot.write_event(&row))?;
            }
        }
        Ok(())
    }

    /// Advances the open shot; returns `true` if there is more to do at once.
    fn advance(&mut self) -> Result<bool, Failure> {
        let streams = self.config.trigger.mode == TriggerMode::Off;
        if streams && self.shot.is_none() && self.feeds.iter().any(|feed| feed.stream.first.is_some()) {
            if self.update_pause()? {
                return self.discard_frames();
            }
            self.begin_stream()?;
        }
        if self.shot.is_none() {
            if self.connect_timer.restart_if_due() {
                for feed in &self.feeds {
                    feed.frames.update_connections();
                    feed.fields.update_connections();
                }
            }
            return Ok(false);
        }
        let mut goes_on = false;
        for camera in 0..self.feeds.len() {
            self.feeds[camera].update_progress()?;
            self.hold_frames(camera)?;
            self.begin_part(camera)?;
            self.end_at_silence(camera)?;
            let wrote = self.write_held_frame(camera)?;
            self.take_steps(camera)?;
            goes_on |= wrote && !self.feeds[camera].held.is_empty();
        }
        self.close_if_complete()?;
        if !goes_on {
            let handed_over = self.write(|open| open.shot.write_buffered())?.is_some();
            self.feeds.iter_mut().filter(|_| handed_over).for_each(CameraFeed::note_written);
        }
        Ok(goes_on)
    }

    /// Takes the oldest held frame of a camera, unless it lies after the shot, and writes it if it does not lie before
    /// it. Returns whether a frame was taken.
    fn write_held_frame(&mut self, camera: usize) -> Result<bool, Failure> {
        let Some(open) = &mut self.shot else { return Ok(false) };
        let feed = &mut self.feeds[camera];
        // Frames beyond the end belong to the next shot.
        let end = open.progress[camera].end.unwrap_or(u64::MAX);
        let has_begun = open.shot.has_begun(camera);
        if !has_begun || feed.held.front().is_none_or(|sample| sample.header().sequence >= end) {
            return Ok(false);
        }
        let Some(sample) = feed.held.pop_front() else { return Ok(false) };
        let header = *sample.header();
        if let Some(meta) = header.meta()
            && header.sequence >= open.shot.next_frame(camera)
        {
            let frame = Frame { meta, bytes: sample.bytes() };
            if self.write(|open| open.add_frame(camera, &frame))?.is_none() {
                return Ok(true);
            }
            let feed = &mut self.feeds[camera];
            self.summary.taken += 1;
            feed.newest = FrameStamp::from(&header);
            if self.config.trigger.mode == TriggerMode::Off {
                feed.reporter.publish_progress(header.sequence + 1)?;
            }
        }
        Ok(true)
    }

    /// Writes the steps of a camera that have come, and keeps those of the next shot.
    fn take_steps(&mut self, camera: usize) -> Result<(), Failure> {
        let Some(open) = &mut self.shot else { return Ok(()) };
        let follows = self.config.trigger.mode == TriggerMode::Hardware;
        let feed = &mut self.feeds[camera];
        // Before the first frame it is unknown which steps belong to the shot; they stay in the queue.
        if !open.shot.has_begun(camera) {
            return Ok(());
        }
        let newest = feed.held.back().map_or(0, |sample| sample.header().sequence + 1);
        let next = newest.max(open.shot.next_frame(camera));
        let mut early = std::mem::take(&mut feed.early).into_iter();
        while let Some((step, field)) = early.next().map_or_else(|| feed.next_step(), |step| Ok(Some(step)))? {
            // Steps of the next shot may come before this one is complete, and with a hardware trigger even
            // before its end is announced.
            let is_later = match open.progress[camera].end {
                Some(end) => step.frame >= end,
                None => follows && step.frame >= next,
            };
            if is_later {
                feed.early.push((step, field));
                continue;
            }
            match open.add_step(camera, feed.period_ns(), step, field) {
                Ok(true) => {
                    open.progress[camera].silence.renew();
                    self.summary.given += 1;
                }
                // Steps of the next shot do not show that this one's will still come.
                Ok(false) => {}
                Err(error) => return self.abandon(&error),
            }
        }
        Ok(())
    }

    /// Arms or disarms after a shot: as requested during it, else as configured.
    fn rearm(&mut self) -> Result<(), Failure> {
        let default = if self.config.trigger.rearm { Command::Arm } else { Command::Disarm };
        match (self.config.trigger.mode, self.requested_arming.take()) {
            (TriggerMode::Off, _) => Ok(()),
            (_, requested) => self.arm(requested.unwrap_or(default)),
        }
    }

    /// Completes the file of a shot, publishes its matching, its losses and its path, and removes recordings beyond the
    /// limits.
    ///
    /// # Errors
    ///
    /// When an event cannot be published. A failure to write is reported and counted, not returned.
    fn close(&mut self, mut open: OpenShot) -> Result<(), Failure> {
        let shortened = (0..self.feeds.len()).try_for_each(|camera| open.shorten(camera));
        let ends = open.ends();
        let unsafe_frames = open.shot.missing_before(ends[0]).max(1);
        let lost: Vec<u64> = (ends.iter().enumerate())
            .map(|(camera, end)| open.lost(camera) + end.saturating_sub(open.shot.next_frame(camera)))
            .collect();
        let firsts: Vec<u64> = (0..self.feeds.len()).map(|camera| open.shot.first_frame(camera)).collect();
        let (mut shot, stamp_ns) = (open.shot, self.feeds[0].newest.stamp_ns);
        let mut written = shortened;
        for (feed, matcher) in self.feeds[1..].iter().zip(open.matchers) {
            let text = format!("{}: {}", feed.name, matcher.finish());
            feed.reporter.publish_event(EventKind::Matched, feed.newest, &text)?;
            self.publish_event(EventKind::Matched, &text)?;
            let kind = EventKind::Matched.as_str().into();
            written = written.and_then(|()| shot.write_event(&EventRow { stamp_ns, kind, text }));
        }
        let (finished, missing) = match written.and_then(|()| shot.finish(&ends)) {
            Ok(finished) => finished,
            Err(error) => return self.give_up(&error, unsafe_frames),
        };
        self.failures = 0;
        let all = lost.iter().sum::<u64>();
        self.summary.lost += all;
        self.summary.dropped += missing;
        if all + missing > 0 {
            let text =
                format!("{} and {missing} rows are missing in {}", self.describe_lost(&lost), finished.path.display());
            self.publish_event_at(EventKind::Lost, ends[0], &text)?;
        }
        self.publish_event_at(EventKind::Recorded, ends[0], &finished.path.display().to_string())?;
        self.remeasure(&finished.path, &firsts);
        self.retention.add(&finished.path);
        self.summary.recordings.push(finished.path);
        let removed = self.retention.enforce(None);
        self.publish_removed(removed)
    }

    /// Puts the cameras of a recording of which the workers have left out frames in the queue of those that are measured
    /// after the shot. `firsts` are the first frames of the cameras.
    fn remeasure(&mut self, path: &Path, firsts: &[u64]) {
        for (feed, first) in self.feeds.iter_mut().zip(firsts) {
            let is_incomplete = feed.newest_skipped.take().is_some_and(|newest| newest >= *first);
            if is_incomplete && self.record.raw_frames {
                let (path, view) = (path.to_owned(), feed.name.clone());
                self.remeasurer.add(Incomplete { path, view, config: feed.config.clone(), format: feed.format });
            }
        }
    }

    /// Publishes that the frames of a shot were measured after it, or why not.
    fn publish_remeasured(&self, remeasured: &Remeasured) -> Result<(), Failure> {
        if remeasured.has_failed {
            log::warn!("not measured after the shot: {}", remeasured.text);
        }
        let kind = if remeasured.has_failed { EventKind::Lost } else { EventKind::Remeasured };
        self.publish_event(kind, &remeasured.text)
    }

    /// Waits for the shots that are measured after their recording.
    fn finish_remeasuring(&mut self) -> Result<(), Failure> {
        let mut remeasurer = std::mem::take(&mut self.remeasurer);
        let outcomes = remeasurer.finish(|| self.publish_status())?;
        outcomes.iter().try_for_each(|remeasured| self.publish_remeasured(remeasured))
    }

    /// Returns the number of lost frames in words: of the main camera, and of each other camera that lost any.
    fn describe_lost(&self, lost: &[u64]) -> String {
        let description = |(feed, lost): (&CameraFeed<'_>, &u64)| match feed.name.as_str() {
            "" => format!("{lost} frames"),
            name => format!("{lost} of {name}"),
        };
        let cameras = self.feeds.iter().zip(lost);
        cameras
            .filter(|(feed, lost)| feed.name.is_empty() || **lost > 0)
            .map(description)
            .collect::<Vec<_>>()
            .join(", ")
    }

    /// Publishes an event of the whole rig with this frame number, and the stamp of the main camera's newest written
    /// frame.
    fn publish_event_at(&self, kind: EventKind, frame: u64, text: &str) -> Result<(), Failure> {
        let feed = &self.feeds[0];
        Ok(feed.reporter.publish_event(kind, FrameStamp { sequence: frame, ..feed.newest }, text)?)
    }

    /// Publishes the status of every camera's recorder, if it is due or more frames were lost.
    fn publish_status(&mut self) -> Result<(), Failure> {
        let has_problem = self.pause.is_some() || self.storage.has_problem();
        let summary = self.counts();
        // Losses are published at once: if this process is killed, nobody else knows of them.
        let has_lost = summary.lost != self.published_losses;
        self.published_losses = summary.lost;
        for feed in &mut self.feeds {
            feed.reporter.set_state(u32::from(self.armed) | u32::from(has_problem) << 1);
            feed.reporter.set_queue(feed.held.len() as u64, feed.limits.ring_frames as u64);
            match has_lost {
                true => feed.reporter.publish_status(&summary, feed.newest)?,
                false => feed.reporter.publish_status_if_due(&summary, feed.newest)?,
            }
        }
        Ok(())
    }

    /// Returns the counts of frames and steps so far, with the losses of the open shot; without causes and recordings.
    fn counts(&self) -> Summary {
        let Summary { taken, given, lost, dropped, .. } = self.summary;
        let open = self.shot.iter().flat_map(|open| (0..self.feeds.len()).map(move |camera| open.lost(camera)));
        Summary { taken, given, lost: lost + open.sum::<u64>(), dropped, ..Summary::default() }
    }
}
