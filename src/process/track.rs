//! Fields in any order to tracks, velocities and impacts in frame order.

use super::clock::{Patience, now};
use super::conclude::Conclusions;
use super::report::Reporter;
use super::resume::Resume;
use super::rig::{SUCCESSION, analysis_params, expected_format, learn_exposure, limits};
use super::stop::Stop;
use super::stream::Stream;
use super::summary::Summary;
use crate::bus::{Bell, Bus, BusError, FieldSubscriber, Limits, Publisher};
use crate::camera::StreamFormat;
use crate::config::{Config, TriggerMode};
use crate::message::{Event, EventKind, ImpactMessage, Role, TrackMessage, VelocityMessage};
use crate::results::{Alarm, AlarmKind};
use crate::track::OrderedTracker;
use crate::track::TrackerRows;
use std::collections::VecDeque;
use std::time::Duration;

const WAIT: Duration = Duration::from_millis(2);
/// How long a worker may be silent at the end of the stream before its frames count as lost.
const SILENCE: Duration = Duration::from_secs(5);

/// Tracks every body until the stream ends.
///
/// `resumed` is what a tracker which died had told of.
///
/// # Errors
///
/// When shared memory cannot be used.
pub fn run(config: &Config, resumed: Option<Resume>, stop: &Stop) -> anyhow::Result<Summary> {
    let format = expected_format(config)?;
    config.check_calibration(format.width_px, format.height_px)?;
    let limits = limits(config, &format);
    let bus = Bus::take_part(&config.rig.name, Role::Track.word(), SUCCESSION)?;
    let mut reporter = Reporter::new(&bus, &limits, Role::Track, 0)?;
    reporter.set_queue(0, limits.field_depth() as u64);
    let mut loop_ = Loop {
        fields: bus.field_subscriber(&limits)?,
        tracks: bus.publisher(&limits)?,
        velocities: bus.publisher(&limits)?,
        impacts: bus.publisher(&limits)?,
        bell: bus.bell("velocity")?,
        conclusions: Conclusions::new(config),
        ordered: None,
        config,
        format,
        reporter,
        summary: Summary::default(),
        resumed: resumed.map(|resume| resume.sequence),
        shots: VecDeque::new(),
        shot: None,
        out: 0,
        seen: 0,
        limits,
        newest: (0, 0),
    };
    let ear = bus.ear("field")?;
    let mut stream = Stream::new(&bus, &limits)?;
    while !stop.requested() {
        let begins = stream.update()?;
        let events = stream.take();
        loop_.conclusions.hear(&events, &loop_.reporter)?;
        if begins {
            loop_.attach(&stream)?;
        }
        loop_.hear(&events);
        let progressed = loop_.drain(&stream)?;
        loop_.end_shot(&stream)?;
        if let Some(end) = stream.end {
            loop_.end(&stream, end, stop)?;
            break;
        }
        loop_.conclusions.tell(loop_.newest, &loop_.reporter)?;
        loop_.reporter.status(&loop_.summary, loop_.newest.0, loop_.newest.1)?;
        if !progressed {
            ear.wait(WAIT);
        }
    }
    loop_.reporter.status_now(&loop_.summary, loop_.newest.0, loop_.newest.1)?;
    Ok(loop_.summary)
}

struct Loop<'a> {
    fields: FieldSubscriber,
    tracks: Publisher<TrackMessage>,
    velocities: Publisher<VelocityMessage>,
    impacts: Publisher<ImpactMessage>,
    bell: Bell,
    conclusions: Conclusions,
    config: &'a Config,
    format: StreamFormat,
    ordered: Option<OrderedTracker>,
    reporter: Reporter,
    summary: Summary,
    resumed: Option<u64>,
    /// First frames of shots to come, of a camera that waits for its line, and that of the shot at hand.
    shots: VecDeque<u64>,
    shot: Option<u64>,
    /// One past the last frame of a shot that was let out.
    out: u64,
    /// One past the newest frame of this run that was measured.
    seen: u64,
    limits: Limits,
    newest: (u64, u64),
}

