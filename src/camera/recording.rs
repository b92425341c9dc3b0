//! A recording as a camera: its frames again, at any pace.

use super::delivery::Delivery;
use super::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::image::FrameMeta;
use crate::recording::{Frames, Recording, RecordingError};
use bytes::Bytes;
use std::cmp::Ordering;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// How fast a recording is played.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlaybackRate {
    /// As fast as the frames are taken; nothing is ever lost.
    Max,
    /// This many times as fast as it was filmed: 1 is real time.
    Times(f64),
}

/// Whether a recording ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Repeat {
    /// After its last frame.
    #[default]
    Once,
    /// Never: it begins again, with the epoch raised. Stamps and sequence numbers repeat unchanged.
    Forever,
}

/// A part of a recording: from `from_s` on and before `to_s`, seconds from its first frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Where it begins.
    pub from_s: f64,
    /// Where it ends; the frame there no longer belongs to it.
    pub to_s: f64,
}

impl Span {
    /// The whole recording.
    pub const ALL: Self = Self { from_s: 0.0, to_s: f64::INFINITY };

    /// Whether a frame comes before, within or after it; `first_ns` is the stamp of the recording's first frame.
    pub fn place(&self, first_ns: u64, stamp_ns: u64) -> Ordering {
        // Compared in whole nanoseconds, so that 0.003 s is the frame at 3 ms.
        let since_ns = stamp_ns.saturating_sub(first_ns);
        let ns = |seconds: f64| (seconds * 1e9).round() as u64;
        match () {
            () if since_ns < ns(self.from_s) => Ordering::Less,
            () if since_ns < ns(self.to_s) => Ordering::Equal,
            () => Ordering::Greater,
        }
    }
}

/// Plays a recording with its original stamps and sequence numbers.
#[derive(Debug)]
pub struct RecordingCamera {
    recording: Recording,
    frames: Frames,
    format: StreamFormat,
    rate: PlaybackRate,
    repeat: Repeat,
    span: Span,
    /// Stamp of the recording's first frame.
    first_ns: u64,
    slots: VecDeque<Slot>,
    /// Read, but not yet due or without a slot.
    pending: Option<(FrameMeta, Bytes)>,
    /// When the first frame of this pass was due, and its stamp.
    origin: Option<(Instant, u64)>,
    /// When the pending frame is due, at a pace of its own, and how long it took to read.
    due: Option<Instant>,
    reading: Duration,
    delivery: Delivery,
    /// Added to the recorded epochs.
    epoch_base: u32,
    epoch_highest: u32,
    /// Added to the recorded stamps.
    shift_ns: i64,
    is_stepped: bool,
    /// Frames before this one are passed over.
    begin: u64,
    /// A word for each frame that may go, once started.
    steps: Option<Receiver<()>>,
}

impl RecordingCamera {
    /// Opens a recording for playing.
    ///
    /// The frame rate in [`format`](Camera::format) is that of the recording,
    /// whatever the playback rate; 0 when one frame does not tell any.
    ///
    /// # Errors
    ///
    /// [`CameraError::Recording`] when the file cannot be read or holds no
    /// frames; [`CameraError::Setting`] when the rate is not a positive number.
    pub fn open(path: &Path, rate: PlaybackRate, repeat: Repeat) -> Result<Self, CameraError> {
        Self::play(Recording::open(path)?, rate, repeat)
    }

