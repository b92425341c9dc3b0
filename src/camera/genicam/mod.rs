//! GenICam cameras (GigE Vision and USB3 Vision) through Aravis, opened at run time.
#![expect(unsafe_code, reason = "the camera library is a C library")]

mod apply;
mod clock;
mod device;
mod feature;
mod features;
mod find;
mod handle;
mod library;
mod sequence;
mod settings;
mod socket;
mod stream;
#[rustfmt::skip]
#[doc(hidden)]
#[allow(
    missing_docs,
    non_camel_case_types,
    non_upper_case_globals,
    clippy::all,
    clippy::too_many_lines,
    clippy::undocumented_unsafe_blocks,
    reason = "generated"
)]
pub mod sys;

pub use crate::config::FeatureValue;
pub use device::{Access, Device, Kind};
pub use features::{CameraDetails, FeatureLine, describe, features};
pub use find::{CameraListing, list};
pub use library::library;
pub use settings::GenicamSettings;
pub use stream::StreamStatistics;

use crate::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::image::FrameMeta;
use clock::DeviceClock;
use sequence::FrameIds;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use stream::{Arrival, Stream};

/// Slots held at least, and for how long the taker may be late at the camera's rate.
const MIN_SLOTS: usize = 16;
const MAX_SLOTS: usize = 256;
const SLOTS_S: f64 = 0.05;

/// Longest wait between two looks at whether the camera is still there.
const LOOK: Duration = Duration::from_millis(100);

/// A GenICam camera.
///
/// Slots given to [`queue`](Camera::queue) are written to by the library's own
/// thread: whoever owns their memory must drop the camera first. Dropping it stops
/// the camera, joins that thread and only then lets go of the slots.
///
/// Sequences start at 0 with the first frame seen, whole or torn, and keep every
/// gap of the camera's own frame ids. A frame lost without a trace before that is
/// not counted. A torn frame is a gap too: count one or the other.
///
/// `stamp_ns` is the camera's own clock mapped to the host's (see `clock.rs`); how
/// a camera's stamp relates to the exposure's start is the camera's business,
/// usually it is that start. `epoch` is 0: whoever opens cameras anew counts it.
#[derive(Debug)]
pub struct GenicamCamera {
    // Order of drop: the stream goes before the device it came from.
    stream: Stream,
    device: Device,
    id: String,
    format: StreamFormat,
    identity: CameraIdentity,
    ids: FrameIds,
    clock: DeviceClock,
    lost: Arc<AtomicBool>,
    started: bool,
}

impl GenicamCamera {
    /// Opens a camera and sets it up; nothing streams before [`start`](Camera::start).
    ///
    /// # Errors
    ///
    /// [`CameraError::LibraryMissing`], [`CameraError::NotFound`], or
    /// [`CameraError::Setting`] with the feature, the value and the allowed range.
    pub fn open(settings: &GenicamSettings) -> Result<Self, CameraError> {
        let device = Device::open(&settings.id)?;
        let format = apply::apply(&device, settings)?;
        let lost = Arc::new(AtomicBool::new(false));
        device.watch(&lost);
        let stream = Stream::new(&device, settings, format.slot_bytes())
            .map_err(|reason| CameraError::NotFound { id: settings.id.clone(), reason })?;
        Ok(Self {
            stream,
            id: settings.id.clone(),
            format,
            identity: device.identity(),
            ids: FrameIds::new(device.is_gige()),
            clock: DeviceClock::default(),
            lost,
            started: false,
            device,
        })
    }

    /// Makes the camera take one frame, when its trigger source is `Software`.
    ///
    /// # Errors
    ///
    /// [`CameraError::Setting`] when it has no software trigger.
    pub fn software_trigger(&self) -> Result<(), CameraError> {
        self.device
            .ask(self.device.aravis.arv_camera_software_trigger)
            .map_err(|reason| feature::setting("TriggerSoftware", "execute", reason))
    }

    /// The open device, to read features from.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Counts of frames and packets since the camera was opened.
    pub fn statistics(&self) -> StreamStatistics {
        self.stream.statistics()
    }

    fn vanished(&self, reason: impl Into<String>) -> CameraError {
        CameraError::Vanished { id: self.id.clone(), reason: reason.into() }
    }

    /// A frame out of the stream, accepted only when it is what the camera was set to.
    fn judge(&mut self, arrival: Arrival) -> Next {
        let sequence = self.ids.unwrap_id(arrival.id);
        if sequence == Some(0) {
            log::info!("the first frame has id {}; most cameras begin with 1", arrival.id);
        }
        if let Err(reason) = self.check(&arrival) {
            return Next::Torn(arrival.slot, format!("frame id {}: {reason}", arrival.id));
        }
        let Some(sequence) = sequence else {
            let reason = format!("frame id {} is not later than the one before", arrival.id);
            return Next::Torn(arrival.slot, reason);
        };
        let meta = FrameMeta {
            sequence,
            epoch: 0,
            stamp_ns: self.clock.stamp_ns(arrival.device_ns, arrival.arrival_ns),
            device_ns: arrival.device_ns,
            width_px: self.format.width_px,
            height_px: self.format.height_px,
            stride_bytes: self.format.width_px * self.format.format.bytes_per_pixel() as u32,
            format: self.format.format,
        };
        Next::Frame(arrival.slot, meta)
    }

    fn check(&self, arrival: &Arrival) -> Result<(), String> {
        if arrival.status != sys::ARV_BUFFER_STATUS_SUCCESS {
            return Err(stream::cause(arrival.status).into());
        }
        // The library calls a frame whole when its last packet says so, even if that packet came early.
        let wanted = self.format.slot_bytes();
        if arrival.received_bytes != wanted {
            return Err(format!("{} bytes of {wanted}", arrival.received_bytes));
        }
        let set = (self.format.width_px.cast_signed(), self.format.height_px.cast_signed(), self.format.format as u32);
        match arrival.image {
            Some(image) if image == set => Ok(()),
            Some((width, height, code)) => {
                Err(format!("{width}x{height} pixels of format {code:#010x}, not as the camera was set"))
            }
            None if arrival.payload == sys::ARV_BUFFER_PAYLOAD_TYPE_CHUNK_DATA => Ok(()),
            None => Err(format!("payload of type {}, not an image", arrival.payload)),
        }
    }
}

impl Camera for GenicamCamera {
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
        let late = (self.format.frame_rate_hz * SLOTS_S).ceil();
        (MIN_SLOTS + late as usize).min(MAX_SLOTS)
    }

    fn queue(&mut self, slot: Slot) {
        self.stream.push(slot);
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.device.ask(self.device.aravis.arv_camera_start_acquisition).map_err(|reason| self.vanished(reason))?;
        self.started = true;
        Ok(())
    }

    #[expect(clippy::disallowed_methods, reason = "waiting has a deadline")]
    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        let deadline = Instant::now() + timeout;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if let Some(arrival) = self.stream.pop(left.min(LOOK)) {
                return Ok(self.judge(arrival));
            }
            if self.lost.load(Ordering::Acquire) {
                return Err(self.vanished("it does not answer any more, or another program took it over"));
            }
            if left.is_zero() {
                return Ok(Next::Nothing);
            }
        }
    }
}

impl Drop for GenicamCamera {
    fn drop(&mut self) {
        if self.lost.load(Ordering::Acquire) && self.device.is_gige() {
            self.stream.abandon();
        } else if self.started {
            // Nothing can be done about a camera that refuses to stop: closing it ends its stream.
            let _ = self.device.ask(self.device.aravis.arv_camera_stop_acquisition);
        }
    }
}
