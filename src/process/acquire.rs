//! Acquisition: frames from the camera to the ring.

use super::action::TriggerCause;
use super::clock::{PeriodicTimer, Timeout, host_ns, now};
use super::frame_stamp::FrameStamp;
use super::hardware_trigger::HardwareTrigger;
use super::latency::LatencyHistogram;
use super::launch::Launch;
use super::live_trigger::StandaloneTrigger;
use super::readers::Readers;
use super::reference_picture;
use super::resume::{NewestFrameFile, Resume};
use super::setup::{SUCCESSION_TIMEOUT, Source, limits};
use super::status_reporter::StatusReporter;
use super::stepping;
use super::stop::Stop;
use super::summary::Summary;
use crate::bus::{Bus, BusError, FramePublisher, Limits, TopicNotifier};
use crate::camera::{CameraError, Next, Pace, Slot, realtime_priority};
use crate::config::{Config, TriggerMode};
use crate::failure::Failure;
use crate::image::FrameMeta;
use crate::message::{EventKind, FrameHeader, Role};
use crate::trigger::MotionTrigger;
use std::time::{Duration, Instant};

/// Time for the readers to get ready.
const READY_TIMEOUT: Duration = Duration::from_secs(15);
/// Time that the ring is kept after the last frame for readers that are still at work.
const LINGER_TIMEOUT: Duration = Duration::from_secs(30);
/// Maximum wait for a frame before the loop does its other work.
const WAIT: Duration = Duration::from_millis(50);
/// Time for a camera to release a process that died: GigE Vision cameras wait 3 s for a heartbeat.
const RELEASE_TIMEOUT: Duration = Duration::from_secs(20);

/// Runs the camera of this rig until it ends or is stopped, and returns the counts of its frames.
///
/// Frames of a live camera continue the numbers of a predecessor that died.
///
/// # Errors
///
/// If the camera cannot be opened or is lost for good, its frames do not fit the calibration, or shared memory cannot be
/// used.
pub fn run(config: &Config, launch: Launch, stop: &Stop) -> Result<Summary, Failure> {
    let mut source = open_source(config, &launch, stop)?;
    if let Some(steps) = launch.steps {
        source.camera().follow_steps(steps);
    }
    config.check_calibration(source.format().width_px, source.format().height_px)?;
    let bus = Bus::join_as(&config.rig.name, Role::Acquire.as_str(), SUCCESSION_TIMEOUT, launch.domain.as_ref())?;
    let (newest_frame_file, previous) = NewestFrameFile::open(&bus.private_file(Role::Acquire.as_str()))?;
    let resume = previous.filter(|_| launch.is_restart).map(|(resume, age_s)| {
        let resume = Resume { epoch: resume.epoch + 1, ..resume };
        (resume.after(age_s * config.camera.playback_rate, source.format().frame_rate_hz), now())
    });
    match resume {
        // So that the numbers and epochs of this process rise even if it dies before its first frame.
        Some((resume, _)) => newest_frame_file.save_state(&resume),
        None => {
            newest_frame_file.clear();
            reference_picture::begin_stream(config, &bus)?;
        }
    }
    let mut acquisition = Acquisition::new(&bus, config, source, newest_frame_file)?;
    acquisition.take_over(resume);
    bus.reserve()?;
    acquisition.prepare(stop)?;
    let streamed = acquisition.stream(config, stop);
    let ended = acquisition.end(stop);
    streamed?;
    ended?;
    Ok(acquisition.summary)
}

/// Opens the camera. A camera whose controlling process was killed may refuse for some seconds, so a restarted process
/// tries again within [`RELEASE_TIMEOUT`].
fn open_source(config: &Config, launch: &Launch, stop: &Stop) -> Result<Source, CameraError> {
    let timeout = Timeout::new(RELEASE_TIMEOUT);
    loop {
        match Source::open(config) {
            Err(error) if launch.is_restart && !timeout.has_expired() && !stop.requested() => {
                log::info!("{error}; retrying");
                std::thread::sleep(Duration::from_millis(200));
            }
            answer => return answer,
        }
    }
}

