//! Camera to ring.

use super::action::Cause;
use super::clock::{Every, Patience, host_ns, now};
use super::conclude::Alone;
use super::line::Line;
use super::pace::Latencies;
use super::reference;
use super::reins;
use super::report::Reporter;
use super::resume::Resume;
use super::rig::{SUCCESSION, Source, limits};
use super::stop::Stop;
use super::summary::Summary;
use crate::bus::{Bell, Bus, BusError, FramePublisher, Limits, Subscriber};
use crate::camera::{CameraError, Next, Pace, Slot, priority};
use crate::config::{Config, TriggerMode};
use crate::image::FrameMeta;
use crate::message::{EventKind, FrameHeader, Progress, Role};
use crate::trigger::MotionTrigger;
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::{Duration, Instant};

/// How long the readers of the frames may take to get ready.
const READY: Duration = Duration::from_secs(15);
/// How long an on-demand source waits for readers that do not move.
const STUCK: Duration = Duration::from_secs(10);
/// How long the ring stays after the last frame for readers that are still at work.
const LINGER: Duration = Duration::from_secs(30);
const WAIT: Duration = Duration::from_millis(50);
/// How long a camera may take to let go of a process that died: GigE Vision cameras give it 3 s to show a sign of life.
const LET_GO: Duration = Duration::from_secs(20);

/// Runs the camera of this rig until it ends or is stopped.
///
/// `resume` tells of another that was there before and died: a live camera's frames go on counting.
///
/// # Errors
///
/// When the camera cannot be opened or goes away for good, or shared memory cannot be used.
pub fn run(config: &Config, resume: Option<Resume>, stop: &Stop) -> anyhow::Result<Summary> {
    let began = now();
    let source = open(config, resume.is_some(), stop)?;
    config.check_calibration(source.format().width_px, source.format().height_px)?;
    let bus = Bus::take_part(&config.rig.name, Role::Acquire.word(), SUCCESSION)?;
    if resume.is_none() {
        reference::begin(config)?;
    }
    let limits = limits(config, &source.format());
    let ring = bus.frame_publisher(&limits, source.format().slot_bytes())?;
    let mut loop_ = Loop::new(&bus, config, limits, ring, source)?;
    loop_.take_over(resume, began);
    loop_.prepare(stop)?;
    let ended = loop_.stream(config, stop);
    let told = loop_.end();
    ended?;
    told?;
    Ok(loop_.summary)
}

/// Opens the camera; one whose process was killed may not know of it yet.
fn open(config: &Config, is_resumed: bool, stop: &Stop) -> Result<Source, CameraError> {
    let patience = Patience::new(LET_GO);
    loop {
        match Source::open(config) {
            Err(error) if is_resumed && !patience.is_over() && !stop.requested() => {
                log::info!("{error}; trying again");
                std::thread::sleep(Duration::from_millis(200));
            }
            answer => return answer,
        }
    }
}

struct Loop {
    // The camera goes before the ring whose slots it holds.
    source: Source,
    ring: FramePublisher,
    bell: Bell,
    reporter: Reporter,
    readers: Readers,
    trigger: Option<MotionTrigger>,
    line: Option<Line>,
    /// How long after each frame was there the trigger had looked at it.
    decisions: Latencies,
    alone: Option<Alone>,
    /// Whether every frame is asked for, and told of.
    is_stepped: bool,
    /// Whether the camera waits for a pulse before each frame.
    is_pulsed: bool,
    block_frames: u32,
    summary: Summary,
    queued: usize,
    /// Torn frames since the last whole one.
    torn: u64,
    first: Option<u64>,
    next: u64,
    stamp_ns: u64,
    /// What is added to the camera's count after it was opened anew.
    offset: u64,
    epoch: u32,
    /// What the process before this one left, until the first frame, and when this one began.
    resume: Option<(Resume, Instant)>,
}

impl Loop {
    fn new(
        bus: &Bus,
        config: &Config,
        limits: Limits,
        ring: FramePublisher,
        source: Source,
    ) -> Result<Self, anyhow::Error> {
        let mut reporter = Reporter::new(bus, &limits, Role::Acquire, 0)?;
        reporter.set_run(host_ns());
        reporter.set_live(source.is_live());
        let trigger = (config.trigger.mode == TriggerMode::Motion)
            .then(|| MotionTrigger::new(config.trigger.threshold_dn, config.trigger.roi_px));
        let line = Line::new(config);
        Ok(Self {
            ring,
            bell: bus.bell("frames")?,
            reporter,
            readers: Readers::new(bus, &limits, config)?,
            decisions: Latencies::default(),
            alone: (trigger.is_some() || line.is_some()).then(|| Alone::new(config)).flatten(),
            line,
            trigger,
            is_stepped: config.camera.stepped,
            is_pulsed: config.camera.is_pulsed(),
            block_frames: config.workers.block_frames,
            source,
            summary: Summary::default(),
            queued: 0,
            torn: 0,
            first: None,
            next: 0,
            stamp_ns: 0,
            offset: 0,
            epoch: 0,
            resume: None,
        })
    }