    /// As [`open`](Self::open), of a recording that is open.
    ///
    /// # Errors
    ///
    /// As [`open`](Self::open).
    pub fn play(recording: Recording, rate: PlaybackRate, repeat: Repeat) -> Result<Self, CameraError> {
        if let PlaybackRate::Times(times) = rate
            && !(times.is_finite() && times > 0.0)
        {
            let (feature, reason) = ("rate".into(), "a positive number, or max".into());
            return Err(CameraError::Setting { feature, value: times.to_string(), reason });
        }
        let first = recording.first_frame()?;
        // What the camera was set to, as analysis takes it; stamps tell it only to the nanosecond. An unreadable last
        // frame is told when playing gets there.
        let told = recording.metadata().get("frame_rate_hz").and_then(|text| text.parse().ok());
        let told = told.filter(|rate_hz: &f64| rate_hz.is_finite() && *rate_hz > 0.0);
        let frame_rate_hz = told.or_else(|| recording.frame_rate_hz().ok().flatten()).unwrap_or(0.0);
        let format = StreamFormat {
            width_px: first.width_px,
            height_px: first.height_px,
            format: first.format,
            frame_rate_hz,
            exposure_us: recording.exposure_us(),
        };
        let frames = recording.frames()?;
        Ok(Self {
            recording,
            frames,
            format,
            rate,
            repeat,
            span: Span::ALL,
            first_ns: first.stamp_ns,
            slots: VecDeque::new(),
            pending: None,
            origin: None,
            due: None,
            reading: Duration::ZERO,
            delivery: Delivery::default(),
            epoch_base: 0,
            epoch_highest: 0,
            shift_ns: 0,
            is_stepped: false,
            begin: 0,
            steps: None,
        })
    }

    /// The same, each stamp later by this much.
    pub fn shifted(self, shift_ns: i64) -> Self {
        Self { shift_ns, ..self }
    }

    /// The same, each frame waiting for a line on standard input, with whose end the film ends too.
    pub fn stepped(self) -> Self {
        Self { is_stepped: true, ..self }
    }

    /// The same, playing only this part.
    pub fn within(self, span: Span) -> Self {
        Self { span, ..self }
    }

    /// The next frame of the part that is played.
    fn next_within(&mut self) -> Option<Result<(FrameMeta, Bytes), RecordingError>> {
        loop {
            let frame = self.frames.next_shared()?;
            if frame.as_ref().is_ok_and(|(meta, _)| meta.sequence < self.begin) {
                continue;
            }
            let place =
                frame.as_ref().map_or(Ordering::Equal, |(meta, _)| self.span.place(self.first_ns, meta.stamp_ns));
            match place {
                Ordering::Less => {}
                Ordering::Equal => return Some(frame),
                Ordering::Greater => return None,
            }
        }
    }

    /// The recording being played, for its configuration and truth.
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Makes sure a frame is pending; `false` at the end.
    fn fetch(&mut self) -> Result<bool, CameraError> {
        if self.pending.is_some() {
            return Ok(true);
        }
        let begun = now();
        let mut next = self.next_within();
        if next.is_none() && self.repeat == Repeat::Forever {
            self.frames = self.recording.frames()?;
            self.epoch_base = self.epoch_highest.saturating_add(1);
            self.origin = None;
            next = self.next_within();
        }
        let Some(frame) = next else { return Ok(false) };
        let (mut meta, pixels) = frame?;
        let shape = (meta.width_px, meta.height_px, meta.format);
        if shape != (self.format.width_px, self.format.height_px, self.format.format) {
            return Err(CameraError::Recording(RecordingError::Invalid {
                path: self.recording.path().to_path_buf(),
                reason: format!(
                    "frame {} is {}x{} {}, the first one {}x{} {}",
                    meta.sequence,
                    meta.width_px,
                    meta.height_px,
                    meta.format.word(),
                    self.format.width_px,
                    self.format.height_px,
                    self.format.format.word()
                ),
            }));
        }
        meta.epoch = meta.epoch.saturating_add(self.epoch_base);
        self.epoch_highest = self.epoch_highest.max(meta.epoch);
        meta.stamp_ns = meta.stamp_ns.saturating_add_signed(self.shift_ns);
        self.pending = Some((meta, pixels));
        self.reading = now().saturating_duration_since(begun);
        Ok(true)
    }

    /// Sleeps until the frame is due, at most `timeout`; whether it is due then.
    fn wait(&mut self, stamp_ns: u64, timeout: Duration) -> bool {
        let PlaybackRate::Times(times) = self.rate else { return true };
        if self.is_stepped {
            return true;
        }
        let now = now();
        let (start, first_ns) = *self.origin.get_or_insert((now, stamp_ns));
        let ahead_s = stamp_ns.saturating_sub(first_ns) as f64 * 1e-9 / times;
        let due = Duration::try_from_secs_f64(ahead_s).unwrap_or(Duration::MAX);
        let left = due.saturating_sub(now.saturating_duration_since(start));
        self.due = start.checked_add(due);
        std::thread::sleep(left.min(timeout));
        left <= timeout
    }