/// The main loop of acquisition.
struct Acquisition {
    // Drop order: the camera goes before the ring whose slots it holds.
    source: Source,
    ring: FramePublisher,
    /// The newest frame, for a successor.
    newest_frame_file: NewestFrameFile,
    notifier: TopicNotifier,
    reporter: StatusReporter,
    readers: Readers,
    trigger: Option<MotionTrigger>,
    hardware_trigger: Option<HardwareTrigger>,
    /// Time from the delivery of each frame to the decision of the motion trigger.
    decision_latency: LatencyHistogram,
    standalone: Option<StandaloneTrigger>,
    /// Whether frames are played one by one on request.
    is_stepped: bool,
    /// Whether the camera waits for a pulse before each frame.
    is_pulsed: bool,
    block_frames: u32,
    summary: Summary,
    /// Number of slots that the camera holds.
    queued: usize,
    /// Number of incomplete frames since the last complete one.
    incomplete: u64,
    /// Sequence number of the first published frame.
    first: Option<u64>,
    /// One past the newest published frame.
    next: u64,
    /// Stamp of the newest published frame, ns.
    stamp_ns: u64,
    /// Offset of the camera's count, after it was reopened.
    offset: u64,
    /// Number of times the camera was reopened.
    epoch: u32,
    /// The state of the dead predecessor until the first frame, and when it was true.
    resume: Option<(Resume, Instant)>,
    /// One past the last frame of the dead predecessor: the frames from there to the first one are lost.
    unpublished: Option<u64>,
}

impl Acquisition {
    /// Creates the ring and opens the topics for an open camera.
    fn new(bus: &Bus, config: &Config, source: Source, newest_frame_file: NewestFrameFile) -> Result<Self, Failure> {
        let limits = limits(config, &source.format());
        let ring = bus.frame_publisher(&limits, source.format().slot_bytes())?;
        let mut reporter = StatusReporter::new(bus, &limits, Role::Acquire, 0)?;
        reporter.set_run(host_ns());
        if source.is_live() {
            reporter.set_live();
        }
        let trigger = (config.trigger.mode == TriggerMode::Motion)
            .then(|| MotionTrigger::new(config.trigger.threshold_dn, config.trigger.roi_px));
        let hardware_trigger = HardwareTrigger::new(config);
        Ok(Self {
            ring,
            newest_frame_file,
            notifier: bus.notifier("frames")?,
            reporter,
            readers: Readers::new(bus, &limits, config)?,
            decision_latency: LatencyHistogram::default(),
            standalone: if trigger.is_some() || hardware_trigger.is_some() {
                StandaloneTrigger::new(config)
            } else {
                None
            },
            hardware_trigger,
            trigger,
            is_stepped: config.camera.stepped,
            is_pulsed: config.camera.is_pulsed(),
            block_frames: config.workers.block_frames,
            source,
            summary: Summary::default(),
            queued: 0,
            incomplete: 0,
            first: None,
            next: 0,
            stamp_ns: 0,
            offset: 0,
            epoch: 0,
            resume: None,
            unpublished: None,
        })
    }

    /// Continues the predecessor's numbers. A source on demand lost nothing and starts again.
    fn take_over(&mut self, resume: Option<(Resume, Instant)>) {
        let Some((resume, since)) = resume else { return };
        self.epoch = resume.epoch;
        self.reporter.set_state(self.epoch);
        if self.source.pace() == Pace::Live {
            self.resume = Some((resume, since));
            self.unpublished = Some(resume.published + 1);
        }
    }

