//! Correlation: from blocks of frames to displacement fields.

mod backlog;
mod processor;
mod thinning;

use super::clock::{PeriodicTimer, Timeout, now};
use super::frame_stamp::FrameStamp;
use super::launch::Launch;
use super::reference_picture;
use super::setup::{SUCCESSION_TIMEOUT, analysis_params, expected_format, limits};
use super::status_reporter::StatusReporter;
use super::stop::Stop;
use super::stream_state::StreamState;
use super::summary::Summary;
use super::waiting::Waiting;
use crate::bus::{Bus, BusError, FieldPublisher, FrameSubscriber, Limits, Subscriber, TopicNotifier};
use crate::camera::StreamFormat;
use crate::config::{Config, WorkerMode};
use crate::failure::Failure;
use crate::image::{Frame, FrameMeta};
use crate::measure::{Measured, Measurer, Share};
use crate::message::{EventKind, FieldHeader, Progress, Role};
use backlog::Backlog;
use std::time::Duration;
use thinning::{Queue, Thinning};

/// Interval of looking whether the results were read, at the end of the stream.
const WAIT: Duration = Duration::from_millis(2);
/// Interval of looking at the frames that wait.
const BACKLOG_PERIOD: Duration = Duration::from_millis(20);
/// Time that results stay readable for a tracker or recorder that is still at work.
const READERS_TIMEOUT: Duration = Duration::from_secs(30);

/// Measures every `workers.count`-th block of frames, as worker `index`, until the stream ends.
///
/// # Errors
///
/// If the measurement cannot be planned, or shared memory cannot be used.
pub fn run(config: &Config, index: u32, launch: &Launch, stop: &Stop) -> Result<Summary, Failure> {
    let format = expected_format(config)?;
    config.check_calibration(format.width_px, format.height_px)?;
    let limits = limits(config, &format);
    let role = format!("{}-{index}", Role::Correlate.as_str());
    let bus = Bus::join_as(&config.rig.name, &role, SUCCESSION_TIMEOUT, launch.domain.as_ref())?;
    let measurer = plan_measurer(config, index, &format)?;
    let mut worker = Worker::open(config, &bus, &limits, index, measurer)?;
    worker.is_restart = launch.is_restart;
    bus.reserve()?;
    let mut recorder =
        RecorderProgress { progress: bus.subscriber(&limits)?, completed: None, expected: config.record.is_some() };
    let waiting = Waiting::new(bus.notification_subscriber("frames")?, config.workers.mode);
    if config.workers.mode == WorkerMode::Latency {
        processor::bind_to_own(index);
    }
    let mut stream = StreamState::new(&bus, &limits)?;
    while !stop.requested() {
        if stream.update()? {
            worker.attach(&stream, stop)?;
        }
        let ended = stream.end.is_some();
        worker.drain(stop)?;
        worker.end_shot(&stream)?;
        if ended {
            worker.finish(&stream)?;
            // Without results there is nothing to keep readable, and the tracker may be gone already.
            if worker.summary.given > 0 {
                wait_for_readers(&mut recorder, &mut stream, &mut worker, stop)?;
            }
            break;
        }
        worker.publish_status_if_due()?;
        recorder.check_done(stream.run_id)?;
        waiting.wait();
    }
    worker.publish_status()?;
    Ok(worker.summary)
}

/// Plans the measurement of the worker's share of the blocks.
fn plan_measurer(config: &Config, index: u32, format: &StreamFormat) -> Result<Measurer, Failure> {
    let (params, _) = analysis_params(config, format);
    let share = Share { index, of: config.workers.count };
    let mut measurer = Measurer::new(&params, share, format.width_px as usize, format.height_px as usize)?;
    measurer.reserve();
    Ok(measurer)
}

