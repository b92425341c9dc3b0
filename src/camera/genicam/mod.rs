//! GenICam cameras (GigE Vision and USB3 Vision) through Aravis, which is loaded at run time.
#![expect(unsafe_code, reason = "the camera library is a C library")]

mod apply;
mod chunks;
mod clock;
mod device;
mod feature;
mod features;
mod handle;
mod library;
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
mod buffer_times;
mod discovery;
mod frame_ids;
mod packet_filter;

pub use crate::config::FeatureValue;
pub use device::{Access, Device};
pub use discovery::{CameraListing, list};
pub use features::{CameraDetails, describe, features};
pub use library::library;
pub use stream::StreamStatistics;

use super::feature_setting::slot_count;
use crate::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::config;
use crate::image::FrameMeta;
use chunks::{ChunkValues, Chunks};
use clock::DeviceClock;
use frame_ids::{Counting, FrameIds};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use stream::{ReceivedBuffer, Sizes, Stream};

/// Minimum and maximum number of slots.
const MIN_SLOTS: usize = 16;
const MAX_SLOTS: usize = 256;

/// Number of consecutive complete frames older than the newest after which the camera has restarted its count.
const MAX_STALE: u32 = 16;

/// Maximum lead of the device time over the host time between two frames. Slow cameras, whose frames may have waited
/// for their consumer, have less than one frame within it.
const MAX_TIME_JUMP: Duration = Duration::from_secs(10);

/// Interval of checking that the camera is still connected.
const CHECK_PERIOD: Duration = Duration::from_millis(100);

/// A GenICam camera.
///
/// The library's own thread writes to slots given to [`queue`](Camera::queue), so the owner of their memory must drop
/// the camera first. Dropping it stops the camera, joins that thread and only then releases the slots.
///
/// Sequence numbers start at 0 with the first frame received, complete or not, and keep every gap of the camera's frame
/// ids. A frame lost without a trace before that is not counted. An incomplete frame is a gap too: count one or the
/// other.
///
/// If the camera sends `ChunkTimestamp` or `ChunkFrameID` behind each image, they replace the timestamp and frame id of
/// the network protocol.
///
/// `stamp_ns` is the camera's clock converted to host time (see `clock.rs`). Its relation to the exposure depends on
/// the camera; usually it is the start of the exposure. `epoch` is 0: whoever reopens cameras counts it.
#[derive(Debug)]
pub struct GenicamCamera {
    // Drop order: the stream goes before the device it came from.
    stream: Stream,
    device: Device,
    id: String,
    format: StreamFormat,
    identity: CameraIdentity,
    ids: FrameIds,
    /// Number of consecutive complete frames without a valid sequence number or time.
    stale: u32,
    last: Option<AcceptedTimes>,
    clock: DeviceClock,
    /// When the last returned frame was completed; `None` if just then.
    completed: Option<Instant>,
    lost: Arc<AtomicBool>,
    started: bool,
}

/// The times of the last accepted frame.
#[derive(Debug, Clone, Copy)]
struct AcceptedTimes {
    /// The time by the device clock, ns; 0 without one.
    device_ns: u64,
    /// The time by the host clock, ns since the Unix epoch.
    stamp_ns: u64,
    /// When the frame was taken out of the stream.
    taken: Instant,
}

impl AcceptedTimes {
    /// Checks that the device time of the next frame, which was taken at `now`, is plausible.
    ///
    /// # Errors
    ///
    /// The reason, if the frame has no timestamp (0) unlike the previous one, or its device time has advanced more than
    /// [`MAX_TIME_JUMP`] beyond the host time that has passed.
    fn check_next(&self, device_ns: u64, now: Instant) -> Result<(), String> {
        if device_ns == 0 && self.device_ns != 0 {
            return Err("it has no timestamp, unlike the previous one".into());
        }
        let later = Duration::from_nanos(device_ns.saturating_sub(self.device_ns));
        let waited = now.saturating_duration_since(self.taken);
        if self.device_ns != 0 && later > waited + MAX_TIME_JUMP {
            let (later, waited) = (later.as_secs_f64(), waited.as_secs_f64());
            return Err(format!(
                "its timestamp is {later:.1} s later than that of the previous frame, which arrived {waited:.1} s ago"
            ));
        }
        Ok(())
    }
}

impl GenicamCamera {
    /// Opens a camera and applies its settings; nothing streams before [`start`](Camera::start).
    ///
    /// # Errors
    ///
    /// [`CameraError::LibraryMissing`], [`CameraError::NotFound`], or [`CameraError::Setting`] with the feature, the
    /// value and the allowed range.
    pub fn open(settings: &config::Camera) -> Result<Self, CameraError> {
        let id = settings.id.clone().unwrap_or_default();
        let device = Device::open(&id)?;
        let format = apply::apply(&device, settings)?;
        let lost = Arc::new(AtomicBool::new(false));
        device.watch_connection(&lost);
        let not_found = |reason: String| CameraError::NotFound { id: id.clone(), reason };
        let chunks = Chunks::from_device(&device).map_err(not_found)?;
        if let Some(chunks) = &chunks {
            log::info!("the camera {}", chunks.description());
        }
        let image_bytes = format.slot_bytes();
        let payload_bytes = apply::payload_bytes(&device, &format, chunks.as_ref())?;
        let stream = Stream::new(&device, settings.packet_size_bytes, Sizes { image_bytes, payload_bytes }, chunks)
            .map_err(not_found)?;
        Ok(Self {
            stream,
            id,
            format,
            identity: device.identity(),
            ids: FrameIds::new(if device.is_gige() { Counting::Short } else { Counting::Long }),
            stale: 0,
            last: None,
            clock: DeviceClock::default(),
            completed: None,
            lost,
            started: false,
            device,
        })
    }

