//! A recording replayed as a camera, at any speed.

use super::delivery_latency::DeliveryLatency;
use super::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::image::{FrameMeta, PixelFormat};
use crate::recording::{Frames, Recording, RecordingError};
use bytes::Bytes;
use std::cmp::Ordering;
use std::collections::VecDeque;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// The playback speed of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlaybackRate {
    /// At the speed of the consumer; no frame is lost.
    Max,
    /// A multiple of the recorded speed: 1 is real time.
    Times(f64),
    /// One frame per line on standard input. The stream ends with that input.
    Stepped,
}

/// A part of a recording: the half-open interval from `from_s` to `to_s`, in seconds after its first frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeRange {
    /// Start, s.
    pub from_s: f64,
    /// End (exclusive), s.
    pub to_s: f64,
}

impl TimeRange {
    /// The whole recording.
    pub const ALL: Self = Self { from_s: 0.0, to_s: f64::INFINITY };

    /// Returns whether a frame lies before (`Less`), within (`Equal`) or after (`Greater`) the range.
    ///
    /// `first_ns` is the stamp of the recording's first frame, `stamp_ns` that of the frame.
    pub fn locate(&self, first_ns: u64, stamp_ns: u64) -> Ordering {
        // Whole nanoseconds, so that 0.003 s is the frame at 3 ms.
        let since_ns = stamp_ns.saturating_sub(first_ns);
        let ns = |seconds: f64| (seconds * 1e9).round() as u64;
        match () {
            () if since_ns < ns(self.from_s) => Ordering::Less,
            () if since_ns < ns(self.to_s) => Ordering::Equal,
            () => Ordering::Greater,
        }
    }
}

/// The playback of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Playback {
    /// Playback speed.
    pub rate: PlaybackRate,
    /// The part that is played.
    pub range: TimeRange,
    /// Offset of every stamp, ns.
    pub shift_ns: i64,
}

impl Default for Playback {
    fn default() -> Self {
        Self { rate: PlaybackRate::Max, range: TimeRange::ALL, shift_ns: 0 }
    }
}

/// Replays a recording with its original stamps and sequence numbers.
#[derive(Debug)]
pub struct ReplayCamera {
    recording: Recording,
    frames: Frames,
    format: StreamFormat,
    playback: Playback,
    /// Stamp of the recording's first frame.
    first_ns: u64,
    slots: VecDeque<Slot>,
    /// Read, but not due yet or without a slot.
    pending: Option<(FrameMeta, Bytes)>,
    /// When the first frame since the start was due, and its stamp, ns.
    origin: Option<(Instant, u64)>,
    /// When the pending frame is due; `None` unless played at a given speed.
    due: Option<Instant>,
    /// The time that reading the pending frame took.
    reading: Duration,
    delivery: DeliveryLatency,
    /// Sequence number of the first frame to play; frames before it are skipped.
    first_sequence: u64,
    /// Receives one message per frame that may be published, once started.
    steps: Option<Receiver<()>>,
}

impl ReplayCamera {
    /// Prepares the replay of a recording.
    ///
    /// The frame rate in [`format`](Camera::format) is that of the recording, whatever the playback rate. It is 0 if
    /// the recording has a single frame and no recorded rate.
    ///
    /// # Errors
    ///
    /// [`CameraError::Recording`] if the recording cannot be read or holds no frames.
    /// [`CameraError::Setting`] if the playback rate is not a positive, finite number.
    pub fn new(recording: Recording, playback: Playback) -> Result<Self, CameraError> {
        if let PlaybackRate::Times(times) = playback.rate
            && !(times.is_finite() && times > 0.0)
        {
            let (feature, reason) = ("rate".into(), "a positive number, or max".into());
            return Err(CameraError::Setting { feature, value: times.to_string(), reason });
        }
        let first = recording.first_frame()?;
        // The configured rate comes first, as in offline analysis; stamps resolve the rate only to the
        // nanosecond. An unreadable last frame is reported when replay gets there.
        let recorded = recording.metadata().get("frame_rate_hz").and_then(|text| text.parse().ok());
        let recorded = recorded.filter(|rate_hz: &f64| rate_hz.is_finite() && *rate_hz > 0.0);
        let frame_rate_hz = recorded.or_else(|| recording.frame_rate_hz().ok().flatten()).unwrap_or(0.0);
        let format = StreamFormat {
            width_px: first.width_px,
            height_px: first.height_px,
            format: first.format,
            frame_rate_hz,
            exposure_us: recording.exposure_us(),
            coding: recording.coding(),
        };
        let frames = recording.frames()?;
        Ok(Self {
            recording,
            frames,
            format,
            playback,
            first_ns: first.stamp_ns,
            slots: VecDeque::new(),
            pending: None,
            origin: None,
            due: None,
            reading: Duration::ZERO,
            delivery: DeliveryLatency::default(),
            first_sequence: 0,
            steps: None,
        })
    }

    /// Reads the next frame within the range that is played, from `first_sequence` on; `None` at its end.
    ///
    /// A frame that cannot be read is returned as its error, wherever it lies.
    fn next_in_range(&mut self) -> Option<Result<(FrameMeta, Bytes), RecordingError>> {
        loop {
            let frame = self.frames.next_shared()?;
            if frame.as_ref().is_ok_and(|(meta, _)| meta.sequence < self.first_sequence) {
                continue;
            }
            let range = self.playback.range;
            match frame.as_ref().map_or(Ordering::Equal, |(meta, _)| range.locate(self.first_ns, meta.stamp_ns)) {
                Ordering::Less => {}
                Ordering::Equal => return Some(frame),
                Ordering::Greater => return None,
            }
        }
    }

