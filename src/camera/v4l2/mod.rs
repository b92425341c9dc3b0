//! Video4Linux 2 cameras: webcams, frame grabbers, embedded sensors.
//!
//! The bindings are generated from the kernel's header and committed. Grey formats (`GREY`, `Y10`, `Y12`, `Y16`) arrive
//! as `Mono8` to `Mono16`, bit for bit. Of `NV12`, `YUYV` and `UYVY`, the luma is taken as the driver delivers it (most
//! cameras limit it to 16 to 235). Of compressed images (`MJPG`), the luma is decoded as it was encoded. They are used
//! only if nothing else has the requested size and rate, because compression removes speckle detail.
#![expect(unsafe_code, reason = "the kernel is called with structures of C")]

mod apply;
mod control;
mod device;
mod jpeg;
mod kernel;
#[cfg(test)]
mod mock;
mod queue;
#[rustfmt::skip]
#[doc(hidden)]
#[allow(
    missing_docs,
    non_camel_case_types,
    non_upper_case_globals,
    dead_code,
    clippy::all,
    clippy::undocumented_unsafe_blocks,
    clippy::allow_attributes_without_reason,
    reason = "generated"
)]
pub mod sys;
mod auto_controls;
mod discovery;
mod frame_timing;
mod modes;
mod pixel_layout;
mod timestamps;

pub use device::{Capability, Device};
pub use discovery::{CameraListing, FormatListing, features, is_v4l2_id, list};
pub use modes::{FrameSize, Rates, Sizes};
pub use timestamps::monotonic_ns;

use super::feature_setting::slot_count;
use crate::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::config;
use apply::Applied;
use frame_timing::FrameTiming;
use pixel_layout::BufferLayout;
use queue::{BUFFERS_MAX, BUFFERS_MIN, Dequeued, Queue};
use std::io;
use std::time::Duration;
use timestamps::{BufferInfo, HostClock, Sequences, is_stale};

/// Minimum number of slots.
const MIN_SLOTS: usize = 2 * BUFFERS_MIN;

/// A V4L2 camera.
///
/// The driver may write to slots given to [`queue`](Camera::queue), so the owner of their memory must drop the camera
/// first. Dropping it stops the stream and closes the device before it releases the slots.
///
/// Sequence numbers start at 0 with the first frame received, complete or not, and keep every gap of the driver's
/// count. An incomplete frame is a gap too: count one or the other.
///
/// `stamp_ns` is the driver's timestamp on the kernel's monotonic clock, converted to host time. It is taken as it is
/// if the driver stamps the start of a frame, and set back by one frame period if it stamps the end. `device_ns` is
/// that timestamp itself. Without timestamps of this clock, a frame gets the time of its arrival, and `device_ns` 0.
/// `epoch` is 0: whoever reopens cameras counts it.
#[derive(Debug)]
pub struct V4l2Camera {
    // Drop order: the device is closed before the slots, which the driver may hold, are released.
    device: Device,
    queue: Queue,
    buffer: BufferLayout,
    format: StreamFormat,
    identity: CameraIdentity,
    sequences: Sequences,
    clock: HostClock,
    timing: FrameTiming,
    /// `stamp_ns` of the last returned frame.
    last_ns: u64,
    /// When the last returned frame was complete, ns on the kernel's monotonic clock, if the driver reports it.
    completed_ns: Option<u64>,
}

impl V4l2Camera {
    /// Opens a camera and applies its settings; nothing streams before [`start`](Camera::start).
    ///
    /// # Errors
    ///
    /// [`CameraError::NotFound`], or [`CameraError::Setting`] with the key or control, the value and the allowed
    /// range.
    pub fn open(settings: &config::Camera) -> Result<Self, CameraError> {
        Self::with_device(Device::find(settings.id.as_deref().unwrap_or_default())?, settings)
    }

    /// Applies the settings to an open device, and logs warnings about automatic controls.
    fn with_device(device: Device, settings: &config::Camera) -> Result<Self, CameraError> {
        let applied = apply::apply(&device, settings)?;
        let Applied { buffer, frame_rate_hz, exposure_us } = applied;
        for warning in auto_controls::warnings(&device, &applied, settings) {
            log::warn!("{}: {warning}", device.id);
        }
        let format = StreamFormat {
            width_px: buffer.size.width_px,
            height_px: buffer.size.height_px,
            format: buffer.layout.format,
            frame_rate_hz,
            exposure_us,
            coding: crate::results::FrameCoding::default(),
        };
        Ok(Self {
            identity: device.identity(),
            queue: Queue::new(buffer),
            clock: HostClock::new(frame_rate_hz),
            sequences: Sequences::default(),
            timing: FrameTiming::new(frame_rate_hz),
            last_ns: 0,
            completed_ns: None,
            device,
            buffer,
            format,
        })
    }

