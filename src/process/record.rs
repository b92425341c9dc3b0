//! Topics to recordings.
//!
//! While armed it reads nothing: its queue on the ring *is* the pre-trigger
//! buffer, which costs no time and no copy. At a trigger it takes the whole queue
//! at once, holds the frames in place and writes them out one by one.

mod failure;
mod retention;

use super::action::{Actions, Cause};
use super::clock::{Every, Patience};
use super::reference;
use super::report::Reporter;
use super::rig::{SUCCESSION, analysis_params, expected_format, learn_exposure, limits, truth_world};
use super::shot::{Extent, Shot, free_path, recording_info};
use super::stop::Stop;
use super::storage::{Storage, prepare_directory};
use super::stream::Stream;
use super::summary::Summary;
use crate::bus::{Bus, ControlServer, Ear, FieldSubscriber, FrameSample, FrameSubscriber, Limits};
use crate::camera::{CameraIdentity, StreamFormat};
use crate::config::{Config, Record, TriggerMode};
use crate::image::Frame;
use crate::measure::TrackerParams;
use crate::message::{Command, Event, EventKind, Reply, ReplyCode, Role};
use crate::recording::EventRow;
use crate::trigger::Quiet;
use retention::Retention;
use std::collections::VecDeque;
use std::time::Duration;

const WAIT: Duration = Duration::from_millis(2);
/// How often an armed recorder maps writers that appeared; it consumes nothing.
const GREET: Duration = Duration::from_millis(100);
/// How long the workers may be silent before the rows of their frames count as lost.
const SILENCE: Duration = Duration::from_secs(5);

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
    let format = expected_format(config)?;
    config.check_ring(format.slot_bytes(), format.frame_rate_hz)?;
    let limits = limits(config, &format);
    let bus = Bus::take_part(&config.rig.name, Role::Record.word(), SUCCESSION)?;
    let mut recorder = Recorder {
        frames: bus.frame_subscriber(&limits)?,
        fields: bus.field_subscriber(&limits)?,
        control: bus.control_server()?,
        reporter: Reporter::new(&bus, &limits, Role::Record, 0)?,
        params: analysis_params(config, &format).1,
        held: VecDeque::new(),
        shot: None,
        storage: Storage::new(config, record, &format, &limits),
        retention: Retention::new(record, &config.rig.name),
        pause: None,
        failures: 0,
        armed: config.trigger.mode != TriggerMode::Off,
        greet: Every::new(GREET),
        quiet: Quiet::new(config.trigger.quiet_s),
        actions: Actions::new(config),
        summary: Summary::default(),
        camera: CameraIdentity::default(),
        newest: (0, 0),
        config,
        record,
        format,
        limits,
        resumed,
    };
    let ear = bus.ear("frames")?;
    let stream = Stream::new(&bus, &limits)?;
    recorder.serve(stream, &ear, stop)?;
    Ok(recorder.summary)
}

struct Recorder<'a> {
    frames: FrameSubscriber,
    fields: FieldSubscriber,
    control: ControlServer,
    reporter: Reporter,
    params: TrackerParams,
    held: VecDeque<FrameSample>,
    shot: Option<Active>,
    storage: Storage,
    retention: Retention,
    /// Since when a stream goes unrecorded because its recording failed.
    pause: Option<Patience>,
    /// Recordings in a row that failed before a frame of them was safe.
    failures: u32,
    armed: bool,
    greet: Every,
    quiet: Quiet,
    actions: Actions,
    summary: Summary,
    camera: CameraIdentity,
    newest: (u64, u64),
    config: &'a Config,
    record: &'a Record,
    format: StreamFormat,
    limits: Limits,
    resumed: bool,
}

/// A shot under way.
struct Active {
    shot: Shot,
    /// One past its last frame, once that is known.
    end: Option<u64>,
    /// Since when no step has come.
    silence: Patience,
    /// No more frames will come.
    drained: bool,
}

