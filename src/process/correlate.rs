//! Blocks of frames to displacement fields.

use super::clock::{Patience, now};
use super::reference;
use super::report::Reporter;
use super::rig::{SUCCESSION, analysis_params, expected_format, limits};
use super::stop::Stop;
use super::stream::Stream;
use super::summary::Summary;
use crate::bus::{Bell, Bus, BusError, FieldPublisher, FrameSubscriber, Subscriber};
use crate::camera::StreamFormat;
use crate::config::Config;
use crate::image::Frame;
use crate::measure::{Measured, Measurer, Share};
use crate::message::{FieldHeader, Progress, Role};
use std::time::Duration;

const WAIT: Duration = Duration::from_millis(2);
/// How long results stay readable for a tracker or recorder that is still at work.
const LINGER: Duration = Duration::from_secs(30);

/// Measures every `workers.count`-th block of frames, as worker `index`, until the stream ends.
///
/// `resumed` says that another worker of this index was there before and died.
///
/// # Errors
///
/// When the configuration cannot be measured with, or shared memory cannot be used.
pub fn run(config: &Config, index: u32, mut resumed: bool, stop: &Stop) -> anyhow::Result<Summary> {
    let format = expected_format(config)?;
    config.check_calibration(format.width_px, format.height_px)?;
    let limits = limits(config, &format);
    let bus = Bus::take_part(&config.rig.name, &format!("{}-{index}", Role::Correlate.word()), SUCCESSION)?;
    let mut reporter = Reporter::new(&bus, &limits, Role::Correlate, index)?;
    reporter.set_queue(0, limits.ring_frames as u64);
    let mut worker = Worker {
        config,
        frames: bus.frame_subscriber(&limits)?,
        fields: bus.field_publisher(&limits)?,
        bell: bus.bell("field")?,
        reporter,
        measurer: plan(config, index, &format)?,
        summary: Summary::default(),
        measured: Vec::new(),
        index,
        wants_reference: false,
        next: None,
        shot: 0,
        is_ended: true,
        block_frames: u64::from(config.workers.block_frames),
        is_late: false,
        from: 0,
        stamp_ns: 0,
        exposure_ns: 0,
    };
    worker.wants_reference = worker.measurer.needs_reference();
    worker.measurer.rehearse()?;
    let mut recorded = Recorded { progress: bus.subscriber(&limits)?, done: None, expected: config.record.is_some() };
    let ear = bus.ear("frames")?;
    let mut stream = Stream::new(&bus, &limits)?;
    while !stop.requested() {
        if stream.update()? {
            worker.attach(&stream, resumed, stop)?;
            resumed = false;
        }
        let ended = stream.end.is_some();
        worker.drain(stop)?;
        worker.end_shot(&stream)?;
        if ended {
            worker.finish(&stream)?;
            linger(&mut recorded, &mut stream, stop)?;
            break;
        }
        worker.tell()?;
        recorded.is_over(stream.run_id)?;
        ear.wait(WAIT);
    }
    worker.tell_now()?;
    Ok(worker.summary)
}

fn plan(config: &Config, index: u32, format: &StreamFormat) -> anyhow::Result<Measurer> {
    let (params, _) = analysis_params(config, format);
    let share = Share { index, of: config.workers.count };
    Ok(Measurer::new(&params, share, format.width_px as usize, format.height_px as usize)?)
}

struct Worker<'a> {
    config: &'a Config,
    frames: FrameSubscriber,
    fields: FieldPublisher,
    bell: Bell,
    reporter: Reporter,
    measurer: Measurer,
    summary: Summary,
    measured: Vec<Measured>,
    index: u32,
    /// Whether the picture in which patches were drawn is still to come.
    wants_reference: bool,
    next: Option<u64>,
    /// The shot that the newest frame belongs to, of a camera that waits for its line, and whether it was ended.
    shot: u32,
    is_ended: bool,
    /// Frames of a block.
    block_frames: u64,
    /// Whether the stream began without this worker.
    is_late: bool,
    /// Frames before this one belong to a block whose beginning was missed.
    from: u64,
    stamp_ns: u64,
    exposure_ns: u32,
}