    /// Returns the open device, to read features from.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Returns the counts of frames and packets since the camera was opened.
    pub fn statistics(&self) -> StreamStatistics {
        self.stream.statistics()
    }

    /// Returns the error for a lost connection.
    fn lost_error(&self, reason: impl Into<String>) -> CameraError {
        CameraError::Lost { id: self.id.clone(), reason: reason.into() }
    }

    /// Validates a buffer taken out of the stream at `now`. A frame must match the camera's settings and come after the
    /// previous one, else it is incomplete.
    ///
    /// # Errors
    ///
    /// [`CameraError::Lost`] if more than [`MAX_STALE`] complete frames in a row have no valid sequence number or time.
    fn validate(&mut self, received: ReceivedBuffer, now: Instant) -> Result<Next, CameraError> {
        let id = received.id;
        let values = match self.check_content(&received) {
            Ok(values) => values,
            Err(reason) => {
                self.ids.add_incomplete(id);
                return Ok(Next::Incomplete(received.slot, format!("frame id {id}: {reason}")));
            }
        };
        match self.accept(&received, values, now) {
            Ok(meta) => {
                self.stale = 0;
                Ok(Next::Frame(received.slot, meta))
            }
            Err(_) if self.stale == MAX_STALE => Err(self.lost_error("it restarted its frame count or its clock")),
            Err(reason) => {
                self.stale += 1;
                Ok(Next::Incomplete(received.slot, format!("frame id {id}: {reason}")))
            }
        }
    }

    /// Returns the metadata of a complete frame taken at `now`, and records its sequence number and times.
    ///
    /// A timestamp in the chunks replaces that of the frame's header.
    ///
    /// # Errors
    ///
    /// The reason, if its id, its counter or its timestamp does not come after that of the previous frame, or the
    /// timestamp is missing or too far ahead.
    fn accept(&mut self, received: &ReceivedBuffer, values: ChunkValues, now: Instant) -> Result<FrameMeta, String> {
        let sequence = self.ids.add_complete(received.id, values.frame_id)?;
        if sequence == 0 {
            log::info!("the first frame has id {}; most cameras begin with 1", received.id);
        }
        let device_ns = values.stamp_ns.unwrap_or(received.device_ns);
        if let Some(last) = &self.last {
            last.check_next(device_ns, now)?;
        }
        let stamp_ns = self.clock.stamp_ns(device_ns, received.arrival_ns);
        if self.last.is_some_and(|last| stamp_ns <= last.stamp_ns) {
            return Err("its timestamp is not later than that of the previous frame".into());
        }
        self.last = Some(AcceptedTimes { device_ns, stamp_ns, taken: now });
        Ok(self.format.frame_meta(sequence, stamp_ns, device_ns))
    }

    /// Checks that a frame is complete and matches the camera's settings; returns its chunk values.
    ///
    /// # Errors
    ///
    /// The reason why it does not.
    fn check_content(&self, received: &ReceivedBuffer) -> Result<ChunkValues, String> {
        if received.status != sys::ARV_BUFFER_STATUS_SUCCESS {
            return Err(stream::failure_reason(received.status).into());
        }
        // The library takes a frame as complete once the trailer arrives, even if that is early.
        let expected_bytes = self.format.slot_bytes();
        let values = match &received.chunks {
            Some(values) => (*values).clone()?,
            None if received.received_bytes == expected_bytes => ChunkValues::default(),
            None => return Err(format!("{} bytes instead of {expected_bytes}", received.received_bytes)),
        };
        let set = (self.format.width_px.cast_signed(), self.format.height_px.cast_signed(), self.format.format as u32);
        match received.image {
            Some(image) if image == set => Ok(values),
            Some((width, height, code)) => {
                Err(format!("{width}x{height} px of format {code:#010x}, which differs from the camera's settings"))
            }
            None if received.payload == sys::ARV_BUFFER_PAYLOAD_TYPE_CHUNK_DATA => Ok(values),
            None => Err(format!("payload of type {}, not an image", received.payload)),
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
        slot_count(self.format.frame_rate_hz, MIN_SLOTS, MAX_SLOTS)
    }

    fn queue(&mut self, slot: Slot) {
        self.stream.push(slot);
    }

    fn start(&mut self) -> Result<(), CameraError> {
        self.device.call(self.device.aravis.arv_camera_start_acquisition).map_err(|reason| self.lost_error(reason))?;
        self.started = true;
        Ok(())
    }

    #[expect(clippy::disallowed_methods, reason = "waiting has a deadline")]
    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        let deadline = Instant::now() + timeout;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if let Some(received) = self.stream.pop(left.min(CHECK_PERIOD)) {
                self.completed = received.completed;
                return self.validate(received, Instant::now());
            }
            if self.lost.load(Ordering::Acquire) {
                return Err(self.lost_error("it no longer answers, or another program took control of it"));
            }
            if left.is_zero() {
                return Ok(Next::Timeout);
            }
        }
    }

    fn frame_age(&self) -> Duration {
        self.completed.map_or(Duration::ZERO, |completed| completed.elapsed())
    }
}

impl Drop for GenicamCamera {
    fn drop(&mut self) {
        if self.lost.load(Ordering::Acquire) && self.device.is_gige() {
            self.stream.abandon();
        } else if self.started {
            // A camera that refuses to stop is closed next, which ends its stream.
            let _ = self.device.call(self.device.aravis.arv_camera_stop_acquisition);
        }
    }
}