/// A correlation worker.
struct Worker<'a> {
    config: &'a Config,
    bus: &'a Bus,
    frames: FrameSubscriber,
    fields: FieldPublisher,
    notifier: TopicNotifier,
    reporter: StatusReporter,
    backlog: Backlog,
    backlog_timer: PeriodicTimer,
    /// `None` if the camera waits for its readers.
    thinning: Option<Thinning>,
    /// The k of every k-th block that was published last.
    reported_every: u64,
    /// The block that is left out, if the newest frame belongs to one.
    skipped: Option<u64>,
    measurer: Measurer,
    summary: Summary,
    /// Steps and fields that are not published yet.
    measured: Vec<Measured>,
    /// Index among the workers.
    index: u32,
    /// Whether the reference picture of patches is still missing.
    needs_reference: bool,
    /// One past the newest frame, once one was received.
    next: Option<u64>,
    /// The hardware-triggered shot of the newest frame.
    shot: u32,
    /// Whether that shot has ended.
    is_ended: bool,
    /// Number of frames per block.
    block_frames: u64,
    /// Whether the stream began without this worker.
    is_late: bool,
    /// Whether the worker replaces a dead one and has not attached yet.
    is_restart: bool,
    /// First frame of the first complete block.
    first_complete: u64,
    newest: FrameStamp,
    /// Exposure time of the newest frame, ns; 0 if unknown.
    exposure_ns: u32,
}

impl<'a> Worker<'a> {
    /// Opens the topics of a worker that has not attached to a run yet.
    fn open(
        config: &'a Config,
        bus: &'a Bus,
        limits: &Limits,
        index: u32,
        measurer: Measurer,
    ) -> Result<Self, Failure> {
        let mut reporter = StatusReporter::new(bus, limits, Role::Correlate, index)?;
        if config.camera.has_present_stamps() {
            reporter.set_live();
        }
        let block_frames = u64::from(config.workers.block_frames);
        let frames_per_round = block_frames * u64::from(config.workers.count);
        Ok(Self {
            config,
            bus,
            frames: bus.frame_subscriber(limits)?,
            fields: bus.field_publisher(limits)?,
            notifier: bus.notifier("field")?,
            reporter,
            backlog: Backlog::open(bus, limits.ring_frames as u64)?,
            backlog_timer: PeriodicTimer::new(BACKLOG_PERIOD),
            thinning: config.camera.films_live().then(|| Thinning::new(frames_per_round)),
            needs_reference: measurer.needs_reference(),
            measurer,
            summary: Summary::default(),
            measured: Vec::new(),
            index,
            next: None,
            shot: 0,
            reported_every: 1,
            skipped: None,
            is_ended: true,
            block_frames,
            is_late: false,
            is_restart: false,
            first_complete: 0,
            newest: FrameStamp::default(),
            exposure_ns: 0,
        })
    }

    /// Connects to the ring of a newly announced run, resets the measurement and publishes readiness. If the run
    /// continues one whose camera process died, the frames of that one are measured first.
    fn attach(&mut self, stream: &StreamState, stop: &Stop) -> Result<(), Failure> {
        if stream.continues && self.reporter.run_id() != 0 {
            // What the camera's dead process left in the ring is measured completely.
            self.drain(stop)?;
            self.measurer.finish(&mut self.measured);
            self.publish()?;
        }
        self.frames.update_connections();
        self.measurer.reset();
        self.newest = FrameStamp::default();
        (self.shot, self.is_ended) = (0, true);
        (self.next, self.skipped) = (None, None);
        self.thinning.iter_mut().for_each(Thinning::begin_run);
        self.is_late = std::mem::take(&mut self.is_restart) || stream.first.is_some();
        self.first_complete = 0;
        self.reporter.set_run(stream.run_id.unwrap_or(0));
        // A dead worker left no record of its progress. Nobody must wait for frames that it will never measure.
        let reached = if self.is_late { u64::MAX } else { 0 };
        Ok(self.reporter.publish_progress(reached)?)
    }