    /// Goes on where a process that died was; a source on demand, which lost nothing, begins again.
    fn take_over(&mut self, resume: Option<Resume>, began: Instant) {
        let Some(resume) = resume else { return };
        self.epoch = resume.epoch;
        self.reporter.set_state(self.epoch);
        self.resume = (self.source.pace() == Pace::Live).then_some((resume, began));
    }

    /// A film goes on with the frame that is due by now.
    fn go_to(&mut self, config: &Config) {
        let Some((resume, began)) = self.resume else { return };
        let (rate_hz, speed) = (self.source.format().frame_rate_hz, config.camera.playback_rate);
        let due = resume.after(speed * began.elapsed().as_secs_f64(), rate_hz);
        let first = due.first_frame(due.stamp_ns, rate_hz, config.workers.block_frames);
        if self.source.camera().go_to(first) {
            self.resume = None;
        }
    }

    /// A camera of its own time counts from 0 again: its first frame tells how many nobody took.
    fn go_on(&mut self, first: &FrameMeta) {
        let Some((resume, _)) = self.resume.take() else { return };
        // One that waits for pulses has no rate that would tell.
        let rate_hz = if self.is_pulsed { 0.0 } else { self.source.format().frame_rate_hz };
        let number = resume.first_frame(first.stamp_ns, rate_hz, self.block_frames);
        self.offset = number.saturating_sub(first.sequence);
    }

    /// Touches the ring, announces it and waits until every reader has attached.
    fn prepare(&mut self, stop: &Stop) -> anyhow::Result<()> {
        self.ring.touch()?;
        let run_id = self.reporter.run_id();
        let camera = self.source.identity();
        let identity = format!("{}\n{}", camera.model, camera.serial);
        let earliest = self.resume.map_or(0, |(resume, _)| resume.sequence + 1);
        self.reporter.event(EventKind::Prepared, earliest, 0, &identity)?;
        let patience = Patience::new(READY);
        while !stop.requested() && !self.readers.all_attached(run_id)? {
            if patience.is_over() {
                log::warn!("starting without {}: they did not get ready in time", self.readers.missing(run_id));
                break;
            }
            self.ring.greet();
            self.reporter.status(&self.summary, 0, 0)?;
            std::thread::sleep(Duration::from_millis(1));
        }
        self.ring.greet();
        Ok(())
    }

    fn stream(&mut self, config: &Config, stop: &Stop) -> anyhow::Result<()> {
        self.lend()?;
        self.go_to(config);
        self.source.camera().start()?;
        if self.source.pace() == Pace::Live
            && let Err(error) = priority::raise(priority::HANDING_ON)
        {
            log::info!("frames are handed on without real-time priority: {error}");
        }
        if self.is_stepped {
            reins::tell("ready: each line on standard input plays a frame");
        }
        while !stop.requested() {
            self.reporter.status(&self.summary, self.next.saturating_sub(1), self.stamp_ns)?;
            self.lend()?;
            if self.source.pace() == Pace::OnDemand {
                let first = self.first.unwrap_or(self.next);
                self.readers.wait_for_room(self.reporter.run_id(), first..self.next, stop)?;
            }
            match self.source.camera().next(WAIT) {
                Ok(Next::Frame(slot, meta)) => self.publish(slot, meta)?,
                Ok(Next::Torn(slot, cause)) => self.torn(slot, &cause),
                Ok(Next::Nothing) => self.hush()?,
                Ok(Next::End) => return Ok(()),
                Err(error) => self.reopen(config, stop, &error)?,
            }
        }
        Ok(())
    }

    /// Hands the camera as many slots as it wants and the ring has.
    fn lend(&mut self) -> Result<(), BusError> {
        while self.queued < self.source.camera().slots().min(Limits::CAMERA_SLOTS) {
            let Some(slot) = self.ring.lend()? else { break };
            self.source.camera().queue(slot);
            self.queued += 1;
        }
        Ok(())
    }

