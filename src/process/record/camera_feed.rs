//! The recorder's input from one camera.

use crate::bus::{Bus, BusError, FieldSubscriber, FrameSample, FrameSubscriber, Limits, Subscriber};
use crate::camera::{CameraIdentity, StreamFormat};
use crate::config::{Config, TriggerMode};
use crate::failure::Failure;
use crate::message::{Event, EventKind, Progress, Role};
use crate::process::frame_stamp::FrameStamp;
use crate::process::launch::Launch;
use crate::process::resume::NewestFrameFile;
use crate::process::setup::{
    SUCCESSION_TIMEOUT, analysis_params, expected_format, limits, truth_world, update_exposure,
};
use crate::process::status_reporter::StatusReporter;
use crate::process::stream_state::StreamState;
use crate::results::{BodyStep, PairField};
use crate::synth::SimulatedFilm;
use crate::track::TrackerParams;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

/// A camera's frames and measured steps.
pub(super) struct CameraFeed<'a> {
    /// Name of the view; empty for the main camera.
    pub(super) name: String,
    pub(super) config: &'a Config,
    pub(super) frames: FrameSubscriber,
    pub(super) fields: FieldSubscriber,
    pub(super) reporter: StatusReporter,
    pub(super) stream: StreamState,
    pub(super) params: TrackerParams,
    /// Ground truth of a simulated camera; made before frames come, because it takes a tenth of a second of a
    /// processor.
    pub(super) truth: Option<Rc<SimulatedFilm>>,
    pub(super) format: StreamFormat,
    pub(super) limits: Limits,
    /// Frames that were taken out of the queue and are not written yet; they stay in the ring.
    pub(super) held: VecDeque<FrameSample>,
    /// The newest frame that the workers have left out because they are too slow.
    pub(super) newest_skipped: Option<u64>,
    /// Steps that belong to the next shot.
    pub(super) early: Vec<(BodyStep, Option<PairField>)>,
    pub(super) identity: CameraIdentity,
    /// The newest frame that was written.
    pub(super) newest: FrameStamp,
    /// Whether this process replaces a dead recorder.
    pub(super) resumed: bool,
    /// The current run, after those that it continues.
    runs: Vec<u64>,
    /// Whether readiness for the current run was published.
    is_ready_published: bool,
    /// One past the last frame that a dead predecessor wrote.
    pub(super) predecessor_end: Option<u64>,
    /// The newest frame that was handed to the system, for a successor.
    reached: NewestFrameFile,
    progress: Subscriber<Progress>,
    /// The latest progress of each worker.
    workers: BTreeMap<u32, Progress>,
    // Dropped last: it holds the recorder's role.
    pub(super) bus: Bus,
}

impl<'a> CameraFeed<'a> {
    /// Joins the rig of a camera as its recorder, and opens its topics.
    pub(super) fn open(name: &str, config: &'a Config, launch: &Launch) -> Result<Self, Failure> {
        let format = expected_format(config)?;
        config.check_ring(format.slot_bytes(), format.frame_rate_hz)?;
        config.check_calibration(format.width_px, format.height_px)?;
        let limits = limits(config, &format);
        let bus = Bus::join_as(&config.rig.name, Role::Record.as_str(), SUCCESSION_TIMEOUT, launch.domain.as_ref())?;
        let (reached, previous) = NewestFrameFile::open(&bus.private_file(Role::Record.as_str()))?;
        let previous = previous.filter(|_| launch.is_restart);
        Ok(Self {
            name: name.to_owned(),
            frames: bus.frame_subscriber(&limits)?,
            fields: bus.field_subscriber(&limits)?,
            reporter: StatusReporter::new(&bus, &limits, Role::Record, 0)?,
            stream: StreamState::new(&bus, &limits)?,
            params: analysis_params(config, &format).1,
            truth: truth_world(config)?.map(Rc::new),
            held: VecDeque::new(),
            newest_skipped: None,
            early: Vec::new(),
            identity: CameraIdentity::default(),
            newest: FrameStamp::default(),
            runs: Vec::new(),
            is_ready_published: true,
            config,
            format,
            limits,
            resumed: launch.is_restart,
            predecessor_end: previous.map(|(resume, _)| resume.sequence + 1),
            reached,
            progress: bus.subscriber(&limits)?,
            workers: BTreeMap::new(),
            bus,
        })
    }

    /// Whether its camera is prepared.
    pub(super) fn is_prepared(&self) -> bool {
        self.stream.run_id.is_some()
    }

    /// Whether workers measure it.
    pub(super) fn is_measured(&self) -> bool {
        self.config.workers.count > 0
    }

    /// Returns the tracker parameters, if workers measure it.
    pub(super) fn tracker_params(&self) -> Option<&TrackerParams> {
        self.is_measured().then_some(&self.params)
    }

    /// Returns the number of newer frames after which a missing step is given up.
    pub(super) fn max_delay_frames(&self) -> u64 {
        (self.limits.ring_frames + self.limits.held_frames) as u64 + 512
    }

    /// Returns the frame period, ns.
    pub(super) fn period_ns(&self) -> f64 {
        1e9 / self.format.frame_rate_hz
    }

    /// Returns the number of frames per block.
    pub(super) fn block_frames(&self) -> u64 {
        u64::from(self.config.workers.block_frames)
    }

    /// Saves the newest written frame for a successor, after all written frames were handed to the system.
    pub(super) fn note_written(&mut self) {
        if self.newest != FrameStamp::default() {
            self.reached.save(self.newest, 0);
        }
    }