    /// Measures all frames in the queue and publishes the results. A worker that joined late measures from the first
    /// complete block on, and counts its earlier frames as lost.
    fn drain(&mut self, stop: &Stop) -> Result<(), Failure> {
        let mut published = now();
        while !stop.requested() {
            let Some(sample) = self.frames.take()? else { break };
            let header = *sample.header();
            if header.run_id != self.reporter.run_id() {
                continue;
            }
            let Some(meta) = header.meta() else { continue };
            let is_first = self.next.is_none() && !self.is_late;
            if let Some(next) = self.next {
                self.summary.lost += meta.sequence.saturating_sub(next);
            }
            if std::mem::take(&mut self.is_late) {
                self.first_complete = meta.sequence.next_multiple_of(self.block_frames);
            }
            self.next = Some(meta.sequence + 1);
            if header.shot != self.shot {
                self.finish_shot()?;
                self.shot = header.shot;
            }
            self.is_ended = false;
            self.newest = FrameStamp { sequence: meta.sequence, stamp_ns: meta.stamp_ns };
            self.exposure_ns = header.exposure_ns;
            self.summary.taken += 1;
            if std::mem::take(&mut self.needs_reference) {
                let frame = Frame { meta, bytes: sample.bytes() };
                self.set_reference(is_first.then_some(&frame))?;
            }
            self.thin_out(&meta)?;
            // A block measured from its middle would differ from a replay.
            if meta.sequence >= self.first_complete {
                self.measurer.push(&Frame { meta, bytes: sample.bytes() }, &mut self.measured)?;
            } else if self.measurer.needs(meta.sequence) {
                self.summary.lost += 1;
            }
            drop(sample);
            self.publish()?;
            if let Some(thinning) = &mut self.thinning {
                thinning.record_frame(meta.sequence + self.backlog.waiting(self.next));
            }
            if published.elapsed() >= Duration::from_millis(1) {
                self.reporter.publish_progress(meta.sequence + 1)?;
                self.publish_status_if_due()?;
                published = now();
            }
        }
        if let Some(next) = self.next {
            self.reporter.publish_progress(next)?;
        }
        Ok(())
    }

    /// Decides at the start of a block whether it is left out because the worker is too slow, and publishes each frame
    /// that is.
    fn thin_out(&mut self, meta: &FrameMeta) -> Result<(), BusError> {
        let block = meta.sequence / self.block_frames;
        let Some(thinning) = self.thinning.as_mut().filter(|_| self.measurer.owns(block)) else { return Ok(()) };
        if meta.sequence.is_multiple_of(self.block_frames) {
            let waiting = self.backlog.waiting(self.next);
            let queue = Queue { newest: meta.sequence + waiting, waiting, capacity: self.backlog.capacity };
            let is_measured = thinning.begin_block(block / u64::from(self.config.workers.count), queue);
            self.skipped = (!is_measured).then_some(block);
            let every = thinning.every();
            self.reporter.set_state(u32::try_from(every).unwrap_or(u32::MAX));
            self.report_thinning(every, waiting)?;
            if let Some(skipped) = self.skipped {
                self.measurer.skip_block(skipped);
            }
        }
        if self.skipped == Some(block) && meta.sequence >= self.first_complete {
            let header = FieldHeader::skipped(meta, self.reporter.run_id(), self.index);
            self.fields.send(&header, None)?;
            self.notifier.notify();
        }
        Ok(())
    }

    /// Publishes that every k-th block is measured, if k has at least doubled since it was published, or is 1 again.
    fn report_thinning(&mut self, every: u64, waiting: u64) -> Result<(), BusError> {
        let is_news = every >= 2 * self.reported_every || (every == 1 && self.reported_every > 1);
        if !is_news {
            return Ok(());
        }
        self.reported_every = every;
        let text = describe_thinning(self.index, every, waiting);
        self.reporter.publish_event(EventKind::Behind, self.newest, &text)
    }

    /// Completes a shot once the camera has been silent after it.
    fn end_shot(&mut self, stream: &StreamState) -> Result<(), BusError> {
        // If a shot's last frames were missed, the next shot ends it.
        let is_over = self.next.is_some() && self.next == stream.silences.back().copied();
        if is_over { self.finish_shot() } else { Ok(()) }
    }

    /// Measures and publishes the rest of the shot, unless that was done. No measurement crosses to the next one.
    fn finish_shot(&mut self) -> Result<(), BusError> {
        if std::mem::replace(&mut self.is_ended, true) {
            return Ok(());
        }
        self.measurer.finish(&mut self.measured);
        self.measurer.reset();
        self.publish()
    }

    /// Sets the reference picture of patches, if it is available by now; else the next frame tries again.
    ///
    /// `first` is the stream's first frame, `None` for any other frame.
    fn set_reference(&mut self, first: Option<&Frame<'_>>) -> Result<(), Failure> {
        match reference_picture::obtain(self.config, self.bus, first) {
            Some(picture) => self.measurer.set_reference(&picture)?,
            None => self.needs_reference = true,
        }
        Ok(())
    }