    /// A frame that was copied into its slot since `begun` is there.
    fn delivered(&mut self, begun: Instant) {
        let Some(due) = self.due else { return };
        // What was read before it was due kept nobody waiting.
        let reading = self.reading.min(begun.saturating_duration_since(due));
        self.delivery.add(due, reading + now().saturating_duration_since(begun));
    }
}

#[expect(clippy::disallowed_methods, reason = "playing at a given pace is what a camera's clock does")]
fn now() -> Instant {
    Instant::now()
}

/// Tells of every line on standard input; hangs up at its end.
fn lines() -> Receiver<()> {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let lines = std::io::stdin().lines().map_while(Result::ok);
        // Nobody listens any more once the camera is gone.
        let _ = lines.map(|_| ()).try_for_each(|()| sender.send(()));
    });
    receiver
}

/// Copies rows, leaving out what a row has beyond its pixels when the slot has no room for it.
fn copy(meta: &mut FrameMeta, pixels: &[u8], slot: &mut [u8]) -> bool {
    if pixels.len() <= slot.len() {
        slot[..pixels.len()].copy_from_slice(pixels);
        return true;
    }
    let row_bytes = meta.width_px as usize * meta.format.bytes_per_pixel();
    if row_bytes * meta.height_px as usize > slot.len() {
        return false;
    }
    for (row, target) in pixels.chunks_exact(meta.stride_bytes as usize).zip(slot.chunks_exact_mut(row_bytes)) {
        target.copy_from_slice(&row[..row_bytes]);
    }
    meta.stride_bytes = row_bytes as u32;
    true
}

impl Camera for RecordingCamera {
    fn format(&self) -> StreamFormat {
        self.format
    }

    fn identity(&self) -> CameraIdentity {
        let entry = |key| self.recording.metadata().get(key).cloned().unwrap_or_default();
        CameraIdentity { model: entry("camera"), serial: entry("serial") }
    }

    fn pace(&self) -> Pace {
        match self.rate {
            _ if self.is_stepped => Pace::OnDemand,
            PlaybackRate::Max => Pace::OnDemand,
            PlaybackRate::Times(_) => Pace::Live,
        }
    }

    fn slots(&self) -> usize {
        1
    }

    fn queue(&mut self, slot: Slot) {
        self.slots.push_back(slot);
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.origin = None;
        if self.is_stepped && self.steps.is_none() {
            self.steps = Some(lines());
        }
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        if !self.fetch()? {
            return Ok(Next::End);
        }
        let Some(stamp_ns) = self.pending.as_ref().map(|(meta, _)| meta.stamp_ns) else { return Ok(Next::End) };
        if self.slots.is_empty() || !self.wait(stamp_ns, timeout) {
            return Ok(Next::Nothing);
        }
        match self.steps.as_ref().map(|steps| steps.recv_timeout(timeout)) {
            None | Some(Ok(())) => {}
            Some(Err(RecvTimeoutError::Timeout)) => return Ok(Next::Nothing),
            Some(Err(RecvTimeoutError::Disconnected)) => return Ok(Next::End),
        }
        let Some(((mut meta, pixels), mut slot)) = self.pending.take().zip(self.slots.pop_front()) else {
            return Ok(Next::Nothing);
        };
        let begun = now();
        if !copy(&mut meta, &pixels, slot.bytes_mut()) {
            let reason = format!("frame {} has {} bytes, the slot {}", meta.sequence, pixels.len(), slot.len());
            return Ok(Next::Torn(slot, reason));
        }
        self.delivered(begun);
        Ok(Next::Frame(slot, meta))
    }

    fn go_to(&mut self, sequence: u64) -> bool {
        self.begin = sequence;
        true
    }

    fn waited(&self) -> Duration {
        self.delivery.waited(now())
    }

    fn truth(&self, _sequence: u64) -> Vec<crate::results::VelocitySample> {
        Vec::new()
    }
}