    fn publish(&mut self, slot: Slot, mut meta: FrameMeta) -> Result<(), BusError> {
        let mut slot = slot;
        self.queued -= 1;
        self.go_on(&meta);
        meta.sequence += self.offset;
        meta.epoch = meta.epoch.max(self.epoch);
        let decided = self.decide(&meta, &mut slot);
        self.begin_shot(&meta)?;
        let exposure_us = self.source.format().exposure_us;
        let shot = self.line.as_ref().map_or(0, Line::shot);
        self.ring.send(slot, FrameHeader { shot, ..FrameHeader::new(&meta, self.reporter.run_id(), exposure_us) })?;
        self.bell.ring();
        if self.is_stepped {
            reins::tell(&format!("frame {} of {} ns", meta.sequence, meta.stamp_ns));
        }
        self.summary.taken += 1;
        self.summary.given += 1;
        if self.first.is_none() {
            self.first = Some(meta.sequence);
            // A live camera counts from its first id on, whole or torn; a recording may begin with any number.
            self.next = if self.source.is_live() { self.offset } else { meta.sequence };
            self.reporter.event(EventKind::Started, meta.sequence, meta.stamp_ns, "first frame")?;
            if self.epoch > 0 {
                let text = format!("its process was started again; epoch {}", self.epoch);
                self.reporter.event(EventKind::Camera, meta.sequence, meta.stamp_ns, &text)?;
            }
        }
        let gap = meta.sequence.saturating_sub(self.next);
        if gap > 0 {
            self.summary.lost += gap;
            let text = format!("the camera lost {gap} frames");
            self.reporter.event(EventKind::Lost, meta.sequence, meta.stamp_ns, &text)?;
        }
        self.next = meta.sequence + 1;
        self.torn = 0;
        self.stamp_ns = meta.stamp_ns;
        if let Some(took) = decided {
            let text = format!("motion; decided {} us after the frame came", took.as_micros());
            self.reporter.event(EventKind::Decided, meta.sequence, meta.stamp_ns, &text)?;
            if let Some(alone) = &mut self.alone {
                let cause = Cause { frame: meta.sequence, stamp_ns: meta.stamp_ns, text: "motion".into() };
                alone.trigger(&cause, &self.reporter)?;
            }
        }
        self.alone.as_mut().map_or(Ok(()), |alone| alone.tell(&self.reporter, false))
    }

    /// Tells of a shot that the camera's line begins, before anybody can see its first frame.
    fn begin_shot(&mut self, meta: &FrameMeta) -> Result<(), BusError> {
        let Some(text) = self.line.as_mut().and_then(Line::frame) else { return Ok(()) };
        self.reporter.event(EventKind::Decided, meta.sequence, meta.stamp_ns, &text)?;
        match &mut self.alone {
            None => Ok(()),
            Some(alone) => {
                alone.trigger(&Cause { frame: meta.sequence, stamp_ns: meta.stamp_ns, text }, &self.reporter)
            }
        }
    }

    /// Tells of a shot that ends because the camera has been silent.
    fn hush(&mut self) -> Result<(), BusError> {
        if !self.line.as_mut().is_some_and(Line::nothing) {
            return Ok(());
        }
        self.reporter.event(EventKind::Silent, self.next, self.stamp_ns, "no frame for trigger.silence_s")
    }

    /// Shows a frame to the trigger; how long after the frame was there it fires.
    fn decide(&mut self, meta: &FrameMeta, slot: &mut Slot) -> Option<Duration> {
        let trigger = self.trigger.as_mut()?;
        let (taken, waited) = (now(), self.source.camera().waited());
        let fires = trigger.push(meta, slot.bytes_mut());
        let took = waited + taken.elapsed();
        self.decisions.add(took);
        fires.then_some(took)
    }

    fn torn(&mut self, slot: Slot, cause: &str) {
        // The gap in the camera's count will say that it is missing, unless no whole frame follows.
        self.torn += 1;
        log::warn!("a frame did not arrive whole: {cause}");
        self.queued -= 1;
        self.ring.take_back(slot);
    }