impl Loop<'_> {
    fn attach(&mut self, stream: &Stream) -> Result<(), BusError> {
        // A camera process that died told no end: what is known of its run is let out before the next begins.
        self.let_out(self.seen)?;
        // Else the status would tell a frame of the run before as one of this.
        (self.seen, self.newest) = (0, (0, 0));
        self.shots.clear();
        (self.shot, self.out) = (None, 0);
        self.fields.greet();
        self.ordered = None;
        self.reporter.set_run(stream.run_id.unwrap_or(0));
        self.reporter.progress(u64::MAX, false)
    }

    /// Takes what has come; `true` when there was something.
    fn drain(&mut self, stream: &Stream) -> Result<bool, BusError> {
        let mut progressed = false;
        // Without the first frame's number it would not be known where the order begins.
        let Some(first) = stream.first else { return Ok(false) };
        while let Some((header, _field)) = self.fields.take()? {
            if header.run_id != self.reporter.run_id() {
                continue;
            }
            let Some(step) = header.step() else { continue };
            progressed = true;
            while self.shots.front().is_some_and(|first| step.frame >= *first) {
                // What was not measured of the shot before is given up: nothing leads from one to the next.
                self.shot = self.shots.pop_front();
                self.let_out(self.shot.unwrap_or(0))?;
                self.ordered = None;
            }
            if self.ordered.is_none() {
                learn_exposure(self.config, &mut self.format, header.exposure_ns);
                self.begin(self.shot.unwrap_or(first), step.frame);
            }
            self.seen = self.seen.max(step.frame + 1);
            if let Some(ordered) = &mut self.ordered {
                let (conclusions, came) = (&mut self.conclusions, now());
                let rows = std::mem::take(ordered.push_seen(step, |step| conclusions.see(step, came)));
                self.publish(&rows)?;
                // A decision is told before the next step is taken.
                self.conclusions.tell(self.newest, &self.reporter)?;
            }
        }
        Ok(progressed)
    }

    /// Takes note of the shots that a camera's line begins.
    fn hear(&mut self, events: &[Event]) {
        let run_id = self.reporter.run_id();
        let begins = |event: &&Event| event.kind() == Some(EventKind::Decided) && event.run_id == run_id;
        if self.config.trigger.mode == TriggerMode::Hardware {
            self.shots.extend(events.iter().filter(begins).map(|event| event.sequence));
        }
    }

    /// Lets out a shot that has ended with silence, once all of it was measured.
    fn end_shot(&mut self, stream: &Stream) -> Result<(), BusError> {
        let Some(end) = stream.silences.back().copied() else { return Ok(()) };
        let is_it = self.shot.is_some_and(|first| first < end);
        if !is_it || !self.ordered.as_ref().is_some_and(|ordered| ordered.has_all_before(end)) {
            return Ok(());
        }
        self.let_out(end)?;
        (self.ordered, self.out) = (None, end);
        Ok(())
    }

    /// Starts the order at the stream's first frame, or where one that died was taken over.
    fn begin(&mut self, first: u64, seen: u64) {
        let start = match self.resumed.take() {
            None => first,
            Some(told) => {
                self.summary.lost += seen.saturating_sub(told + 1);
                seen
            }
        };
        // A worker can be behind by no more than its queue holds.
        let patience_frames = self.limits.ring_frames as u64 + 512;
        let params = analysis_params(self.config, &self.format).1;
        self.ordered = Some(OrderedTracker::new(&params, start, patience_frames));
        self.conclusions.begin(self.config, self.format.frame_rate_hz, self.format.exposure_us);
    }

    /// Tells what is noticed of a collision while it lasts.
    fn alarm(&self, alarm: &Alarm) -> Result<(), BusError> {
        let name = self.config.bodies.get(alarm.body as usize).map_or("", |body| body.name.as_str());
        let ms = 1e3 * alarm.at_s.value;
        let (kind, text) = match alarm.kind {
            AlarmKind::Began => (EventKind::Contact, format!("{name} touches the surface since {ms:.3} ms")),
            AlarmKind::Turned => (EventKind::Deepest, format!("{name} was deepest at {ms:.3} ms")),
            AlarmKind::Withdrawn => (EventKind::Withdrawn, format!("{name} did not touch the surface after all")),
        };
        self.reporter.event(kind, alarm.frame, alarm.stamp_ns, &text)
    }

    fn publish(&mut self, rows: &TrackerRows) -> Result<(), BusError> {
        self.conclusions.rows(&rows.velocities);
        let run_id = self.reporter.run_id();
        for sample in &rows.tracks {
            self.tracks.send(&TrackMessage::new(sample, run_id))?;
            self.newest = (sample.frame, sample.stamp_ns);
        }
        for sample in &rows.velocities {
            self.velocities.send(&VelocityMessage::new(sample, run_id))?;
        }
        for alarm in &rows.alarms {
            self.alarm(alarm)?;
        }
        for impact in &rows.impacts {
            self.impacts.send(&ImpactMessage::new(impact, run_id))?;
        }
        if !rows.velocities.is_empty() {
            self.bell.ring();
        }
        self.summary.given += rows.velocities.len() as u64;
        if let Some(ordered) = &self.ordered {
            self.summary.taken = ordered.taken;
            self.summary.dropped = ordered.losses().1;
        }
        Ok(())
    }

    /// Publishes everything before frame `end`, with rows for what never came.
    fn let_out(&mut self, end: u64) -> Result<(), BusError> {
        let Some(ordered) = &mut self.ordered else { return Ok(()) };
        let rows = std::mem::take(ordered.finish(end));
        let (lost, late) = ordered.losses();
        self.publish(&rows)?;
        self.summary.lost += lost;
        self.summary.dropped = late;
        Ok(())
    }

    /// Waits for the last workers, then lets everything out that was held back.
    fn end(&mut self, stream: &Stream, end: u64, stop: &Stop) -> Result<(), BusError> {
        let mut patience = Patience::new(SILENCE);
        let first = stream.first.unwrap_or(end);
        while !stop.requested() && !patience.is_over() {
            if self.drain(stream)? {
                patience.renew();
            }
            let is_out = end <= first || self.out >= end;
            if is_out || self.ordered.as_ref().is_some_and(|ordered| ordered.has_all_before(end)) {
                break;
            }
            self.reporter.status(&self.summary, self.newest.0, self.newest.1)?;
            std::thread::sleep(WAIT);
        }
        if self.ordered.is_none() && end > first.max(self.out) {
            let first = self.shots.pop_front().or(self.shot).unwrap_or(first);
            self.begin(first, first);
        }
        self.let_out(end)?;
        self.conclusions.end(self.newest, &self.reporter)?;
        self.reporter.event(EventKind::Tracked, end, self.newest.1, "every result was published")?;
        self.reporter.progress(end, true)
    }
}
