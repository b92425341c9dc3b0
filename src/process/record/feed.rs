//! What the recorder takes from one camera.

use crate::bus::{Bus, BusError, FieldSubscriber, FrameSample, FrameSubscriber, Limits};
use crate::camera::{CameraIdentity, StreamFormat};
use crate::config::{Config, TriggerMode};
use crate::message::{Event, EventKind, Role};
use crate::process::report::Reporter;
use crate::process::rig::{SUCCESSION, analysis_params, expected_format, learn_exposure, limits, truth_world};
use crate::process::stream::Stream;
use crate::results::{BodyStep, PairField};
use crate::synth::World;
use crate::track::TrackerParams;
use std::collections::VecDeque;
use std::rc::Rc;

/// A camera's ring and what is measured of it.
pub(super) struct Feed<'a> {
    /// What the camera is called; empty for the first.
    pub(super) name: String,
    pub(super) config: &'a Config,
    pub(super) frames: FrameSubscriber,
    pub(super) fields: FieldSubscriber,
    pub(super) reporter: Reporter,
    pub(super) stream: Stream,
    pub(super) params: TrackerParams,
    /// Of a simulated camera; made before frames come, as it takes a tenth of a second of a processor.
    pub(super) truth: Option<Rc<World>>,
    pub(super) format: StreamFormat,
    pub(super) limits: Limits,
    pub(super) held: VecDeque<FrameSample>,
    /// Steps of what comes after the shot under way, where that is another shot.
    pub(super) early: Vec<(BodyStep, Option<PairField>)>,
    pub(super) identity: CameraIdentity,
    pub(super) newest: (u64, u64),
    /// Whether another recorder was there before and died.
    pub(super) resumed: bool,
    /// The run at hand, after those that it goes on from.
    runs: Vec<u64>,
    /// Whether its camera was told that the recorder is ready for this run.
    is_greeted: bool,
}

impl<'a> Feed<'a> {
    /// Joins the rig of a camera; with the first one comes its bus.
    pub(super) fn open(name: &str, config: &'a Config, resumed: bool) -> anyhow::Result<(Self, Bus)> {
        let format = expected_format(config)?;
        config.check_ring(format.slot_bytes(), format.frame_rate_hz)?;
        config.check_calibration(format.width_px, format.height_px)?;
        let limits = limits(config, &format);
        let bus = Bus::take_part(&config.rig.name, Role::Record.word(), SUCCESSION)?;
        let feed = Self {
            name: name.to_owned(),
            frames: bus.frame_subscriber(&limits)?,
            fields: bus.field_subscriber(&limits)?,
            reporter: Reporter::new(&bus, &limits, Role::Record, 0)?,
            stream: Stream::new(&bus, &limits)?,
            params: analysis_params(config, &format).1,
            truth: truth_world(config)?.map(Rc::new),
            held: VecDeque::new(),
            early: Vec::new(),
            identity: CameraIdentity::default(),
            newest: (0, 0),
            runs: Vec::new(),
            is_greeted: true,
            config,
            format,
            limits,
            resumed,
        };
        Ok((feed, bus))
    }

    /// Whether its camera was prepared.
    pub(super) fn is_prepared(&self) -> bool {
        self.stream.run_id.is_some()
    }

    /// Whether anything is measured of it.
    pub(super) fn is_measured(&self) -> bool {
        self.config.workers.count > 0
    }

    /// What its steps are put together with, if there are any.
    pub(super) fn measured_with(&self) -> Option<&TrackerParams> {
        self.is_measured().then_some(&self.params)
    }

    /// How much newer a step must be before a missing one is given up, frames.
    pub(super) fn patience_frames(&self) -> u64 {
        (self.limits.ring_frames + self.limits.held_frames) as u64 + 512
    }

    /// Time from a frame to the next, ns.
    pub(super) fn period_ns(&self) -> f64 {
        1e9 / self.format.frame_rate_hz
    }

    /// Frames of a block.
    pub(super) fn block(&self) -> u64 {
        u64::from(self.config.workers.block_frames)
    }

    /// What it is called in front of something that is told of it.
    pub(super) fn prefix(&self) -> String {
        if self.name.is_empty() { String::new() } else { format!("{}: ", self.name) }
    }

    /// Takes up a run that was announced; one that goes on from the one before leaves what was held of that.
    pub(super) fn attach(&mut self) {
        if !self.stream.goes_on {
            self.held.clear();
            self.early.clear();
            self.runs.clear();
        }
        // Only the run it was started into has a predecessor's part.
        self.resumed &= self.reporter.run_id() == 0;
        self.frames.greet();
        self.fields.greet();
        let run_id = self.stream.run_id.unwrap_or(0);
        self.runs.push(run_id);
        self.reporter.set_run(run_id);
        self.is_greeted = false;
    }

    /// Tells the camera that the recorder is ready, once a run.
    pub(super) fn greet(&mut self) -> Result<(), BusError> {
        if std::mem::replace(&mut self.is_greeted, true) {
            return Ok(());
        }
        let paced = self.config.trigger.mode == TriggerMode::Off && !self.resumed;
        self.reporter.progress(if paced { 0 } else { u64::MAX }, false)
    }

    /// Whether frames and steps of this run are taken.
    pub(super) fn takes(&self, run_id: u64) -> bool {
        self.runs.contains(&run_id)
    }

    /// The next step of the runs that are taken, those that came early first.
    pub(super) fn next_step(&self) -> Result<Option<(BodyStep, Option<PairField>)>, BusError> {
        while let Some((header, field)) = self.fields.take()? {
            if let (true, Some(step)) = (self.takes(header.run_id), header.step()) {
                return Ok(Some((step, field)));
            }
        }
        Ok(None)
    }

    /// Learns which camera it is.
    pub(super) fn learn(&mut self, event: &Event) {
        if event.kind() == Some(EventKind::Prepared) {
            let text = event.text();
            let (model, serial) = text.split_once('\n').unwrap_or((&text, ""));
            self.identity = CameraIdentity { model: model.to_owned(), serial: serial.to_owned() };
        }
    }

    /// Takes frames out of the queue without writing them, so that the camera cannot overwrite them, up to one that
    /// says that it is enough.
    ///
    /// Beyond `most` held frames they stay in the queue: what it cannot keep is this recorder's loss, where a ring held
    /// as a whole would leave the camera no slot.
    pub(super) fn hold(&mut self, most: usize, is_enough: impl Fn(&FrameSample) -> bool) -> Result<(), BusError> {
        while self.held.len() < most && !self.held.back().is_some_and(&is_enough) {
            let Some(sample) = self.frames.take()? else { break };
            if self.takes(sample.header().run_id) {
                if learn_exposure(self.config, &mut self.format, sample.header().exposure_ns) {
                    self.params = analysis_params(self.config, &self.format).1;
                }
                self.held.push_back(sample);
            }
        }
        Ok(())
    }

    /// Where a shot begins that shall have everything from this moment on: with a block, since blocks are measured on
    /// their own, and earlier rather than later. What lies before goes; `None` while that is not known yet.
    pub(super) fn first_from(&mut self, from_ns: u64) -> Option<u64> {
        // What a line fires begins with its first frame.
        let block = if self.config.trigger.mode == TriggerMode::Hardware { 1 } else { self.block() };
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