    /// A live camera that vanished is opened again until it answers; frames go on under a new epoch.
    fn reopen(&mut self, config: &Config, stop: &Stop, error: &CameraError) -> anyhow::Result<()> {
        if !matches!(error, CameraError::Vanished { .. }) {
            anyhow::bail!("read a frame: {error}");
        }
        self.reporter.event(EventKind::Camera, self.next, self.stamp_ns, &error.to_string())?;
        self.let_go();
        let mut every = Every::new(Duration::from_millis(500));
        while !stop.requested() {
            self.reporter.status(&self.summary, self.next.saturating_sub(1), self.stamp_ns)?;
            if every.due() && self.come_back(config)? {
                return Ok(self.reporter.event(EventKind::Camera, self.next, self.stamp_ns, "the camera is back")?);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    /// Closes the camera and takes every slot back that it had.
    fn let_go(&mut self) {
        self.source.close();
        self.ring.take_all_back();
        self.queued = 0;
    }

    /// Opens the camera again and starts it; `false` when it does not answer yet, or is gone again.
    fn come_back(&mut self, config: &Config) -> Result<bool, BusError> {
        if self.source.reopen(config).is_err() {
            return Ok(false);
        }
        self.lend()?;
        if let Err(error) = self.source.camera().start() {
            log::debug!("start the camera again: {error}");
            self.let_go();
            return Ok(false);
        }
        self.epoch += 1;
        self.reporter.set_state(self.epoch);
        // The frames between are unknown in number: at least one is missing.
        self.offset = self.next + 1;
        Ok(true)
    }

    /// Tells the end and keeps the ring until its readers are done.
    fn end(&mut self) -> Result<(), BusError> {
        self.source.close();
        self.summary.lost += self.torn;
        if let Some(alone) = &mut self.alone {
            alone.tell(&self.reporter, true)?;
        }
        let text = match self.decisions.words() {
            None => "last frame".to_owned(),
            Some(words) => format!("last frame; from a frame to its decision: {words}"),
        };
        self.reporter.event(EventKind::Ended, self.next, self.stamp_ns, &text)?;
        let patience = Patience::new(LINGER);
        while !patience.is_over() && !self.readers.all_done(self.reporter.run_id())? {
            self.ring.greet();
            self.reporter.status(&self.summary, self.next.saturating_sub(1), self.stamp_ns)?;
            std::thread::sleep(Duration::from_millis(2));
        }
        self.reporter.status_now(&self.summary, self.next.saturating_sub(1), self.stamp_ns)
    }
}

/// How far the readers of the frames have come.
struct Readers {
    progress: Subscriber<Progress>,
    expected: Vec<(u32, u32)>,
    /// Readers that take frames all the time; an armed recorder only does after a trigger.
    paced_by: Vec<(u32, u32)>,
    told: BTreeMap<(u32, u32), Progress>,
    window: u64,
}

impl Readers {
    fn new(bus: &Bus, limits: &Limits, config: &Config) -> Result<Self, BusError> {
        let workers = (0..limits.workers).map(|index| (Role::Correlate as u32, index));
        let recorder = config.record.iter().map(|_| (Role::Record as u32, 0));
        let streaming = config.trigger.mode == TriggerMode::Off;
        let paced_by = workers.clone().chain(recorder.clone().filter(|_| streaming)).collect();
        let tracker = (limits.workers > 0).then_some((Role::Track as u32, 0));
        let expected = workers.chain(recorder).chain(tracker).collect();
        // A quarter of the ring in flight keeps every reader busy and every queue far from running over.
        let window = (limits.ring_frames as u64 / 4).max(8);
        Ok(Self { progress: bus.subscriber(limits)?, expected, paced_by, told: BTreeMap::new(), window })
    }

    fn update(&mut self) -> Result<bool, BusError> {
        let mut news = false;
        while let Some(progress) = self.progress.take()? {
            self.told.insert((progress.role, progress.index), progress);
            news = true;
        }
        Ok(news)
    }

    fn all_attached(&mut self, run_id: u64) -> Result<bool, BusError> {
        self.update()?;
        Ok(self.expected.iter().all(|who| self.told.get(who).is_some_and(|progress| progress.run_id == run_id)))
    }

    fn missing(&self, run_id: u64) -> String {
        let absent = |who: &&(u32, u32)| self.told.get(who).is_none_or(|progress| progress.run_id != run_id);
        let names = self.expected.iter().filter(absent).map(|(role, index)| {
            Role::from_number(*role).map_or_else(String::new, |role| format!("{} {index}", role.word()))
        });
        names.collect::<Vec<_>>().join(", ")
    }

    fn all_done(&mut self, run_id: u64) -> Result<bool, BusError> {
        self.update()?;
        let done =
            |who| self.told.get(who).is_some_and(|progress: &Progress| progress.run_id == run_id && progress.done == 1);
        Ok(self.expected.iter().all(done))
    }

    /// Waits until the slowest reader has left room for one more frame than `published`, or for a stop.
    ///
    /// A reader that does not move for long is dead or stuck: the stream then goes on without it.
    fn wait_for_room(&mut self, run_id: u64, published: Range<u64>, stop: &Stop) -> Result<(), BusError> {
        let mut patience = Patience::new(STUCK);
        while !stop.requested() && !patience.is_over() {
            if self.update()? {
                patience.renew();
            }
            let behind = |who| {
                self.told.get(who).is_some_and(|progress: &Progress| {
                    let reached = progress.next_sequence.max(published.start);
                    progress.run_id == run_id && reached.saturating_add(self.window) <= published.end
                })
            };
            if !self.paced_by.iter().any(behind) {
                break;
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        Ok(())
    }
}
