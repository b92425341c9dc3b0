//! Cameras of the kernel (Video4Linux 2): webcams, frame grabbers, sensors on a board.
//!
//! The bindings come from the kernel's own header and are committed. Grey formats
//! (`GREY`, `Y10`, `Y12`, `Y16`) arrive as `Mono8` to `Mono16`, bit for bit; of `NV12`,
//! `YUYV` and `UYVY` the luma is taken as the driver gives it (most cameras keep it
//! within 16 to 235). Of compressed pictures (`MJPG`) the luma is decoded as it was
//! encoded; they are taken only where nothing else has the size and rate wanted, since
//! what they lose is what correlation lives on.
#![expect(unsafe_code, reason = "the kernel is spoken to through structures of C")]

mod advice;
mod apply;
mod control;
mod device;
mod find;
mod jpeg;
mod kernel;
mod layout;
#[cfg(test)]
mod mock;
mod offer;
mod queue;
mod rhythm;
mod settings;
mod stamp;
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

pub use device::{Capability, Device};
pub use find::{CameraListing, FormatOffer, features, is_ours, list};
pub use offer::{Rates, Sizes};
pub use settings::V4l2Settings;

use crate::camera::setting::slots_at;
use crate::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::image::FrameMeta;
use apply::Applied;
use layout::Shape;
use queue::{BUFFERS_MAX, BUFFERS_MIN, Info, Out, Queue};
use rhythm::Rhythm;
use stamp::{HostClock, Sequences, is_stale, monotonic_ns};
use std::io;
use std::time::Duration;

/// Slots held at least.
const MIN_SLOTS: usize = 2 * BUFFERS_MIN;

/// A camera of the kernel.
///
/// Slots given to [`queue`](Camera::queue) may be written to by the driver: whoever
/// owns their memory must drop the camera first. Dropping it stops the stream and
/// closes the device before it lets go of the slots.
///
/// Sequences start at 0 with the first frame seen, whole or torn, and keep every
/// gap of the driver's own count. A torn frame is a gap too: count one or the other.
///
/// `stamp_ns` is the driver's stamp on the kernel's monotonic clock in host time: as
/// it is where the driver stamps the start of a frame, one frame's length earlier
/// where it stamps the end. `device_ns` is that stamp itself. A driver without
/// stamps of this clock gets the time the frame was taken out, and `device_ns` 0.
/// `epoch` is 0: whoever opens cameras anew counts it.
#[derive(Debug)]
pub struct V4l2Camera {
    // Order of drop: the device is closed before the slots go, which the driver may hold.
    device: Device,
    queue: Queue,
    shape: Shape,
    format: StreamFormat,
    identity: CameraIdentity,
    sequences: Sequences,
    clock: HostClock,
    rhythm: Rhythm,
    last_ns: u64,
    /// When the frame given last was whole, ns on the kernel's monotonic clock, where the driver tells.
    whole_ns: Option<u64>,
}

impl V4l2Camera {
    /// Opens a camera and sets it up; nothing streams before [`start`](Camera::start).
    ///
    /// # Errors
    ///
    /// [`CameraError::NotFound`], or [`CameraError::Setting`] with the key or control,
    /// the value and what is allowed.
    pub fn open(settings: &V4l2Settings) -> Result<Self, CameraError> {
        Self::with_device(Device::find(&settings.id)?, settings)
    }

    fn with_device(device: Device, settings: &V4l2Settings) -> Result<Self, CameraError> {
        let applied = apply::apply(&device, settings)?;
        let Applied { shape, frame_rate_hz, exposure_us } = applied;
        for advice in advice::advice(&device, &applied, settings) {
            log::warn!("{}: {advice}", device.id);
        }
        let format = StreamFormat {
            width_px: shape.width_px,
            height_px: shape.height_px,
            format: shape.layout.format,
            frame_rate_hz,
            exposure_us,
        };
        Ok(Self {
            identity: device.identity(),
            queue: Queue::new(shape),
            clock: HostClock::new(frame_rate_hz),
            sequences: Sequences::default(),
            rhythm: Rhythm::new(frame_rate_hz),
            last_ns: 0,
            whole_ns: None,
            device,
            shape,
            format,
        })
    }