    /// Moves a film to the first block from the frame on that is due by now, if the process replaces one that died.
    ///
    /// A camera that cannot seek keeps the predecessor's state, for [`continue_count`](Self::continue_count).
    fn seek(&mut self, config: &Config) {
        let Some((resume, begin)) = self.resume else { return };
        let (rate_hz, speed) = (self.source.format().frame_rate_hz, config.camera.playback_rate);
        let due = resume.after(speed * begin.elapsed().as_secs_f64(), rate_hz);
        let first = due.first_frame(due.stamp_ns, rate_hz, config.workers.block_frames);
        if self.source.camera().seek(first) {
            self.resume = None;
        }
    }

    /// Sets the offset of a live camera, which counts from 0 again, by the time of its first frame after a restart.
    /// Has no effect without the state of a predecessor.
    fn continue_count(&mut self, first: &FrameMeta) {
        let Some((resume, _)) = self.resume.take() else { return };
        // A pulsed camera has no frame rate to count missed frames by.
        let rate_hz = if self.is_pulsed { 0.0 } else { self.source.format().frame_rate_hz };
        let number = resume.first_frame(first.stamp_ns, rate_hz, self.block_frames);
        self.offset = number.saturating_sub(first.sequence);
    }

    /// Touches the ring, announces it and waits until every reader has attached, [`READY_TIMEOUT`] has passed or a stop
    /// is requested.
    fn prepare(&mut self, stop: &Stop) -> Result<(), Failure> {
        self.ring.touch()?;
        let run_id = self.reporter.run_id();
        let camera = self.source.identity();
        let identity = format!("{}\n{}", camera.model, camera.serial);
        let earliest = self.resume.map_or(0, |(resume, _)| resume.sequence + 1);
        self.reporter.publish_event(EventKind::Prepared, FrameStamp { sequence: earliest, stamp_ns: 0 }, &identity)?;
        let timeout = Timeout::new(READY_TIMEOUT);
        while !stop.requested() && !self.readers.all_attached(run_id)? {
            if timeout.has_expired() {
                log::warn!("starting without {}: not ready in time", self.readers.missing(run_id));
                break;
            }
            self.ring.update_connections();
            self.reporter.publish_status_if_due(&self.summary, FrameStamp::default())?;
            std::thread::sleep(Duration::from_millis(1));
        }
        self.ring.update_connections();
        Ok(())
    }

    /// Starts the camera and publishes its frames until it ends or a stop is requested.
    fn stream(&mut self, config: &Config, stop: &Stop) -> Result<(), Failure> {
        self.lend_slots()?;
        self.seek(config);
        self.source.camera().start()?;
        if self.source.pace() == Pace::Live
            && let Err(error) = realtime_priority::raise(realtime_priority::PUBLISHING)
        {
            log::info!("frames are published without real-time priority: {error}");
        }
        if self.is_stepped {
            stepping::print_answer("ready: each line on standard input plays a frame");
        }
        while !stop.requested() {
            self.reporter.publish_status_if_due(&self.summary, self.newest())?;
            self.lend_slots()?;
            if self.source.pace() == Pace::OnDemand {
                let first = self.first.unwrap_or(self.next);
                self.readers.wait_for_room(self.reporter.run_id(), first..self.next, stop)?;
            }
            match self.source.camera().next(WAIT) {
                Ok(Next::Frame(slot, meta)) => self.publish(slot, meta)?,
                Ok(Next::Incomplete(slot, cause)) => self.discard(slot, &cause),
                Ok(Next::Timeout) => self.end_on_silence()?,
                Ok(Next::End) => return Ok(()),
                Err(error) => self.reopen(config, stop, error)?,
            }
        }
        Ok(())
    }

    /// Queues as many slots as the camera wants and the ring has, at most [`Limits::CAMERA_SLOTS`].
    fn lend_slots(&mut self) -> Result<(), BusError> {
        while self.queued < self.source.camera().slots().min(Limits::CAMERA_SLOTS) {
            let Some(slot) = self.ring.lend()? else { break };
            self.source.camera().queue(slot);
            self.queued += 1;
        }
        Ok(())
    }

