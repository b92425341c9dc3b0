//! Tracking: from fields in any order to tracks, velocities and impacts in frame order.

use super::clock::{Timeout, now};
use super::frame_stamp::FrameStamp;
use super::launch::Launch;
use super::live_trigger::LiveTrigger;
use super::readers::Readers;
use super::resume::NewestFrameFile;
use super::setup::{SUCCESSION_TIMEOUT, analysis_params, expected_format, limits, update_exposure};
use super::status_reporter::StatusReporter;
use super::stop::Stop;
use super::stream_state::StreamState;
use super::summary::Summary;
use super::waiting::Waiting;
use crate::bus::{Bus, BusError, FieldSubscriber, Limits, Publisher, TopicNotifier};
use crate::camera::StreamFormat;
use crate::config::{Config, TriggerMode};
use crate::failure::Failure;
use crate::message::{Event, EventKind, ImpactMessage, Role, TrackMessage, VelocityMessage};
use crate::results::{Alarm, AlarmKind, BodyStep};
use crate::track::{Losses, OrderedTracker, TrackerRows};
use std::collections::VecDeque;
use std::time::Duration;

/// Interval of looking for the last steps of a run or stream.
const WAIT: Duration = Duration::from_millis(2);
/// Maximum wait for the last results of a run whose camera process died. Its successor waits longer for the tracker.
const LAST_STEPS_TIMEOUT: Duration = Duration::from_secs(10);
/// Time without results at the end of the stream after which frames count as lost.
const SILENCE: Duration = Duration::from_secs(5);

/// Tracks every body until the stream ends.
///
/// # Errors
///
/// If shared memory cannot be used.
pub fn run(config: &Config, launch: &Launch, stop: &Stop) -> Result<Summary, Failure> {
    let format = expected_format(config)?;
    config.check_calibration(format.width_px, format.height_px)?;
    let limits = limits(config, &format);
    let bus = Bus::join_as(&config.rig.name, Role::Track.as_str(), SUCCESSION_TIMEOUT, launch.domain.as_ref())?;
    let (reached, previous) = NewestFrameFile::open(&bus.private_file(Role::Track.as_str()))?;
    let previous = previous.filter(|_| launch.is_restart);
    let mut reporter = StatusReporter::new(&bus, &limits, Role::Track, 0)?;
    reporter.set_queue(0, limits.field_depth() as u64);
    if config.camera.has_present_stamps() {
        reporter.set_live_rows();
    }
    let mut loop_ = Loop {
        fields: bus.field_subscriber(&limits)?,
        tracks: bus.publisher(&limits)?,
        velocities: bus.publisher(&limits)?,
        impacts: bus.publisher(&limits)?,
        notifier: bus.notifier("velocity")?,
        live_trigger: LiveTrigger::new(config),
        workers: Readers::workers(&bus, &limits)?,
        ordered: None,
        config,
        format,
        reporter,
        summary: Summary::default(),
        before: Losses::default(),
        resumed: previous.map(|(resume, _)| resume.sequence),
        reached,
        shots: VecDeque::new(),
        shot: None,
        published_end: 0,
        start: 0,
        measured: 0,
        limits,
        newest: FrameStamp::default(),
    };
    let waiting = Waiting::new(bus.notification_subscriber("field")?, config.workers.mode);
    let mut stream = StreamState::new(&bus, &limits)?;
    bus.reserve()?;
    while !stop.requested() {
        let begins = stream.update()?;
        let events = stream.take_events();
        loop_.live_trigger.handle_events(&events, &loop_.reporter)?;
        if begins {
            loop_.attach(&stream, stop)?;
        }
        loop_.note_shots(&events);
        let progressed = loop_.drain(stream.first)?;
        loop_.end_shot(&stream)?;
        if let Some(end) = stream.end {
            loop_.end(&stream, end, stop)?;
            break;
        }
        loop_.live_trigger.publish(loop_.newest, &loop_.reporter)?;
        loop_.reporter.publish_status_if_due(&loop_.summary, loop_.newest)?;
        if !progressed {
            waiting.wait();
        }
    }
    loop_.reporter.publish_status(&loop_.summary, loop_.newest)?;
    Ok(loop_.summary)
}