    /// Whether each frame is copied once, since the driver cannot write to the ring itself; known once started.
    pub fn copies(&self) -> bool {
        self.queue.copies()
    }

    fn vanished(&self, error: &io::Error) -> CameraError {
        let reason = match error.raw_os_error() {
            Some(libc::ENODEV | libc::ENXIO) => "it was unplugged".into(),
            Some(libc::EIO) => "its driver gave up the stream".into(),
            _ => error.to_string(),
        };
        CameraError::Vanished { id: self.device.id.clone(), reason }
    }

    /// Why a stream cannot be started.
    fn refused(&self, error: &io::Error) -> CameraError {
        let reason = match error.raw_os_error() {
            Some(libc::ENODEV | libc::ENXIO) => return self.vanished(error),
            Some(libc::EBUSY) => "another program uses it".into(),
            Some(libc::ENOSPC) => "the USB has no room left for its stream: take a smaller picture, a lower rate or a \
                                   port of another controller, or unplug other cameras"
                .into(),
            _ => format!("start its stream: {error}"),
        };
        CameraError::NotFound { id: self.device.id.clone(), reason }
    }

    /// A buffer out of the queue, accepted only when it holds a whole frame with a place and a time.
    fn judge(&mut self, slot: Slot, info: &Info) -> Next {
        if is_stale(info, self.queue.began_ns()) {
            self.queue.push(&self.device, slot);
            return Next::Nothing;
        }
        let sequence = self.sequences.unwrap_count(info.sequence);
        let torn = |slot, reason: &str| Next::Torn(slot, format!("frame {}: {reason}", info.sequence));
        if info.flags & sys::V4L2_BUF_FLAG_ERROR != 0 {
            return torn(slot, "the driver marks it as damaged");
        }
        let whole = self.shape.whole_bytes();
        if info.bytes < whole {
            return torn(slot, &format!("{} bytes of {whole}", info.bytes));
        }
        if let Some(damage) = &info.damage {
            return torn(slot, damage);
        }
        let Some(sequence) = sequence else { return torn(slot, "not later than the one before") };
        let stamps = self.clock.stamps(info, monotonic_ns());
        if stamps.stamp_ns <= self.last_ns {
            return torn(slot, "its time is not later than that of the one before");
        }
        self.last_ns = stamps.stamp_ns;
        for advice in self.rhythm.see(sequence, stamps.stamp_ns) {
            log::warn!("{}: {advice}", self.device.id);
        }
        let meta = FrameMeta {
            sequence,
            epoch: 0,
            stamp_ns: stamps.stamp_ns,
            device_ns: stamps.device_ns,
            width_px: self.format.width_px,
            height_px: self.format.height_px,
            stride_bytes: self.format.width_px * self.format.format.bytes_per_pixel() as u32,
            format: self.format.format,
        };
        Next::Frame(slot, meta)
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
        slots_at(self.format.frame_rate_hz, MIN_SLOTS, BUFFERS_MAX)
    }

    fn queue(&mut self, slot: Slot) {
        self.queue.push(&self.device, slot);
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.queue.start(&self.device).map_err(|error| self.refused(&error))?;
        let how = if self.copies() { "copied from buffers of the driver" } else { "written to the ring by the driver" };
        log::info!("{}: frames are {how}", self.device.id);
        Ok(())
    }

    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        match self.queue.next(&self.device, timeout).map_err(|error| self.vanished(&error))? {
            Out::Filled(slot, info) => {
                self.whole_ns = self.clock.whole_ns(&info);
                Ok(self.judge(slot, &info))
            }
            Out::Refused(slot, reason) => Ok(Next::Torn(slot, reason)),
            Out::Nothing => Ok(Next::Nothing),
        }
    }

    fn waited(&self) -> Duration {
        self.whole_ns.map_or(Duration::ZERO, |whole_ns| Duration::from_nanos(monotonic_ns().saturating_sub(whole_ns)))
    }
}

impl Drop for V4l2Camera {
    fn drop(&mut self) {
        self.queue.stop(&self.device);
    }
}
