//! Cameras: every source that fills a slot of the ring with a frame.

mod delivery_latency;
mod feature_line;
mod feature_setting;
pub mod genicam;
pub mod realtime_priority;
pub mod replay;
pub mod simulated;
mod slot;
pub mod v4l2;

pub use feature_line::{FeatureKind, FeatureLine};
pub use slot::Slot;

use crate::failure::{ExitCode, Fatal};
use crate::image::{FrameMeta, PixelFormat};
use crate::results::FrameCoding;
use std::sync::mpsc::Receiver;
use std::time::Duration;

/// The image size, pixel format and frame rate of a camera stream.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamFormat {
    /// Image width, px.
    pub width_px: u32,
    /// Image height, px.
    pub height_px: u32,
    /// Pixel format.
    pub format: PixelFormat,
    /// Configured frame rate, Hz.
    pub frame_rate_hz: f64,
    /// Exposure time, us; 0 if unknown.
    pub exposure_us: f64,
    /// The coding of the film that the frames come from.
    pub coding: FrameCoding,
}

impl StreamFormat {
    /// Returns the number of bytes a slot must hold for one frame.
    pub fn slot_bytes(&self) -> usize {
        self.width_px as usize * self.height_px as usize * self.format.bytes_per_pixel()
    }

    /// Returns the metadata of a frame without row padding, in the stream's first epoch (0).
    ///
    /// `stamp_ns` counts from the Unix epoch, `device_ns` on the camera's own clock (0 if it has none).
    fn frame_meta(&self, sequence: u64, stamp_ns: u64, device_ns: u64) -> FrameMeta {
        FrameMeta {
            sequence,
            epoch: 0,
            stamp_ns,
            device_ns,
            width_px: self.width_px,
            height_px: self.height_px,
            stride_bytes: self.width_px * self.format.bytes_per_pixel() as u32,
            format: self.format,
        }
    }
}

/// The camera's identity, stored in the recording's metadata.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CameraIdentity {
    /// Vendor and model.
    pub model: String,
    /// Serial number.
    pub serial: String,
}

/// Whether the camera or its consumer sets the pace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// Frames come at the camera's own clock: a slow consumer loses frames.
    Live,
    /// Frames come as fast as they are taken: the consumer may hold the camera back and nothing is lost.
    OnDemand,
}

/// The outcome of one call of [`Camera::next`].
#[derive(Debug)]
pub enum Next {
    /// A complete frame in the slot that was queued.
    Frame(Slot, FrameMeta),
    /// An incomplete frame with the reason. The slot comes back with unspecified content.
    Incomplete(Slot, String),
    /// No frame arrived within the timeout.
    Timeout,
    /// The stream has ended.
    End,
}

/// An error on opening or using a camera.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// No camera can be opened under this id.
    #[error("cannot open camera {id:?}: {reason}")]
    NotFound {
        /// The `id` of the configuration.
        id: String,
        /// The attempt and its outcome.
        reason: String,
    },
    /// A system library is missing.
    #[error("cannot load {library}: {reason}; install the package {package}")]
    LibraryMissing {
        /// File name of the library.
        library: String,
        /// The distribution's package that contains it.
        package: String,
        /// The loader's message.
        reason: String,
    },
    /// The camera refused a setting.
    #[error("cannot set camera feature {feature} to {value}: {reason}")]
    Setting {
        /// Feature or configuration key.
        feature: String,
        /// The requested value.
        value: String,
        /// The allowed range, or the camera's message.
        reason: String,
    },
    /// The scenario is unknown or cannot be simulated.
    #[error("{origin}: camera.scenario = {name:?}: {reason}")]
    Scenario {
        /// The rig file.
        origin: String,
        /// The scenario's name or path.
        name: String,
        /// The reason.
        reason: String,
    },
    /// The connection to the camera was lost.
    #[error("lost camera {id:?}: {reason}")]
    Lost {
        /// The `id` of the configuration.
        id: String,
        /// The symptom.
        reason: String,
    },
    /// The recording that is replayed cannot be read.
    #[error(transparent)]
    Recording(#[from] crate::recording::RecordingError),
}

impl Fatal for CameraError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::Recording(error) => error.exit_code(),
            Self::Scenario { .. } => ExitCode::Usage,
            _ => ExitCode::Camera,
        }
    }
}

/// A source of frames.
///
/// The caller owns the memory. It hands in slots of the ring with [`queue`](Self::queue) and gets each back, filled,
/// from [`next`](Self::next). A camera that fills memory in the background (GenICam, V4L2) holds several slots at once.
/// One that fills memory on request needs one.
pub trait Camera {
    /// Returns the image size, pixel format and frame rate.
    fn format(&self) -> StreamFormat;

    /// Returns the model and serial number.
    fn identity(&self) -> CameraIdentity;

    /// Returns who sets the pace: the camera's own clock or its consumer.
    fn pace(&self) -> Pace;

    /// Returns the number of slots the camera wants to hold at once.
    fn slots(&self) -> usize;

    /// Queues a slot of at least `format().slot_bytes()` bytes, for one of the next frames.
    ///
    /// # Panics
    ///
    /// If the slot is smaller and the camera fills it in the background.
    fn queue(&mut self, slot: Slot);

    /// Starts the stream. Called once, after the first slots were queued and every reader is ready.
    ///
    /// # Errors
    ///
    /// If the camera refuses to start.
    fn start(&mut self) -> Result<(), CameraError>;

    /// Waits at most `timeout` for the next frame.
    ///
    /// # Errors
    ///
    /// If the camera is gone, or the recording that is replayed cannot be read.
    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError>;

    /// Skips all frames before this sequence number, and returns `true`, if the frames come from a film.
    ///
    /// Called before [`start`](Self::start). Real cameras ignore the call and return `false`.
    fn seek(&mut self, _sequence: u64) -> bool {
        false
    }

    /// Plays one frame per message instead of one per line of standard input, if the camera replays step by step.
    ///
    /// Called before [`start`](Self::start). Other cameras ignore the call.
    fn follow_steps(&mut self, _steps: Receiver<()>) {}

    /// Returns the time since the last returned frame was complete; zero if the camera does not know.
    fn frame_age(&self) -> Duration {
        Duration::ZERO
    }

    /// Returns the ground truth of the frame with this sequence number, a row per body.
    ///
    /// Empty unless the camera is simulated, and behind the last frame.
    fn truth(&self, _sequence: u64) -> Vec<crate::results::VelocitySample> {
        Vec::new()
    }
}