impl Recorder<'_> {
    fn serve(&mut self, mut stream: Stream, ear: &Ear, stop: &Stop) -> anyhow::Result<()> {
        while !stop.requested() {
            if stream.update()? {
                self.attach(&stream)?;
            }
            let events = stream.take();
            self.answer(stream.first.is_some())?;
            self.look_at(&events)?;
            let ended = stream.end;
            let busy = self.advance(&stream)?;
            if let Some(end) = ended
                && self.end(end)?
            {
                break;
            }
            self.look_at_storage()?;
            while let Some(ended) = self.actions.ended() {
                self.reporter.action(&ended)?;
            }
            self.look_at_retention()?;
            self.tell()?;
            if !busy {
                ear.wait(WAIT);
            }
        }
        if let Some(active) = self.shot.take() {
            let end = active.end.unwrap_or(active.shot.next_frame());
            self.close(active, end)?;
        }
        self.reporter.progress(stream.end.unwrap_or(0), true)?;
        for ended in self.actions.last() {
            self.reporter.action(&ended)?;
        }
        self.reporter.status_now(&self.summary, self.newest.0, self.newest.1)?;
        Ok(())
    }

    fn attach(&mut self, stream: &Stream) -> anyhow::Result<()> {
        if let Some(active) = self.shot.take() {
            let end = active.shot.next_frame();
            self.close(active, end)?;
        }
        self.held.clear();
        // Only the run it was started into has a predecessor's part.
        self.resumed &= self.reporter.run_id() == 0;
        self.frames.greet();
        self.fields.greet();
        self.reporter.set_run(stream.run_id.unwrap_or(0));
        let paced = self.config.trigger.mode == TriggerMode::Off && !self.resumed;
        Ok(self.reporter.progress(if paced { 0 } else { u64::MAX }, false)?)
    }

    fn answer(&mut self, has_frames: bool) -> anyhow::Result<()> {
        let mut wanted = None;
        let (armed, busy) = (self.armed, self.shot.is_some());
        let off = self.config.trigger.mode == TriggerMode::Off;
        let recordings = self.summary.recordings.len() as u64;
        let sequence = self.newest.0;
        self.control.answer(|command| {
            let code = match command {
                Some(Command::Status) => ReplyCode::Accepted,
                None => ReplyCode::Unknown,
                Some(_) if off => ReplyCode::NoTrigger,
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
            Some(Command::Arm) => self.arm(true),
            Some(Command::Disarm) => self.arm(false),
            Some(Command::Trigger) => self.trigger(None, "software"),
            _ => Ok(()),
        }
    }

    fn arm(&mut self, armed: bool) -> anyhow::Result<()> {
        self.armed = armed;
        let (kind, text) = if armed { (EventKind::Armed, "armed") } else { (EventKind::Disarmed, "disarmed") };
        Ok(self.reporter.event(kind, self.newest.0, self.newest.1, text)?)
    }

    /// Acts on triggers that others found, and keeps a shot's events with it.
    fn look_at(&mut self, events: &[Event]) -> anyhow::Result<()> {
        for event in events {
            match event.kind() {
                Some(EventKind::Prepared) => {
                    let text = event.text();
                    let (model, serial) = text.split_once('\n').unwrap_or((&text, ""));
                    self.camera = CameraIdentity { model: model.to_owned(), serial: serial.to_owned() };
                }
                Some(EventKind::Decided) if self.armed && self.shot.is_none() && self.quiet.passes(event.stamp_ns) => {
                    let text = event.text();
                    self.trigger(Some(event.sequence), text.split_once("; ").map_or(text.as_str(), |(what, _)| what))?;
                }
                _ => {}
            }
            if let (Some(active), Some(kind)) = (&mut self.shot, event.kind()) {
                let text = format!("frame {}: {}", event.sequence, event.text());
                let row = EventRow { stamp_ns: event.stamp_ns, kind: kind.word().into(), text };
                if let Err(error) = active.shot.event(&row) {
                    self.abandon(&error)?;
                }
            }
        }
        Ok(())
    }

    /// Takes the whole queue as it stands and starts a shot around frame `at` (the newest when `None`).
    fn trigger(&mut self, at: Option<u64>, cause: &str) -> anyhow::Result<()> {
        self.hold(self.limits.ring_frames + self.limits.held_frames - 1)?;
        let (Some(oldest), Some(newest)) = (self.held.front(), self.held.back()) else {
            return Ok(());
        };
        let (oldest, stamp_ns) = (oldest.header().sequence, newest.header().stamp_ns);
        let at = at.unwrap_or(newest.header().sequence);
        let block = u64::from(self.config.workers.block_frames);
        let pre = self.config.pre_trigger_frames(self.format.frame_rate_hz);
        let post = (self.config.trigger.post_s * self.format.frame_rate_hz).ceil() as u64;
        // Blocks are measured on their own, so a recording that begins with a block gives the same numbers again.
        let wanted = at.saturating_sub(pre) / block * block;
        let first = if wanted >= oldest { wanted } else { oldest.next_multiple_of(block) };
        self.held.retain(|sample| sample.header().sequence >= first);
        // A trigger within the stream's first block has its first frame still to come.
        let start_ns = self.held.front().map_or(stamp_ns, |sample| sample.header().stamp_ns);
        self.reporter.event(EventKind::Triggered, at, stamp_ns, cause)?;
        self.actions.fire(&Cause { frame: at, stamp_ns, text: cause.to_owned() });
        self.begin(first, Some((at + post).max(first)), start_ns, &format!("{cause} at frame {at}"))
    }

    fn begin(&mut self, first: u64, last: Option<u64>, stamp_ns: u64, cause: &str) -> anyhow::Result<()> {
        let path = free_path(&self.record.directory, &self.config.rig.name, stamp_ns);
        let mut info = recording_info(self.config, &self.format, &self.camera, cause);
        info.attachments.extend(reference::kept(self.config).map(reference::attached));
        let patience_frames = (self.limits.ring_frames + self.limits.held_frames) as u64 + 512;
        let extent = Extent { first, last, patience_frames };
        let truth = truth_world(self.config)?;
        // The folder may have gone since the last shot.
        let created = prepare_directory(self.record)
            .and_then(|()| Shot::create(&path, self.config, &info, &self.params, extent))
            .and_then(|mut shot| shot.set_truth(truth).map(|()| shot));
        let end = last.map(|last| last + 1);
        match created {
            Ok(shot) => self.shot = Some(Active { shot, end, silence: Patience::new(SILENCE), drained: false }),
            // Of a stream, the frames that pass by unrecorded are counted one by one.
            Err(error) => {
                self.failures += 1;
                self.give_up(&error, end.map_or(0, |end| end - first))?;
                self.rearm()?;
            }
        }
        Ok(())
    }

    /// Takes the frames of this shot out of the queue without writing them, so that the camera cannot overwrite them.
    ///
    /// Beyond `most` held frames they stay in the queue: what it cannot keep is this recorder's loss, where a ring held
    /// as a whole would leave the camera no slot.
    fn hold(&mut self, most: usize) -> anyhow::Result<()> {
        let end = self.shot.as_ref().and_then(|active| active.end).unwrap_or(u64::MAX);
        let is_whole =
            |held: &VecDeque<FrameSample>| held.back().is_some_and(|newest| newest.header().sequence + 1 >= end);
        while self.held.len() < most && !is_whole(&self.held) {
            let Some(sample) = self.frames.take()? else { break };
            if sample.header().run_id == self.reporter.run_id() {
                if learn_exposure(self.config, &mut self.format, sample.header().exposure_ns) {
                    self.params = analysis_params(self.config, &self.format).1;
                }
                self.held.push_back(sample);
            }
        }
        Ok(())
    }

    /// Goes on with the shot; `true` when there is more to do at once.
    fn advance(&mut self, stream: &Stream) -> anyhow::Result<bool> {
        if self.config.trigger.mode == TriggerMode::Off && self.shot.is_none() && stream.first.is_some() {
            if self.is_paused()? {
                return self.pass_by();
            }
            self.begin_stream(stream)?;
        }
        if self.shot.is_none() {
            if self.greet.due() {
                self.frames.greet();
                self.fields.greet();
            }
            return Ok(false);
        }
        self.hold(self.limits.held_frames)?;
        let wrote = self.write_one()?;
        self.take_steps()?;
        self.close_if_complete()?;
        let goes_on = wrote && !self.held.is_empty();
        if !goes_on
            && let Some(active) = &mut self.shot
            && let Err(error) = active.shot.hand_over()
        {
            self.abandon(&error)?;
        }
        Ok(goes_on)
    }

    fn begin_stream(&mut self, stream: &Stream) -> anyhow::Result<()> {
        self.hold(self.limits.held_frames)?;
        let block = u64::from(self.config.workers.block_frames);
        let Some(sample) = self.held.front() else { return Ok(()) };
        let (seen, stamp_ns) = (sample.header().sequence, sample.header().stamp_ns);
        let first = if self.resumed { seen.next_multiple_of(block) } else { stream.first.unwrap_or(seen) };
        self.begin(first, None, stamp_ns, "none: the whole stream")?;
        if self.shot.is_some() {
            self.summary.lost += first.saturating_sub(seen);
        }
        Ok(())
    }

    fn write_one(&mut self) -> anyhow::Result<bool> {
        let Some(active) = &mut self.shot else { return Ok(false) };
        // What lies beyond the end belongs to what comes after this shot.
        let end = active.end.unwrap_or(u64::MAX);
        if self.held.front().is_none_or(|sample| sample.header().sequence >= end) {
            return Ok(false);
        }
        let Some(sample) = self.held.pop_front() else { return Ok(false) };
        let header = *sample.header();
        if let Some(meta) = header.meta()
            && header.sequence >= active.shot.next_frame()
        {
            if let Err(error) = active.shot.frame(&Frame { meta, bytes: sample.bytes() }) {
                self.abandon(&error)?;
                return Ok(true);
            }
            self.summary.taken += 1;
            self.newest = (header.sequence, header.stamp_ns);
            if self.config.trigger.mode == TriggerMode::Off {
                self.reporter.progress(header.sequence + 1, false)?;
            }
        }
        Ok(true)
    }

    fn take_steps(&mut self) -> anyhow::Result<()> {
        let Some(active) = &mut self.shot else { return Ok(()) };
        while let Some((header, field)) = self.fields.take()? {
            if header.run_id != self.reporter.run_id() {
                continue;
            }
            // Steps of what comes after the shot are no sign that its own will still come.
            let Some(step) = header.step() else { continue };
            match active.shot.step(step, field) {
                Ok(true) => {
                    active.silence.renew();
                    self.summary.given += 1;
                }
                Ok(false) => {}
                Err(error) => return self.abandon(&error),
            }
        }
        Ok(())
    }

    fn close_if_complete(&mut self) -> anyhow::Result<()> {
        let complete = self.shot.as_ref().is_some_and(|active| {
            let Some(end) = active.end else { return false };
            let passed = self.held.front().is_some_and(|sample| sample.header().sequence >= end);
            let whole = active.shot.next_frame() >= end || passed || active.drained;
            whole && (active.shot.has_steps_before(end) || active.silence.is_over())
        });
        if complete
            && let Some(active) = self.shot.take()
            && let Some(end) = active.end
        {
            self.close(active, end)?;
            self.rearm()?;
        }
        Ok(())
    }

    /// After a shot: waits for the next, or not.
    fn rearm(&mut self) -> anyhow::Result<()> {
        match self.config.trigger.mode {
            TriggerMode::Off => Ok(()),
            _ => self.arm(self.config.trigger.rearm),
        }
    }

    fn close(&mut self, active: Active, end: u64) -> anyhow::Result<()> {
        let lost = active.shot.lost + end.saturating_sub(active.shot.next_frame());
        let unsafe_frames = active.shot.missing_before(end).max(1);
        let (finished, missing) = match active.shot.finish(end) {
            Ok(finished) => finished,
            Err(error) => return self.give_up(&error, unsafe_frames),
        };
        self.failures = 0;
        self.summary.lost += lost;
        self.summary.dropped += missing;
        if lost + missing > 0 {
            let text = format!("{lost} frames and {missing} rows are missing in {}", finished.path.display());
            self.reporter.event(EventKind::Lost, end, self.newest.1, &text)?;
        }
        self.reporter.event(EventKind::Recorded, end, self.newest.1, &finished.path.display().to_string())?;
        self.retention.add(&finished.path);
        self.summary.recordings.push(finished.path);
        let told = self.retention.enforce(None);
        self.tell_removed(told)
    }

    /// The camera stopped before frame `end`; `true` when nothing is left to do.
    fn end(&mut self, end: u64) -> anyhow::Result<bool> {
        self.hold(self.limits.held_frames)?;
        let Some(active) = &mut self.shot else {
            return Ok(self.config.trigger.mode != TriggerMode::Off || self.held.is_empty());
        };
        if self.held.is_empty() {
            active.end = Some(active.end.map_or(end, |wanted| wanted.min(end)));
            active.drained = true;
            self.close_if_complete()?;
        }
        Ok(self.shot.is_none())
    }

    fn tell(&mut self) -> anyhow::Result<()> {
        let is_troubled = self.pause.is_some() || self.storage.is_troubled();
        self.reporter.set_state(u32::from(self.armed) | u32::from(is_troubled) << 1);
        self.reporter.set_queue(self.held.len() as u64, self.limits.ring_frames as u64);
        Ok(self.reporter.status(&self.summary, self.newest.0, self.newest.1)?)
    }
}