    /// Reads the next frame into `pending`, unless one is there; returns `false` at the end.
    ///
    /// Shifts the frame's stamp by the playback's `shift_ns`, and measures the time that reading took.
    ///
    /// # Errors
    ///
    /// [`CameraError::Recording`] if the frame cannot be read or differs from the first in size or pixel format.
    fn fetch(&mut self) -> Result<bool, CameraError> {
        if self.pending.is_some() {
            return Ok(true);
        }
        let begin = now();
        let Some(frame) = self.next_in_range() else { return Ok(false) };
        let (mut meta, pixels) = frame?;
        let shape = |width_px, height_px, format: PixelFormat| format!("{width_px}x{height_px} {}", format.as_str());
        let found = shape(meta.width_px, meta.height_px, meta.format);
        let expected = shape(self.format.width_px, self.format.height_px, self.format.format);
        if found != expected {
            let reason = format!("frame {} is {found}, the first one {expected}", meta.sequence);
            return Err(RecordingError::invalid(self.recording.path(), reason).into());
        }
        meta.stamp_ns = meta.stamp_ns.saturating_add_signed(self.playback.shift_ns);
        self.pending = Some((meta, pixels));
        self.reading = now().saturating_duration_since(begin);
        Ok(true)
    }

    /// Sleeps until the frame with this stamp is due, at most `timeout`, and returns whether it is.
    ///
    /// At a given speed, the first frame since the start is due at once and sets the origin of the others. Otherwise
    /// every frame is due at once.
    fn wait_until_due(&mut self, stamp_ns: u64, timeout: Duration) -> bool {
        let PlaybackRate::Times(times) = self.playback.rate else { return true };
        let now = now();
        let (start, first_ns) = *self.origin.get_or_insert((now, stamp_ns));
        let ahead_s = stamp_ns.saturating_sub(first_ns) as f64 * 1e-9 / times;
        let due = Duration::try_from_secs_f64(ahead_s).unwrap_or(Duration::MAX);
        let left = due.saturating_sub(now.saturating_duration_since(start));
        self.due = start.checked_add(due);
        std::thread::sleep(left.min(timeout));
        left <= timeout
    }

    /// Records the delivery of the frame whose copy began at `begin`, if it is played at a given speed.
    fn record_delivery(&mut self, begin: Instant) {
        let Some(due) = self.due else { return };
        // Reading ahead of the due time delays nobody.
        let reading = self.reading.min(begin.saturating_duration_since(due));
        self.delivery.record(due, reading + now().saturating_duration_since(begin));
    }
}

#[expect(clippy::disallowed_methods, reason = "replay at a given speed runs on the wall clock")]
fn now() -> Instant {
    Instant::now()
}

/// Starts a thread that sends one message per line on standard input, and closes the channel at the end of the input.
///
/// The thread ends at the first line after the receiver was dropped.
fn step_on_input_lines() -> Receiver<()> {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let lines = std::io::stdin().lines().map_while(Result::ok);
        // Sending fails once the camera is dropped.
        let _ = lines.map(|_| ()).try_for_each(|()| sender.send(()));
    });
    receiver
}

/// Copies a frame into a slot, without the row padding if the slot has no room for it; returns whether it fits.
///
/// Without the padding, the stride in `meta` becomes the length of a row.
fn copy_frame(meta: &mut FrameMeta, pixels: &[u8], slot: &mut [u8]) -> bool {
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

impl Camera for ReplayCamera {
    fn format(&self) -> StreamFormat {
        self.format
    }

    fn identity(&self) -> CameraIdentity {
        let entry = |key| self.recording.metadata().get(key).cloned().unwrap_or_default();
        CameraIdentity { model: entry("camera"), serial: entry("serial") }
    }

    fn pace(&self) -> Pace {
        if matches!(self.playback.rate, PlaybackRate::Times(_)) { Pace::Live } else { Pace::OnDemand }
    }

    fn slots(&self) -> usize {
        1
    }

    fn queue(&mut self, slot: Slot) {
        self.slots.push_back(slot);
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.origin = None;
        if self.playback.rate == PlaybackRate::Stepped && self.steps.is_none() {
            self.steps = Some(step_on_input_lines());
        }
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        if !self.fetch()? {
            return Ok(Next::End);
        }
        let Some(stamp_ns) = self.pending.as_ref().map(|(meta, _)| meta.stamp_ns) else { return Ok(Next::End) };
        if self.slots.is_empty() || !self.wait_until_due(stamp_ns, timeout) {
            return Ok(Next::Timeout);
        }
        match self.steps.as_ref().map(|steps| steps.recv_timeout(timeout)) {
            None | Some(Ok(())) => {}
            Some(Err(RecvTimeoutError::Timeout)) => return Ok(Next::Timeout),
            Some(Err(RecvTimeoutError::Disconnected)) => return Ok(Next::End),
        }
        let Some(((mut meta, pixels), mut slot)) = self.pending.take().zip(self.slots.pop_front()) else {
            return Ok(Next::Timeout);
        };
        let begin = now();
        if !copy_frame(&mut meta, &pixels, slot.bytes_mut()) {
            let reason = format!("frame {} has {} bytes, the slot {}", meta.sequence, pixels.len(), slot.len());
            return Ok(Next::Incomplete(slot, reason));
        }
        self.record_delivery(begin);
        Ok(Next::Frame(slot, meta))
    }

    fn seek(&mut self, sequence: u64) -> bool {
        self.first_sequence = sequence;
        true
    }

    fn follow_steps(&mut self, steps: Receiver<()>) {
        self.steps = Some(steps).filter(|_| self.playback.rate == PlaybackRate::Stepped);
    }

    fn frame_age(&self) -> Duration {
        self.delivery.age(now())
    }
}