    /// Whether each frame is copied once because the driver cannot write to the ring; `true` before the start.
    pub fn copies(&self) -> bool {
        self.queue.copies()
    }

    /// Returns [`CameraError::Lost`] for a stream that failed with this error.
    fn lost_error(&self, error: &io::Error) -> CameraError {
        let reason = match error.raw_os_error() {
            Some(libc::ENODEV | libc::ENXIO) => "it was unplugged".into(),
            Some(libc::EIO) => "its driver reports an input/output error".into(),
            _ => error.to_string(),
        };
        CameraError::Lost { id: self.device.id.clone(), reason }
    }

    /// Returns the error for a stream that does not start: lost if the camera was unplugged, else not found.
    fn start_error(&self, error: &io::Error) -> CameraError {
        let reason = match error.raw_os_error() {
            Some(libc::ENODEV | libc::ENXIO) => return self.lost_error(error),
            Some(libc::EBUSY) => "another program uses it".into(),
            Some(libc::ENOSPC) => {
                "the USB has no bandwidth left for its stream: use a smaller image, a lower rate or a \
                                               port of another controller, or unplug other cameras"
                    .into()
            }
            _ => format!("cannot start its stream: {error}"),
        };
        CameraError::NotFound { id: self.device.id.clone(), reason }
    }

    /// Validates a buffer out of the queue. It must hold a complete frame that comes after the previous one.
    ///
    /// The slot of a frame from before the start is queued again, as if nothing had arrived. Any other invalid frame is
    /// incomplete.
    fn validate(&mut self, slot: Slot, info: &BufferInfo) -> Next {
        if is_stale(info, self.queue.start_ns()) {
            self.queue.push(&self.device, slot);
            return Next::Timeout;
        }
        let sequence = self.sequences.sequence_of(info.sequence);
        let incomplete = |slot, reason: &str| Next::Incomplete(slot, format!("frame {}: {reason}", info.sequence));
        if info.flags & sys::V4L2_BUF_FLAG_ERROR != 0 {
            return incomplete(slot, "the driver marks it as damaged");
        }
        let min_bytes = self.buffer.min_bytes();
        if info.bytes < min_bytes {
            return incomplete(slot, &format!("{} bytes instead of {min_bytes}", info.bytes));
        }
        if let Some(damage) = &info.damage {
            return incomplete(slot, damage);
        }
        let Some(sequence) = sequence else { return incomplete(slot, "not later than the previous frame") };
        let stamps = self.clock.stamps(info, monotonic_ns());
        if stamps.stamp_ns <= self.last_ns {
            return incomplete(slot, "its timestamp is not later than that of the previous frame");
        }
        self.last_ns = stamps.stamp_ns;
        for warning in self.timing.observe(sequence, stamps.stamp_ns) {
            log::warn!("{}: {warning}", self.device.id);
        }
        Next::Frame(slot, self.format.frame_meta(sequence, stamps.stamp_ns, stamps.device_ns))
    }
}

impl Camera for V4l2Camera {
    fn format(&self) -> StreamFormat {
        self.format
    }

    fn identity(&self) -> CameraIdentity {
        self.identity.clone()
    }

    fn pace(&self) -> Pace {
        Pace::Live
    }

    fn slots(&self) -> usize {
        slot_count(self.format.frame_rate_hz, MIN_SLOTS, BUFFERS_MAX)
    }

    fn queue(&mut self, slot: Slot) {
        self.queue.push(&self.device, slot);
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.queue.start(&self.device).map_err(|error| self.start_error(&error))?;
        let how = if self.copies() { "copied from the driver's buffers" } else { "written to the ring by the driver" };
        log::info!("{}: frames are {how}", self.device.id);
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        match self.queue.next(&self.device, timeout).map_err(|error| self.lost_error(&error))? {
            Dequeued::Filled(slot, info) => {
                self.completed_ns = self.clock.completed_ns(&info);
                Ok(self.validate(slot, &info))
            }
            Dequeued::Refused(slot, reason) => Ok(Next::Incomplete(slot, reason)),
            Dequeued::Timeout => Ok(Next::Timeout),
        }
    }

    fn frame_age(&self) -> Duration {
        self.completed_ns.map_or(Duration::ZERO, |at_ns| Duration::from_nanos(monotonic_ns().saturating_sub(at_ns)))
    }
}

impl Drop for V4l2Camera {
    fn drop(&mut self) {
        self.queue.stop(&self.device);
    }
}