    /// Returns the newest published frame; number and stamp are 0 before the first.
    fn newest(&self) -> FrameStamp {
        FrameStamp { sequence: self.next.saturating_sub(1), stamp_ns: self.stamp_ns }
    }

    /// Publishes an event with the number of the frame after the newest one, and the stamp of the newest one, ns.
    fn publish_event(&self, kind: EventKind, text: &str) -> Result<(), BusError> {
        self.reporter.publish_event(kind, FrameStamp { sequence: self.next, stamp_ns: self.stamp_ns }, text)
    }

    /// Publishes a frame, the events of its shot, its trigger and the losses before it, and the outcomes of actions
    /// that have ended.
    fn publish(&mut self, mut slot: Slot, mut meta: FrameMeta) -> Result<(), BusError> {
        self.queued -= 1;
        self.continue_count(&meta);
        meta.sequence += self.offset;
        meta.epoch = meta.epoch.max(self.epoch);
        let frame = FrameStamp { sequence: meta.sequence, stamp_ns: meta.stamp_ns };
        // Before it is published, so that no number is ever used twice.
        self.newest_frame_file.save(frame, meta.epoch);
        let decided = self.detect_motion(&meta, &mut slot);
        self.begin_shot(frame)?;
        let exposure_us = self.source.format().exposure_us;
        let shot = self.hardware_trigger.as_ref().map_or(0, HardwareTrigger::shot);
        self.ring.send(slot, FrameHeader { shot, ..FrameHeader::new(&meta, self.reporter.run_id(), exposure_us) })?;
        self.notifier.notify();
        if self.is_stepped {
            stepping::print_answer(&format!("frame {} of {} ns", meta.sequence, meta.stamp_ns));
        }
        self.summary.taken += 1;
        self.summary.given += 1;
        if self.first.is_none() {
            self.first = Some(meta.sequence);
            // A live camera counts from its first frame id, complete or not; a recording may begin with any number.
            let begin = if self.source.is_live() { self.offset } else { meta.sequence };
            self.next = self.unpublished.unwrap_or(begin);
            self.reporter.publish_event(EventKind::Started, frame, "first frame")?;
            if self.epoch > 0 {
                let text = format!("its process was restarted; epoch {}", self.epoch);
                self.reporter.publish_event(EventKind::Camera, frame, &text)?;
            }
        }
        let gap = meta.sequence.saturating_sub(self.next);
        if gap > 0 {
            self.summary.lost += gap;
            let text = match self.unpublished {
                Some(due) if due == self.next => format!("{gap} frames came while no process took them"),
                _ => format!("the camera lost {gap} frames"),
            };
            self.reporter.publish_event(EventKind::Lost, frame, &text)?;
        }
        self.next = meta.sequence + 1;
        self.incomplete = 0;
        self.stamp_ns = meta.stamp_ns;
        if let Some(latency) = decided {
            let text = format!("motion; decided {} us after the frame came", latency.as_micros());
            self.reporter.publish_event(EventKind::Decided, frame, &text)?;
            if let Some(standalone) = &mut self.standalone {
                standalone.trigger(&TriggerCause { frame, text: "motion".into() }, &self.reporter)?;
            }
        }
        self.standalone.as_mut().map_or(Ok(()), |standalone| standalone.publish(&self.reporter))
    }

    /// Announces a shot of the hardware trigger if `frame`, which is not published yet, begins one. Without a recorder
    /// it also executes the trigger.
    fn begin_shot(&mut self, frame: FrameStamp) -> Result<(), BusError> {
        let Some(text) = self.hardware_trigger.as_mut().and_then(HardwareTrigger::on_frame) else { return Ok(()) };
        self.reporter.publish_event(EventKind::Decided, frame, &text)?;
        let Some(standalone) = &mut self.standalone else { return Ok(()) };
        standalone.trigger(&TriggerCause { frame, text }, &self.reporter)
    }

