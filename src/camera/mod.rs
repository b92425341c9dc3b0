//! Cameras: whatever fills a slot of the ring with a frame.

mod delivery;
pub mod genicam;
pub mod priority;
pub mod recording;
mod setting;
pub mod simulated;
mod slot;
pub mod v4l2;

pub use slot::Slot;

use crate::image::{FrameMeta, PixelFormat};
use std::time::Duration;

/// Shape and rate of what a camera delivers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamFormat {
    /// Pixels a row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Pixel layout.
    pub format: PixelFormat,
    /// Frames a second the camera was set to.
    pub frame_rate_hz: f64,
    /// How long a frame is exposed, us; 0 when it is not known.
    pub exposure_us: f64,
}

impl StreamFormat {
    /// Bytes a slot must hold.
    pub fn slot_bytes(&self) -> usize {
        self.width_px as usize * self.height_px as usize * self.format.bytes_per_pixel()
    }
}

/// What a camera is, for the recording's metadata.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CameraIdentity {
    /// Maker and model.
    pub model: String,
    /// Serial number.
    pub serial: String,
}

/// Whether frames arrive by themselves or on request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// The camera's own clock: whoever is slow loses frames.
    Live,
    /// As fast as they are taken: the taker may hold it back and nothing is lost.
    OnDemand,
}

/// What a camera says when asked for its next frame.
#[derive(Debug)]
pub enum Next {
    /// A whole frame, in the slot it was given.
    Frame(Slot, FrameMeta),
    /// A frame that did not arrive whole; the slot comes back with unspecified content.
    Torn(Slot, String),
    /// Nothing within the time allowed.
    Nothing,
    /// There will be no more frames.
    End,
}

/// Why a camera could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// No camera answers to this name.
    #[error("open camera {id:?}: {reason}")]
    NotFound {
        /// The `id` of the configuration.
        id: String,
        /// What was tried and what happened.
        reason: String,
    },
    /// A system library is missing.
    #[error("load {library}: {reason}; install the package {package}")]
    LibraryMissing {
        /// File name of the library.
        library: String,
        /// The distribution's package that holds it.
        package: String,
        /// The loader's words.
        reason: String,
    },
    /// A setting was refused.
    #[error("set camera feature {feature} to {value}: {reason}")]
    Setting {
        /// Feature or configuration key.
        feature: String,
        /// The value wanted.
        value: String,
        /// The allowed range, or the camera's words.
        reason: String,
    },
    /// What is to be simulated is unknown or cannot be filmed.
    #[error("{origin}: camera.scenario = {name:?}: {reason}")]
    Scenario {
        /// The rig file.
        origin: String,
        /// The scenario's name or path.
        name: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The camera went away.
    #[error("camera {id:?} vanished: {reason}")]
    Vanished {
        /// The `id` of the configuration.
        id: String,
        /// What was seen.
        reason: String,
    },
    /// The source file cannot be read (recordings used as a camera).
    #[error(transparent)]
    Recording(#[from] crate::recording::RecordingError),
}

/// A source of frames.
///
/// The caller owns the memory: it hands in slots of the ring with
/// [`queue`](Self::queue) and gets each back, filled, from [`next`](Self::next).
/// A camera that fills memory in the background (GenICam) holds several slots at
/// once; one that fills on request needs one.
pub trait Camera {
    /// Shape and rate of the frames.
    fn format(&self) -> StreamFormat;

    /// Model and serial number.
    fn identity(&self) -> CameraIdentity;

    /// Whether the camera can be held back.
    fn pace(&self) -> Pace;

    /// How many slots it wants to hold at once.
    fn slots(&self) -> usize;

    /// Hands a slot of at least `format().slot_bytes()` bytes over.
    fn queue(&mut self, slot: Slot);

    /// Starts delivering: called once, after the first slots were queued and every reader is ready.
    ///
    /// # Errors
    ///
    /// When the camera refuses to start.
    fn start(&mut self) -> Result<(), CameraError>;

    /// Waits for the next frame, at most `timeout`.
    ///
    /// # Errors
    ///
    /// When the camera is gone.
    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError>;

    /// Goes on with the frame of this number, where frames come from a film: what lies before it is not delivered.
    ///
    /// Called before [`start`](Self::start). `false`, and nothing else, from cameras that film.
    fn go_to(&mut self, _sequence: u64) -> bool {
        false
    }

    /// How long ago the frame given last was there, whole; zero from cameras that cannot tell.
    fn waited(&self) -> Duration {
        Duration::ZERO
    }

    /// Known truth of the frame with this sequence number, for simulated cameras.
    fn truth(&self, _sequence: u64) -> Vec<crate::results::VelocitySample> {
        Vec::new()
    }
}