    /// Publishes the steps and fields that were measured. Those that do not fit into shared memory are counted as
    /// dropped.
    fn publish(&mut self) -> Result<(), BusError> {
        for measured in self.measured.drain(..) {
            let mut header =
                FieldHeader::new(&measured.step, measured.field.as_ref(), self.reporter.run_id(), self.index);
            header.exposure_ns = self.exposure_ns;
            if self.fields.send(&header, measured.field.as_ref())? {
                self.summary.given += 1;
                self.notifier.notify();
            } else {
                self.summary.dropped += 1;
            }
        }
        Ok(())
    }

    /// Measures the last block, counts the frames that never came, and reports that the worker is done.
    fn finish(&mut self, stream: &StreamState) -> Result<(), BusError> {
        self.measurer.finish(&mut self.measured);
        self.publish()?;
        if let (Some(next), Some(end)) = (self.next, stream.end) {
            self.summary.lost += end.saturating_sub(next);
        }
        self.reporter.publish_done(stream.end.unwrap_or(0))
    }

    fn publish_status_if_due(&mut self) -> Result<(), BusError> {
        if self.backlog_timer.restart_if_due() {
            self.report_backlog()?;
        }
        self.reporter.publish_status_if_due(&self.summary, self.newest)
    }

    /// Publishes that many frames wait, or that frames were lost because too many did. A worker with a block of its own
    /// waiting takes a processor of its own.
    fn report_backlog(&mut self) -> Result<(), BusError> {
        let waiting = self.backlog.waiting(self.next);
        self.reporter.set_queue(waiting, self.backlog.capacity);
        if waiting > u64::from(self.config.workers.count) * self.block_frames {
            processor::move_to_own(self.index);
        }
        if let Some(text) = self.backlog.note_waiting(waiting) {
            let text = format!("correlate {}: {text}", self.index);
            self.reporter.publish_event(EventKind::Behind, self.newest, &text)?;
        }
        if let Some(lost) = self.backlog.note_lost(self.summary.lost) {
            let text = format!("correlate {} lost {lost} frames before it could measure them", self.index);
            self.reporter.publish_event(EventKind::Lost, self.newest, &text)?;
        }
        Ok(())
    }

    fn publish_status(&mut self) -> Result<(), BusError> {
        self.report_backlog()?;
        self.reporter.publish_status(&self.summary, self.newest)
    }
}

/// Returns the news that worker `index` measures every k-th of its blocks, in words.
fn describe_thinning(index: u32, every: u64, waiting: u64) -> String {
    match every {
        1 => format!("correlate {index} measures every block again"),
        _ => format!(
            "correlate {index} measures 1 block of {every}, because the camera is faster than it; {waiting} frames wait; \
             recorded shots are measured completely afterwards"
        ),
    }
}

/// Whether the recorder has read everything of a run.
struct RecorderProgress {
    progress: Subscriber<Progress>,
    /// The latest run that it has completed.
    completed: Option<u64>,
    /// Whether the rig has a recorder.
    expected: bool,
}

impl RecorderProgress {
    /// Reads new progress and returns whether the recorder has read everything of this run, or there is none.
    fn check_done(&mut self, run_id: Option<u64>) -> Result<bool, BusError> {
        while let Some(progress) = self.progress.take()? {
            if progress.role == Role::Record as u32 && progress.done == 1 {
                self.completed = Some(progress.run_id);
            }
        }
        Ok(!self.expected || self.completed == run_id)
    }
}

/// Waits until the tracker has published and the recorder has read everything, at most [`READERS_TIMEOUT`], or for a
/// stop.
fn wait_for_readers(
    recorder: &mut RecorderProgress,
    stream: &mut StreamState,
    worker: &mut Worker<'_>,
    stop: &Stop,
) -> Result<(), BusError> {
    let timeout = Timeout::new(READERS_TIMEOUT);
    while !stop.requested() && !timeout.has_expired() {
        stream.update()?;
        if recorder.check_done(stream.run_id)? && stream.tracked {
            break;
        }
        worker.publish_status_if_due()?;
        std::thread::sleep(WAIT);
    }
    Ok(())
}
