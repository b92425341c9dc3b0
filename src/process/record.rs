//! Topics to recordings.
//!
//! While armed it reads nothing: its queue on the ring *is* the pre-trigger
//! buffer, which costs no time and no copy. At a trigger it takes the whole queue
//! at once, holds the frames in place and writes them out one by one.

mod active;
mod failure;
mod feed;
mod matching;
mod retention;
mod span;

use super::action::{Actions, Cause};
use super::clock::{Every, Patience};
use super::conclude::Conclusions;
use super::reference;
use super::shot::{Shot, free_path, recording_info};
use super::stop::Stop;
use super::storage::{Storage, prepare_directory};
use super::summary::Summary;
use crate::bus::{ControlServer, Ear};
use crate::config::{Config, Record, TriggerMode};
use crate::image::Frame;
use crate::message::{Command, Event, EventKind, Reply, ReplyCode};
use crate::recording::{EventRow, RecordingInfo, ViewInfo};
use crate::trigger::Quiet;
use active::{Active, Window};
use feed::Feed;
pub use matching::{Matcher, Matching};
use retention::Retention;
use std::collections::VecDeque;
use std::time::Duration;

const WAIT: Duration = Duration::from_millis(2);
/// How often an armed recorder maps writers that appeared; it consumes nothing.
const GREET: Duration = Duration::from_millis(100);
/// How long the workers may be silent before the rows of their frames count as lost.
const SILENCE: Duration = Duration::from_secs(5);
/// How long the recording of a stream waits for the first frame of every camera.
const GATHER: Duration = Duration::from_secs(2);

/// Records shots (or the whole stream) until the stream ends.
///
/// A disk that is full, gone or read-only ends the recording, not the recorder: what was written stays, the loss is
/// told and counted, and the next shot is tried anew. `resumed` says that another recorder was there before and died.
///
/// # Errors
///
/// When the folder cannot be used from the start, or shared memory cannot be used.
pub fn run(config: &Config, resumed: bool, stop: &Stop) -> anyhow::Result<Summary> {
    let Some(record) = &config.record else {
        anyhow::bail!("{}: there is no [record] table, so there is nothing to record", config.origin);
    };
    if let Err(error) = prepare_directory(record) {
        if !resumed {
            return Err(error.into());
        }
        log::warn!("{error}");
    }
    let (first, bus) = Feed::open("", config, resumed)?;
    let mut feeds = vec![first];
    let mut buses = Vec::new();
    for view in &config.views {
        let (feed, bus) = Feed::open(&view.name, &view.config, resumed)?;
        feeds.push(feed);
        // It has the role for as long as the recorder lives.
        buses.push(bus);
    }
    let mut recorder = Recorder {
        control: bus.control_server()?,
        shot: None,
        storage: Storage::new(config, record, feeds.iter().map(|feed| (&feed.format, &feed.limits))),
        retention: Retention::new(record, &config.rig.name),
        pause: None,
        gather: None,
        failures: 0,
        armed: config.trigger.mode != TriggerMode::Off,
        wish: None,
        waiting: VecDeque::new(),
        greet: Every::new(GREET),
        quiet: Quiet::new(config.trigger.quiet_s),
        actions: Actions::new(config),
        conclusions: (!feeds[0].is_measured()).then(|| Conclusions::new(config)),
        summary: Summary::default(),
        feeds,
        config,
        record,
    };
    recorder.serve(&bus.ear("frames")?, stop)?;
    Ok(recorder.summary)
}

struct Recorder<'a> {
    /// One a camera, the first one first.
    feeds: Vec<Feed<'a>>,
    control: ControlServer,
    shot: Option<Active>,
    storage: Storage,
    retention: Retention,
    /// Since when a stream goes unrecorded because its recording failed.
    pause: Option<Patience>,
    /// Since when the first frames of a stream are waited for.
    gather: Option<Patience>,
    /// Recordings in a row that failed before a frame of them was safe.
    failures: u32,
    armed: bool,
    /// What was asked for during a shot: to be armed after it, or not.
    wish: Option<bool>,
    /// Shots that the camera's line began while another was written: first frame, its stamp, cause.
    waiting: VecDeque<(u64, u64, String)>,
    greet: Every,
    quiet: Quiet,
    actions: Actions,
    /// What the rig is doing, where no tracker tells it.
    conclusions: Option<Conclusions>,
    summary: Summary,
    config: &'a Config,
    record: &'a Record,
}