impl Worker<'_> {
    /// Maps the ring of a run that was announced and tells that frames may come.
    fn attach(&mut self, stream: &Stream, resumed: bool, stop: &Stop) -> anyhow::Result<()> {
        if stream.goes_on && self.reporter.run_id() != 0 {
            // What the camera's process that died left in the ring is measured to its end.
            self.drain(stop)?;
            self.measurer.finish(&mut self.measured);
            self.publish()?;
        }
        self.frames.greet();
        self.measurer.reset();
        (self.shot, self.is_ended) = (0, true);
        self.next = None;
        self.is_late = resumed || stream.first.is_some();
        self.from = 0;
        self.reporter.set_run(stream.run_id.unwrap_or(0));
        // One that died left no trace of how far it was: nobody shall wait for what it will never do.
        let reached = if self.is_late { u64::MAX } else { 0 };
        Ok(self.reporter.progress(reached, false)?)
    }

    fn drain(&mut self, stop: &Stop) -> anyhow::Result<()> {
        let mut told = now();
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
                self.from = meta.sequence.next_multiple_of(self.block_frames);
            }
            self.next = Some(meta.sequence + 1);
            if header.shot != self.shot {
                self.finish_shot()?;
                self.shot = header.shot;
            }
            self.is_ended = false;
            self.stamp_ns = meta.stamp_ns;
            self.exposure_ns = header.exposure_ns;
            self.summary.taken += 1;
            if std::mem::take(&mut self.wants_reference) {
                let frame = Frame { meta, bytes: sample.bytes() };
                self.refer(&frame, is_first)?;
            }
            // A block measured from its middle on would not be what a replay measures.
            if meta.sequence >= self.from {
                self.measurer.push(&Frame { meta, bytes: sample.bytes() }, &mut self.measured)?;
            } else if self.measurer.needs(meta.sequence) {
                self.summary.lost += 1;
            }
            drop(sample);
            self.publish()?;
            if told.elapsed() >= Duration::from_millis(1) {
                self.reporter.progress(meta.sequence + 1, false)?;
                self.tell()?;
                told = now();
            }
        }
        if let Some(next) = self.next {
            self.reporter.progress(next, false)?;
        }
        Ok(())
    }

    /// Measures a shot to its end when the camera has been silent after it.
    fn end_shot(&mut self, stream: &Stream) -> Result<(), BusError> {
        // One whose last frames passed by is ended by the next.
        let is_over = self.next.is_some() && self.next == stream.silences.back().copied();
        if is_over { self.finish_shot() } else { Ok(()) }
    }

    /// Nothing leads from this shot to the next.
    fn finish_shot(&mut self) -> Result<(), BusError> {
        if std::mem::replace(&mut self.is_ended, true) {
            return Ok(());
        }
        self.measurer.finish(&mut self.measured);
        self.measurer.reset();
        self.publish()
    }

    /// Takes the picture in which patches were drawn, if it can be had by now.
    fn refer(&mut self, frame: &Frame<'_>, is_first: bool) -> anyhow::Result<()> {
        match reference::obtain(self.config, frame, is_first) {
            Some(picture) => self.measurer.set_reference(&picture)?,
            None => self.wants_reference = true,
        }
        Ok(())
    }

    fn publish(&mut self) -> Result<(), BusError> {
        for measured in self.measured.drain(..) {
            let mut header =
                FieldHeader::new(&measured.step, measured.field.as_ref(), self.reporter.run_id(), self.index);
            header.exposure_ns = self.exposure_ns;
            self.fields.send(&header, measured.field.as_ref())?;
            self.summary.given += 1;
            self.bell.ring();
        }
        Ok(())
    }

    fn finish(&mut self, stream: &Stream) -> Result<(), BusError> {
        self.measurer.finish(&mut self.measured);
        self.publish()?;
        if let (Some(next), Some(end)) = (self.next, stream.end) {
            self.summary.lost += end.saturating_sub(next);
        }
        self.reporter.progress(stream.end.unwrap_or(0), true)
    }

    fn tell(&mut self) -> Result<(), BusError> {
        self.reporter.status(&self.summary, self.next.unwrap_or(1) - 1, self.stamp_ns)
    }

    fn tell_now(&mut self) -> Result<(), BusError> {
        self.reporter.status_now(&self.summary, self.next.unwrap_or(1) - 1, self.stamp_ns)
    }
}

/// Whether the recorder has read everything of a run.
struct Recorded {
    progress: Subscriber<Progress>,
    /// The newest run it is done with; `None` as long as it is expected to come.
    done: Option<u64>,
    expected: bool,
}

impl Recorded {
    fn is_over(&mut self, run_id: Option<u64>) -> Result<bool, BusError> {
        while let Some(told) = self.progress.take()? {
            if told.role == Role::Record as u32 && told.done == 1 {
                self.done = Some(told.run_id);
            }
        }
        Ok(!self.expected || self.done == run_id)
    }
}

/// Stays until tracker and recorder have read everything.
fn linger(recorded: &mut Recorded, stream: &mut Stream, stop: &Stop) -> Result<(), BusError> {
    let patience = Patience::new(LINGER);
    while !stop.requested() && !patience.is_over() {
        stream.update()?;
        if recorded.is_over(stream.run_id)? && stream.tracked {
            break;
        }
        std::thread::sleep(WAIT);
    }
    Ok(())
}