    /// Reads the progress messages and keeps the newest one of each correlation worker.
    pub(super) fn update_progress(&mut self) -> Result<(), BusError> {
        while let Some(progress) = self.progress.take()? {
            if progress.role == Role::Correlate as u32 {
                self.workers.insert(progress.index, progress);
            }
        }
        Ok(())
    }

    /// Whether every worker has published all its steps before `end`, so that a missing one will never come.
    ///
    /// A block is measured once the frames that its last pairs reach into have come.
    pub(super) fn is_measured_before(&self, end: u64) -> bool {
        let reach = self.params.intervals_frames().max().unwrap_or(1);
        let needed = end.next_multiple_of(self.block_frames()) + u64::from(reach) + 1;
        // A worker that was restarted reports no frame before its first one.
        let has_passed = |progress: &Progress| {
            let is_past = progress.next_sequence >= needed && progress.next_sequence < u64::MAX;
            self.takes(progress.run_id) && (progress.done == 1 || is_past)
        };
        (0..self.config.workers.count).all(|index| self.workers.get(&index).is_some_and(has_passed))
    }

    /// Returns the prefix of messages about this camera: its name and a colon; empty for the main camera.
    pub(super) fn prefix(&self) -> String {
        if self.name.is_empty() { String::new() } else { format!("{}: ", self.name) }
    }

    /// Attaches to a newly announced run. A run that continues the previous one keeps its held frames.
    pub(super) fn attach(&mut self) {
        if !self.stream.continues {
            self.held.clear();
            self.early.clear();
            self.newest_skipped = None;
            self.runs.clear();
        }
        // Only the run it was started into was partly recorded by a predecessor.
        self.resumed &= self.reporter.run_id() == 0;
        self.frames.update_connections();
        self.fields.update_connections();
        let run_id = self.stream.run_id.unwrap_or(0);
        self.runs.push(run_id);
        self.reporter.set_run(run_id);
        self.is_ready_published = false;
    }

    /// Publishes the recorder's readiness, once per run. The camera waits for a recorder of a whole stream, unless that
    /// recorder was restarted; for others it does not wait, which `u64::MAX` states.
    pub(super) fn publish_ready(&mut self) -> Result<(), BusError> {
        if std::mem::replace(&mut self.is_ready_published, true) {
            return Ok(());
        }
        let paced = self.config.trigger.mode == TriggerMode::Off && !self.resumed;
        self.reporter.publish_progress(if paced { 0 } else { u64::MAX })
    }

    /// Whether frames and steps of this run are accepted.
    pub(super) fn takes(&self, run_id: u64) -> bool {
        self.runs.contains(&run_id)
    }

    /// Returns the next step of an accepted run and its field; `None` if there is no further step.
    pub(super) fn next_step(&mut self) -> Result<Option<(BodyStep, Option<PairField>)>, BusError> {
        while let Some((header, field)) = self.fields.take()? {
            if header.skipped_frames == 1 && self.takes(header.run_id) {
                self.newest_skipped = self.newest_skipped.max(Some(header.sequence));
                continue;
            }
            if let (true, Some(step)) = (self.takes(header.run_id), header.step()) {
                return Ok(Some((step, field)));
            }
        }
        Ok(None)
    }

    /// Reads the camera's identity from an event that announces a run; other events have no effect.
    pub(super) fn handle_event(&mut self, event: &Event) {
        if event.kind() == Some(EventKind::Prepared) {
            let text = event.text();
            let (model, serial) = text.split_once('\n').unwrap_or((&text, ""));
            self.identity = CameraIdentity { model: model.to_owned(), serial: serial.to_owned() };
        }
    }

    /// Takes frames out of the queue without writing them, so that the camera cannot overwrite them, up to one for
    /// which `is_last` holds.
    ///
    /// Beyond `max` held frames the others stay in the queue. The recorder may lose those, but holding the whole
    /// ring would leave the camera no slot. Frames of other runs are dropped.
    pub(super) fn hold_frames(&mut self, max: usize, is_last: impl Fn(&FrameSample) -> bool) -> Result<(), BusError> {
        while self.held.len() < max && !self.held.back().is_some_and(&is_last) {
            let Some(sample) = self.frames.take()? else { break };
            if self.takes(sample.header().run_id) {
                if update_exposure(self.config, &mut self.format, sample.header().exposure_ns) {
                    self.params = analysis_params(self.config, &self.format).1;
                }
                self.held.push_back(sample);
            }
        }
        Ok(())
    }

    /// Returns the first frame of a shot that starts at this time, and drops the frames before it. If it has not
    /// arrived yet, returns `None` and keeps only the newest block of frames.
    ///
    /// A shot starts with the block of that frame, because blocks are measured independently. If the block's first
    /// frame is gone, it starts with the next block.
    pub(super) fn first_from(&mut self, from_ns: u64) -> Option<u64> {
        // A hardware-triggered shot begins with its first frame.
        let block = if self.config.trigger.mode == TriggerMode::Hardware { 1 } else { self.block_frames() };
        let at = self.held.partition_point(|sample| sample.header().stamp_ns < from_ns);
        let Some(sequence) = self.held.get(at).map(|sample| sample.header().sequence) else {
            let spare = self.held.len().saturating_sub(block as usize);
            self.held.drain(..spare);
            return None;
        };
        let (wanted, oldest) = (sequence / block * block, self.held.front()?.header().sequence);
        let first = if wanted >= oldest { wanted } else { oldest.next_multiple_of(block) };
        self.held.retain(|sample| sample.header().sequence >= first);
        Some(first)
    }
}