impl Recorder<'_> {
    fn serve(&mut self, ear: &Ear, stop: &Stop) -> anyhow::Result<()> {
        while !stop.requested() {
            self.attach()?;
            self.answer()?;
            for camera in 0..self.feeds.len() {
                let events = self.feeds[camera].stream.take();
                if let (0, Some(conclusions)) = (camera, &mut self.conclusions) {
                    conclusions.hear(&events, &self.feeds[0].reporter)?;
                }
                self.look_at(camera, &events)?;
            }
            let busy = self.advance()?;
            if self.is_over()? {
                break;
            }
            self.look_at_storage()?;
            while let Some(ended) = self.actions.ended() {
                self.feeds[0].reporter.action(&ended)?;
            }
            self.look_at_retention()?;
            self.tell()?;
            if !busy {
                ear.wait(WAIT);
            }
        }
        if let Some(active) = self.shot.take() {
            self.close(active)?;
        }
        for feed in &mut self.feeds {
            let end = feed.stream.end.unwrap_or(0);
            feed.reporter.progress(end, true)?;
        }
        for ended in self.actions.last() {
            self.feeds[0].reporter.action(&ended)?;
        }
        if let Some(mut conclusions) = self.conclusions.take() {
            // What it told itself of the last recording is part of the story.
            let feed = &mut self.feeds[0];
            feed.stream.update()?;
            conclusions.hear(&feed.stream.take(), &feed.reporter)?;
            conclusions.end(feed.newest, &feed.reporter)?;
        }
        let summary = &self.summary;
        self.feeds.iter_mut().try_for_each(|feed| feed.reporter.status_now(summary, feed.newest.0, feed.newest.1))?;
        Ok(())
    }

    /// Takes up the runs that were announced; the cameras of a rig start together, once all are prepared.
    fn attach(&mut self) -> anyhow::Result<()> {
        for camera in 0..self.feeds.len() {
            let feed = &mut self.feeds[camera];
            if !feed.stream.update()? {
                continue;
            }
            if camera == 0
                && !feed.stream.goes_on
                && let Some(active) = self.shot.take()
            {
                self.close(active)?;
            }
            let feed = &mut self.feeds[camera];
            if let (Some(active), false) = (&mut self.shot, feed.stream.goes_on) {
                active.courses[camera].drained = true;
                let end = active.shot.next_frame(camera);
                active.set_end(camera, end)?;
            }
            feed.attach();
        }
        if self.feeds.iter().all(Feed::is_prepared) {
            self.feeds.iter_mut().try_for_each(Feed::greet)?;
        }
        Ok(())
    }

    fn answer(&mut self) -> anyhow::Result<()> {
        let mut wanted = None;
        let (armed, busy) = (self.armed, self.shot.is_some());
        let off = self.config.trigger.mode == TriggerMode::Off;
        let line = self.config.trigger.mode == TriggerMode::Hardware;
        let recordings = self.summary.recordings.len() as u64;
        let (sequence, has_frames) = (self.feeds[0].newest.0, self.feeds[0].stream.first.is_some());
        self.control.answer(|command| {
            let code = match command {
                Some(Command::Status) => ReplyCode::Accepted,
                None => ReplyCode::Unknown,
                Some(_) if off => ReplyCode::NoTrigger,
                Some(Command::Trigger) if line => ReplyCode::Line,
                Some(Command::Trigger) if busy => ReplyCode::Busy,
                Some(Command::Trigger) if !armed => ReplyCode::NotArmed,
                Some(Command::Trigger) if !has_frames => ReplyCode::NoFrames,
                Some(command) => {
                    wanted = Some(command);
                    ReplyCode::Accepted
                }
            };
            Reply { code: code as u32, armed: u32::from(armed), recordings, sequence }
        })?;
        match wanted {
            Some(Command::Arm) => self.ask_to_arm(true),
            Some(Command::Disarm) => self.ask_to_arm(false),
            Some(Command::Trigger) => self.trigger(None, "software"),
            _ => Ok(()),
        }
    }

    /// What is asked for while a shot is written holds after it, whatever `rearm` says.
    fn ask_to_arm(&mut self, armed: bool) -> anyhow::Result<()> {
        if self.shot.is_some() {
            self.wish = Some(armed);
        }
        self.arm(armed)
    }

    fn arm(&mut self, armed: bool) -> anyhow::Result<()> {
        self.armed = armed;
        let (kind, text) = match (armed, self.shot.is_some()) {
            (true, false) => (EventKind::Armed, "armed"),
            (true, true) => (EventKind::Armed, "armed; a shot is being written"),
            (false, false) => (EventKind::Disarmed, "disarmed"),
            (false, true) => (EventKind::Disarmed, "disarmed; a shot is being written"),
        };
        self.event(kind, text)
    }

    /// Tells something of the rig as a whole.
    fn event(&self, kind: EventKind, text: &str) -> anyhow::Result<()> {
        let feed = &self.feeds[0];
        Ok(feed.reporter.event(kind, feed.newest.0, feed.newest.1, text)?)
    }

    /// Acts on triggers that others found, and keeps a shot's events with it.
    fn look_at(&mut self, camera: usize, events: &[Event]) -> anyhow::Result<()> {
        for event in events {
            self.feeds[camera].learn(event);
            let is_decided = camera == 0 && event.kind() == Some(EventKind::Decided);
            let text = event.text();
            let cause = text.split_once("; ").map_or(text.as_str(), |(what, _)| what);
            if is_decided && self.config.trigger.mode == TriggerMode::Hardware {
                // Whether it is armed is decided when its turn comes, so that it is not lost to the one before.
                self.waiting.push_back((event.sequence, event.stamp_ns, cause.to_owned()));
                self.next_line()?;
            } else if is_decided && self.armed && self.shot.is_none() && self.quiet.passes(event.stamp_ns) {
                self.trigger(Some(event.sequence), cause)?;
            }
            let prefix = self.feeds[camera].prefix();
            if let (Some(active), Some(kind)) = (&mut self.shot, event.kind()) {
                let text = format!("{prefix}frame {}: {}", event.sequence, event.text());
                let row = EventRow { stamp_ns: event.stamp_ns, kind: kind.word().into(), text };
                if let Err(error) = active.shot.event(&row) {
                    self.abandon(&error)?;
                }
            }
        }
        Ok(())
    }

    /// Goes on with the shot; `true` when there is more to do at once.
    fn advance(&mut self) -> anyhow::Result<bool> {
        let streams = self.config.trigger.mode == TriggerMode::Off;
        if streams && self.shot.is_none() && self.feeds.iter().any(|feed| feed.stream.first.is_some()) {
            if self.is_paused()? {
                return self.pass_by();
            }
            self.begin_stream()?;
        }
        if self.shot.is_none() {
            if self.greet.due() {
                for feed in &self.feeds {
                    feed.frames.greet();
                    feed.fields.greet();
                }
            }
            return Ok(false);
        }
        let mut goes_on = false;
        for camera in 0..self.feeds.len() {
            self.hold(camera)?;
            self.begin_take(camera)?;
            self.end_line(camera)?;
            let wrote = self.write_one(camera)?;
            self.take_steps(camera)?;
            goes_on |= wrote && !self.feeds[camera].held.is_empty();
        }
        self.close_if_complete()?;
        if !goes_on
            && let Some(active) = &mut self.shot
            && let Err(error) = active.shot.hand_over()
        {
            self.abandon(&error)?;
        }
        Ok(goes_on)
    }

    fn write_one(&mut self, camera: usize) -> anyhow::Result<bool> {
        let Some(active) = &mut self.shot else { return Ok(false) };
        let feed = &mut self.feeds[camera];
        // What lies beyond the end belongs to what comes after this shot.
        let end = active.courses[camera].end.unwrap_or(u64::MAX);
        let has_begun = active.shot.has_begun(camera);
        if !has_begun || feed.held.front().is_none_or(|sample| sample.header().sequence >= end) {
            return Ok(false);
        }
        let Some(sample) = feed.held.pop_front() else { return Ok(false) };
        let header = *sample.header();
        if let Some(meta) = header.meta()
            && header.sequence >= active.shot.next_frame(camera)
        {
            if let Err(error) = active.shot.frame(camera, &Frame { meta, bytes: sample.bytes() }) {
                self.abandon(&error)?;
                return Ok(true);
            }
            active.wrote(camera, header.stamp_ns);
            self.summary.taken += 1;
            feed.newest = (header.sequence, header.stamp_ns);
            if self.config.trigger.mode == TriggerMode::Off {
                feed.reporter.progress(header.sequence + 1, false)?;
            }
        }
        Ok(true)
    }

    fn take_steps(&mut self, camera: usize) -> anyhow::Result<()> {
        let Some(active) = &mut self.shot else { return Ok(()) };
        let follows = self.config.trigger.mode == TriggerMode::Hardware;
        let feed = &mut self.feeds[camera];
        // Before the first frame it is not known which steps belong to the shot; they wait in the queue.
        if !active.shot.has_begun(camera) {
            return Ok(());
        }
        let newest = feed.held.back().map_or(0, |sample| sample.header().sequence + 1);
        let seen = newest.max(active.shot.next_frame(camera));
        let mut early = std::mem::take(&mut feed.early).into_iter();
        while let Some((step, field)) = early.next().map_or_else(|| feed.next_step(), |step| Ok(Some(step)))? {
            // The next shot may begin with frames that were measured before this one was whole; that of a line even before
            // the end of this one was heard of.
            let is_later = match active.courses[camera].end {
                Some(end) => step.frame >= end,
                None => follows && step.frame >= seen,
            };
            if is_later {
                feed.early.push((step, field));
                continue;
            }
            match active.step((camera, feed.period_ns()), step, field) {
                Ok(true) => {
                    active.courses[camera].silence.renew();
                    self.summary.given += 1;
                }
                // Steps of what comes after the shot are no sign that its own will still come.
                Ok(false) => {}
                Err(error) => return self.abandon(&error),
            }
        }
        Ok(())
    }

    /// After a shot: waits for the next, or not.
    fn rearm(&mut self) -> anyhow::Result<()> {
        let wish = self.wish.take();
        match self.config.trigger.mode {
            TriggerMode::Off => Ok(()),
            _ => self.arm(wish.unwrap_or(self.config.trigger.rearm)),
        }
    }

    fn close(&mut self, active: Active) -> anyhow::Result<()> {
        let ends = active.ends();
        let unsafe_frames = active.shot.missing_before(ends[0]).max(1);
        let lost: Vec<u64> = (ends.iter().enumerate())
            .map(|(camera, end)| active.shot.lost(camera) + end.saturating_sub(active.shot.next_frame(camera)))
            .collect();
        let (mut shot, stamp_ns) = (active.shot, self.feeds[0].newest.1);
        let mut told = Ok(());
        for (feed, matcher) in self.feeds[1..].iter().zip(active.matchers) {
            let text = format!("{}: {}", feed.name, matcher.finish());
            feed.reporter.event(EventKind::Matched, feed.newest.0, feed.newest.1, &text)?;
            self.event(EventKind::Matched, &text)?;
            let kind = EventKind::Matched.word().into();
            told = told.and_then(|()| shot.event(&EventRow { stamp_ns, kind, text }));
        }
        let (finished, missing) = match told.and_then(|()| shot.finish(&ends)) {
            Ok(finished) => finished,
            Err(error) => return self.give_up(&error, unsafe_frames),
        };
        self.failures = 0;
        let all = lost.iter().sum::<u64>();
        self.summary.lost += all;
        self.summary.dropped += missing;
        if all + missing > 0 {
            let text = format!("{} and {missing} rows are missing in {}", self.told(&lost), finished.path.display());
            self.event_at(EventKind::Lost, ends[0], &text)?;
        }
        self.event_at(EventKind::Recorded, ends[0], &finished.path.display().to_string())?;
        self.retention.add(&finished.path);
        self.summary.recordings.push(finished.path);
        let told = self.retention.enforce(None);
        self.tell_removed(told)
    }

    /// How many frames of which camera.
    fn told(&self, lost: &[u64]) -> String {
        let of = |(feed, lost): (&Feed<'_>, &u64)| match feed.name.as_str() {
            "" => format!("{lost} frames"),
            name => format!("{lost} of {name}"),
        };
        let cameras = self.feeds.iter().zip(lost);
        cameras.filter(|(feed, lost)| feed.name.is_empty() || **lost > 0).map(of).collect::<Vec<_>>().join(", ")
    }

    fn event_at(&self, kind: EventKind, frame: u64, text: &str) -> anyhow::Result<()> {
        let feed = &self.feeds[0];
        Ok(feed.reporter.event(kind, frame, feed.newest.1, text)?)
    }

    fn tell(&mut self) -> anyhow::Result<()> {
        let is_troubled = self.pause.is_some() || self.storage.is_troubled();
        let summary = &self.summary;
        for feed in &mut self.feeds {
            feed.reporter.set_state(u32::from(self.armed) | u32::from(is_troubled) << 1);
            feed.reporter.set_queue(feed.held.len() as u64, feed.limits.ring_frames as u64);
            feed.reporter.status(summary, feed.newest.0, feed.newest.1)?;
        }
        Ok(())
    }
}