    /// Announces the end of a hardware-triggered shot, once the camera has been silent for long enough.
    fn end_on_silence(&mut self) -> Result<(), BusError> {
        if !self.hardware_trigger.as_mut().is_some_and(HardwareTrigger::on_timeout) {
            return Ok(());
        }
        self.publish_event(EventKind::Silent, "no frame for trigger.silence_s")
    }

    /// Evaluates the motion trigger on a frame; if it fires, returns the time since the frame's delivery. `None`
    /// otherwise, and without such a trigger.
    fn detect_motion(&mut self, meta: &FrameMeta, slot: &mut Slot) -> Option<Duration> {
        let trigger = self.trigger.as_mut()?;
        let (begin, age) = (now(), self.source.camera().frame_age());
        let fires = trigger.push(meta, slot.bytes_mut());
        let latency = age + begin.elapsed();
        self.decision_latency.add(latency);
        fires.then_some(latency)
    }

    /// Counts and logs an incomplete frame, and takes back its slot.
    fn discard(&mut self, slot: Slot, cause: &str) {
        // The gap in the camera's count shows the loss, unless no complete frame follows.
        self.incomplete += 1;
        log::warn!("incomplete frame: {cause}");
        self.queued -= 1;
        self.ring.take_back(slot);
    }

    /// Tries to reopen a lost camera until it answers or a stop is requested; frames continue under a new epoch.
    ///
    /// # Errors
    ///
    /// `error` itself, unless it is [`CameraError::Lost`].
    fn reopen(&mut self, config: &Config, stop: &Stop, error: CameraError) -> Result<(), Failure> {
        if !matches!(error, CameraError::Lost { .. }) {
            return Err(error.into());
        }
        self.publish_event(EventKind::Camera, &error.to_string())?;
        self.release();
        let mut timer = PeriodicTimer::new(Duration::from_millis(500));
        while !stop.requested() {
            self.reporter.publish_status_if_due(&self.summary, self.newest())?;
            if timer.restart_if_due() && self.try_reopen(config)? {
                return Ok(self.publish_event(EventKind::Camera, "the camera is back")?);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    /// Closes the camera and takes back all its slots.
    fn release(&mut self) {
        self.source.close();
        self.ring.take_all_back();
        self.queued = 0;
    }

    /// Reopens the camera and starts it; returns `false` if it does not answer yet, or is lost again.
    fn try_reopen(&mut self, config: &Config) -> Result<bool, BusError> {
        if self.source.reopen(config).is_err() {
            return Ok(false);
        }
        self.lend_slots()?;
        if let Err(error) = self.source.camera().start() {
            log::debug!("cannot restart the camera: {error}");
            self.release();
            return Ok(false);
        }
        self.epoch += 1;
        self.reporter.set_state(self.epoch);
        // The number of missed frames is unknown: at least one.
        self.offset = self.next + 1;
        Ok(true)
    }

    /// Closes the camera, waits for running actions, and announces the end of the stream. Keeps the frames in the ring,
    /// if there are any, until its readers are done, at most [`LINGER_TIMEOUT`].
    fn end(&mut self, stop: &Stop) -> Result<(), BusError> {
        self.source.close();
        self.summary.lost += self.incomplete;
        if let Some(standalone) = &mut self.standalone {
            standalone.finish(&self.reporter)?;
        }
        let text = match self.decision_latency.description() {
            None => "last frame".to_owned(),
            Some(latencies) => format!("last frame; from a frame to its decision: {latencies}"),
        };
        self.publish_event(EventKind::Ended, &text)?;
        let timeout = Timeout::new(LINGER_TIMEOUT);
        while self.first.is_some() && !timeout.has_expired() && !stop.is_abandoned() {
            if self.readers.all_done(self.reporter.run_id())? {
                break;
            }
            self.ring.update_connections();
            self.reporter.publish_status_if_due(&self.summary, self.newest())?;
            std::thread::sleep(Duration::from_millis(2));
        }
        self.reporter.publish_status(&self.summary, self.newest())
    }
}