/// The main loop of tracking.
struct Loop<'a> {
    fields: FieldSubscriber,
    tracks: Publisher<TrackMessage>,
    velocities: Publisher<VelocityMessage>,
    impacts: Publisher<ImpactMessage>,
    notifier: TopicNotifier,
    live_trigger: LiveTrigger,
    workers: Readers,
    config: &'a Config,
    format: StreamFormat,
    /// The tracker of the current run or shot, once its first step has come.
    ordered: Option<OrderedTracker>,
    reporter: StatusReporter,
    summary: Summary,
    /// The losses of the trackers before the current one.
    before: Losses,
    /// The newest frame of a dead predecessor.
    resumed: Option<u64>,
    /// The newest published frame, for a successor.
    reached: NewestFrameFile,
    /// First frames of the coming hardware-triggered shots.
    shots: VecDeque<u64>,
    /// First frame of the current hardware-triggered shot.
    shot: Option<u64>,
    /// One past the last frame of a shot that was published.
    published_end: u64,
    /// First frame of the current tracker. Earlier frames without rows are counted already.
    start: u64,
    /// One past the newest measured frame of this run.
    measured: u64,
    limits: Limits,
    /// The newest frame whose rows were published.
    newest: FrameStamp,
}

impl Loop<'_> {
    /// Publishes the rest of the previous run, and starts with a newly announced one.
    fn attach(&mut self, stream: &StreamState, stop: &Stop) -> Result<(), BusError> {
        // A dead camera process announced no end: all that it left is published before the next run begins.
        if stream.continues {
            self.take_last_steps(stream.run_id.unwrap_or(0), stop)?;
        }
        self.flush(self.measured)?;
        // Otherwise the status would show a frame of the previous run.
        (self.measured, self.newest) = (0, FrameStamp::default());
        self.shots.clear();
        (self.shot, self.published_end) = (None, 0);
        self.fields.update_connections();
        self.reporter.set_run(stream.run_id.unwrap_or(0));
        self.reporter.publish_progress(u64::MAX)
    }

    /// Tracks the last steps of the run before `next_run`. Its workers publish them before they attach to that.
    fn take_last_steps(&mut self, next_run: u64, stop: &Stop) -> Result<(), BusError> {
        let timeout = Timeout::new(LAST_STEPS_TIMEOUT);
        while !stop.requested() && !timeout.has_expired() && !self.workers.all_attached(next_run)? {
            self.drain(None)?;
            self.reporter.publish_status_if_due(&self.summary, self.newest)?;
            std::thread::sleep(WAIT);
        }
        self.drain(None).map(|_| ())
    }

    /// Tracks the available steps and publishes the rows that become final; returns whether there were any steps.
    ///
    /// The order starts at the first frame of the run. While its number is not known (`None`), a new order waits.
    fn drain(&mut self, first: Option<u64>) -> Result<bool, BusError> {
        let mut progressed = false;
        if self.ordered.is_none() && first.is_none() {
            return Ok(false);
        }
        while let Some((header, _field)) = self.fields.take()? {
            if header.run_id != self.reporter.run_id() {
                continue;
            }
            let Some(step) = header.step() else { continue };
            progressed = true;
            while self.shots.front().is_some_and(|first| step.frame >= *first) {
                // Missing results of the previous shot are given up: no track crosses to the next shot.
                self.shot = self.shots.pop_front();
                self.flush(self.shot.unwrap_or(0))?;
            }
            if self.ordered.is_none() {
                update_exposure(self.config, &mut self.format, header.exposure_ns);
                self.begin_tracking(self.shot.or(first).unwrap_or(step.frame), step.frame);
            }
            if step.frame < self.start {
                continue;
            }
            self.measured = self.measured.max(step.frame + 1);
            if let Some(ordered) = &mut self.ordered {
                let (live_trigger, arrival) = (&mut self.live_trigger, now());
                let observe = |step: &BodyStep| live_trigger.observe(step, arrival);
                let rows = match header.skipped_frames {
                    1 => ordered.skip_observed(step.frame, step.stamp_ns, observe),
                    _ => ordered.push_observed(step, observe),
                };
                let rows = std::mem::take(rows);
                self.publish(&rows)?;
                // A decision is published before the next step is taken.
                self.live_trigger.publish(self.newest, &self.reporter)?;
            }
        }
        Ok(progressed)
    }

    /// Records the shots that a hardware trigger begins.
    fn note_shots(&mut self, events: &[Event]) {
        let run_id = self.reporter.run_id();
        let begins = |event: &&Event| event.kind() == Some(EventKind::Decided) && event.run_id == run_id;
        if self.config.trigger.mode == TriggerMode::Hardware {
            self.shots.extend(events.iter().filter(begins).map(|event| event.sequence));
        }
    }

    /// Publishes a shot that has ended with silence, once all of it was measured.
    fn end_shot(&mut self, stream: &StreamState) -> Result<(), BusError> {
        let Some(end) = stream.silences.back().copied() else { return Ok(()) };
        let is_it = self.shot.is_some_and(|first| first < end);
        if !is_it || !self.ordered.as_ref().is_some_and(|ordered| ordered.has_all_before(end)) {
            return Ok(());
        }
        self.flush(end)?;
        self.published_end = end;
        Ok(())
    }

    /// Starts a tracker at frame `first`. After the death of a predecessor it starts at `seen`, the first frame whose
    /// step has come, and the frames between are counted as lost.
    fn begin_tracking(&mut self, first: u64, seen: u64) {
        let start = match self.resumed.take() {
            None => first,
            Some(reached) => {
                self.before.lost += seen.saturating_sub(reached + 1);
                self.summary.lost = self.before.lost;
                seen
            }
        };
        self.start = start;
        // A worker can be behind by no more than its queue holds.
        let max_delay_frames = self.limits.ring_frames as u64 + 512;
        let params = analysis_params(self.config, &self.format).1;
        self.ordered = Some(OrderedTracker::new(&params, start, max_delay_frames));
        self.live_trigger.begin_stream(self.config, self.format.frame_rate_hz, self.format.exposure_us);
    }

    /// Publishes a change of a collision while it lasts: contact, deepest position, or its withdrawal.
    fn publish_alarm(&self, alarm: &Alarm) -> Result<(), BusError> {
        let name = self.config.bodies.get(alarm.body as usize).map_or("", |body| body.name.as_str());
        let ms = 1e3 * alarm.at_s.value;
        let (kind, text) = match alarm.kind {
            AlarmKind::Began => (EventKind::Contact, format!("{name}: contact since {ms:.3} ms")),
            AlarmKind::Turned => (EventKind::Deepest, format!("{name}: deepest at {ms:.3} ms")),
            AlarmKind::Withdrawn => (EventKind::Withdrawn, format!("{name}: contact withdrawn")),
        };
        self.reporter.publish_event(kind, FrameStamp { sequence: alarm.frame, stamp_ns: alarm.stamp_ns }, &text)
    }

    /// Publishes rows that became final, and updates the rig's state.
    fn publish(&mut self, rows: &TrackerRows) -> Result<(), BusError> {
        self.live_trigger.add_rows(&rows.velocities);
        let run_id = self.reporter.run_id();
        for sample in &rows.tracks {
            self.tracks.send(&TrackMessage::new(sample, run_id))?;
            self.newest = FrameStamp { sequence: sample.frame, stamp_ns: sample.stamp_ns };
        }
        for sample in &rows.velocities {
            self.velocities.send(&VelocityMessage::new(sample, run_id))?;
            self.reporter.add_row(sample.stamp_ns);
        }
        for alarm in &rows.alarms {
            self.publish_alarm(alarm)?;
        }
        for impact in &rows.impacts {
            self.impacts.send(&ImpactMessage::new(impact, run_id))?;
        }
        if !rows.velocities.is_empty() {
            self.reached.save(self.newest, 0);
            self.notifier.notify();
        }
        self.summary.given += rows.velocities.len() as u64;
        if let Some(ordered) = &self.ordered {
            let Losses { lost, late } = ordered.losses();
            self.summary.taken = ordered.taken;
            (self.summary.lost, self.summary.dropped) = (self.before.lost + lost, self.before.late + late);
        }
        Ok(())
    }

    /// Publishes everything before frame `end`, with rows for missing results, and ends its tracker.
    fn flush(&mut self, end: u64) -> Result<(), BusError> {
        let Some(ordered) = &mut self.ordered else { return Ok(()) };
        let rows = std::mem::take(ordered.finish(end));
        self.publish(&rows)?;
        self.ordered = None;
        self.before = Losses { lost: self.summary.lost, late: self.summary.dropped };
        Ok(())
    }

    /// Tracks the steps up to frame `end` (one past the last), until none has come for [`SILENCE`]. Then publishes all
    /// that was held back, and that the tracker is done.
    fn end(&mut self, stream: &StreamState, end: u64, stop: &Stop) -> Result<(), BusError> {
        let mut silence = Timeout::new(SILENCE);
        let first = stream.first.unwrap_or(end);
        while !stop.requested() && !silence.has_expired() {
            if self.drain(stream.first)? {
                silence.renew();
            }
            let is_published = end <= first || self.published_end >= end;
            if is_published || self.ordered.as_ref().is_some_and(|ordered| ordered.has_all_before(end)) {
                break;
            }
            self.reporter.publish_status_if_due(&self.summary, self.newest)?;
            std::thread::sleep(WAIT);
        }
        if self.ordered.is_none() && end > first.max(self.published_end) {
            let first = self.shots.pop_front().or(self.shot).unwrap_or(first);
            self.begin_tracking(first, first);
        }
        self.flush(end)?;
        self.live_trigger.end_stream(self.newest, &self.reporter)?;
        let text = match self.reporter.row_latencies() {
            None => "every result was published".to_owned(),
            Some(latencies) => format!("every result was published; from a frame to its velocity: {latencies}"),
        };
        self.reporter.publish_event(EventKind::Tracked, FrameStamp { sequence: end, ..self.newest }, &text)?;
        self.reporter.publish_done(end)
    }
}
