//! GenICam cameras (GigE Vision and USB3 Vision) through Aravis, opened at run time.
#![expect(unsafe_code, reason = "the camera library is a C library")]

mod apply;
mod chunks;
mod clock;
mod completion;
mod device;
mod feature;
mod features;
mod filter;
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

use crate::camera::setting::{setting, slots_at};
use crate::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::image::FrameMeta;
use chunks::{Chunks, Told};
use clock::DeviceClock;
use sequence::FrameIds;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use stream::{Arrival, Sizes, Stream};

/// Slots held at least and at most.
const MIN_SLOTS: usize = 16;
const MAX_SLOTS: usize = 256;

/// After this many whole frames in a row that come before those seen, the camera has begun anew.
const MAX_STALE: u32 = 16;

/// A frame's time cannot leap ahead of the time that passed here by more: slow cameras, whose frames may have waited
/// for their taker, have less than one frame in it.
const MAX_LEAP: Duration = Duration::from_secs(10);

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
/// A camera set to send `ChunkTimestamp` or `ChunkFrameID` behind each picture has its
/// frames timed and counted by them instead of by what the network's protocol tells.
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
    /// Whole frames without a place, in a row.
    stale: u32,
    last: Option<Accepted>,
    clock: DeviceClock,
    /// When the frame given last was whole; nothing when that was as it was taken.
    completed: Option<Instant>,
    lost: Arc<AtomicBool>,
    started: bool,
}

/// When the last whole frame was taken, by its own clock and by that of this computer.
#[derive(Debug, Clone, Copy)]
struct Accepted {
    device_ns: u64,
    stamp_ns: u64,
    at: Instant,
}

impl Accepted {
    /// Refuses a time of the next frame that cannot be.
    fn check(&self, device_ns: u64, now: Instant) -> Result<(), String> {
        if device_ns == 0 && self.device_ns != 0 {
            return Err("it has no time, unlike the one before".into());
        }
        let later = Duration::from_nanos(device_ns.saturating_sub(self.device_ns));
        let waited = now.saturating_duration_since(self.at);
        if self.device_ns != 0 && later > waited + MAX_LEAP {
            let (later, waited) = (later.as_secs_f64(), waited.as_secs_f64());
            return Err(format!(
                "its time is {later:.1} s later than that of the one before, which came {waited:.1} s ago"
            ));
        }
        Ok(())
    }
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
        let not_found = |reason: String| CameraError::NotFound { id: settings.id.clone(), reason };
        let chunks = Chunks::of(&device).map_err(not_found)?;
        if let Some(chunks) = &chunks {
            log::info!("the camera {}", chunks.words());
        }
        let image_bytes = format.slot_bytes();
        let payload_bytes = apply::payload_bytes(&device, &format, chunks.is_some())?;
        let stream = Stream::new(&device, settings, Sizes { image_bytes, payload_bytes }, chunks).map_err(not_found)?;
        Ok(Self {
            stream,
            id: settings.id.clone(),
            format,
            identity: device.identity(),
            ids: FrameIds::new(device.is_gige()),
            stale: 0,
            last: None,
            clock: DeviceClock::default(),
            completed: None,
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
            .map_err(|reason| setting("TriggerSoftware", "execute", reason))
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
    fn judge(&mut self, arrival: Arrival, now: Instant) -> Result<Next, CameraError> {
        let told = match self.check(&arrival) {
            Ok(told) => told,
            Err(reason) => {
                self.ids.torn(arrival.id);
                return Ok(Next::Torn(arrival.slot, format!("frame id {}: {reason}", arrival.id)));
            }
        };
        match self.place(&arrival, told, now) {
            Ok(meta) => {
                self.stale = 0;
                Ok(Next::Frame(arrival.slot, meta))
            }
            Err(_) if self.stale == MAX_STALE => Err(self.vanished("it counts its frames or its time anew")),
            Err(reason) => {
                self.stale += 1;
                Ok(Next::Torn(arrival.slot, format!("frame id {}: {reason}", arrival.id)))
            }
        }
    }

    /// A whole frame's place in the sequence and in time.
    fn place(&mut self, arrival: &Arrival, told: Told, now: Instant) -> Result<FrameMeta, String> {
        let sequence = self.ids.whole(arrival.id, told.frame_id)?;
        if sequence == 0 {
            log::info!("the first frame has id {}; most cameras begin with 1", arrival.id);
        }
        let device_ns = told.stamp_ns.unwrap_or(arrival.device_ns);
        if let Some(last) = &self.last {
            last.check(device_ns, now)?;
        }
        let stamp_ns = self.clock.stamp_ns(device_ns, arrival.arrival_ns);
        if self.last.is_some_and(|last| stamp_ns <= last.stamp_ns) {
            return Err("its time is not later than that of the one before".into());
        }
        self.last = Some(Accepted { device_ns, stamp_ns, at: now });
        Ok(FrameMeta {
            sequence,
            epoch: 0,
            stamp_ns,
            device_ns,
            width_px: self.format.width_px,
            height_px: self.format.height_px,
            stride_bytes: self.format.width_px * self.format.format.bytes_per_pixel() as u32,
            format: self.format.format,
        })
    }

    /// What a frame tells of itself behind its pixels, when it is whole and as the camera was set.
    fn check(&self, arrival: &Arrival) -> Result<Told, String> {
        if arrival.status != sys::ARV_BUFFER_STATUS_SUCCESS {
            return Err(stream::cause(arrival.status).into());
        }
        // The library calls a frame whole when its last packet says so, even if that packet came early.
        let wanted = self.format.slot_bytes();
        let told = match &arrival.told {
            Some(told) => (*told).clone()?,
            None if arrival.received_bytes == wanted => Told::default(),
            None => return Err(format!("{} bytes of {wanted}", arrival.received_bytes)),
        };
        let set = (self.format.width_px.cast_signed(), self.format.height_px.cast_signed(), self.format.format as u32);
        match arrival.image {
            Some(image) if image == set => Ok(told),
            Some((width, height, code)) => {
                Err(format!("{width}x{height} pixels of format {code:#010x}, not as the camera was set"))
            }
            None if arrival.payload == sys::ARV_BUFFER_PAYLOAD_TYPE_CHUNK_DATA => Ok(told),
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
        slots_at(self.format.frame_rate_hz, MIN_SLOTS, MAX_SLOTS)
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
                self.completed = arrival.completed;
                return self.judge(arrival, Instant::now());
            }
            if self.lost.load(Ordering::Acquire) {
                return Err(self.vanished("it does not answer any more, or another program took it over"));
            }
            if left.is_zero() {
                return Ok(Next::Nothing);
            }
        }
    }

    fn waited(&self) -> Duration {
        self.completed.map_or(Duration::ZERO, |completed| completed.elapsed())
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
