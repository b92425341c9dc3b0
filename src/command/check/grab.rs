//! Frames from the camera of a rig, without its other processes.

use crate::bus::{Bus, FramePublisher, Limits};
use crate::camera::{CameraError, CameraIdentity, Next, Pace, StreamFormat};
use crate::config::Config;
use crate::failure::Failure;
use crate::image::FrameMeta;
use crate::process::{Source, Stop};
use std::time::{Duration, Instant};

/// Maximum number of frames that are kept: two blocks of the default length and the target of the last pair.
pub(super) const MAX_KEPT_FRAMES: usize = 33;
/// Maximum number of frames taken from a source on demand.
const MAX_ON_DEMAND_FRAMES: usize = 1000;
/// Timeout of a silent camera.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(5);
/// The time to wait for a frame before a stop is checked.
const FRAME_TIMEOUT: Duration = Duration::from_millis(50);
/// Row step for the mean grey level of a frame.
const ROW_STEP: usize = 4;

/// The frames that the camera delivered.
pub(super) struct Grabbed {
    pub(super) format: StreamFormat,
    pub(super) camera: CameraIdentity,
    /// The first frames.
    pub(super) frames: Vec<(FrameMeta, Vec<u8>)>,
    /// Time since the first frame, s, and mean grey level, DN, of every frame.
    pub(super) means: Vec<(f64, f64)>,
    /// Number of lost frames, including incomplete ones.
    pub(super) lost: u64,
    /// Whether the camera sets the pace.
    pub(super) is_live: bool,
}

impl Grabbed {
    /// Returns the frame rate from the time stamps, lost frames included; `None` for a single frame.
    pub(super) fn rate_hz(&self) -> Option<f64> {
        let (last, count) = (self.means.last()?.0, self.means.len() as u64 - 1 + self.lost);
        (last > 0.0).then(|| count as f64 / last)
    }
}

/// Films with the rig's camera for `seconds`, and until [`MAX_KEPT_FRAMES`] frames have come. A source on demand gives
/// up to [`MAX_ON_DEMAND_FRAMES`] frames instead.
///
/// It ends earlier at the end of the source, after a silence of 5 s, or on a stop.
///
/// # Errors
///
/// When the camera cannot be opened or delivers fewer than 3 frames.
pub(super) fn grab(config: &Config, seconds: f64, stop: &Stop) -> Result<Grabbed, Failure> {
    let mut source = Source::open(config)?;
    let format = source.format();
    let bus = Bus::join_as(&format!("check-{}", std::process::id()), "check", Duration::ZERO, None)?;
    let limits = Limits { workers: 1, fields: 1, ring_frames: 1, held_frames: 1, field_points: 1 };
    let mut ring = bus.frame_publisher(&limits, format.slot_bytes())?;
    let is_live = source.pace() == Pace::Live;
    let mut grabbed =
        Grabbed { format, camera: source.identity().clone(), frames: Vec::new(), means: Vec::new(), lost: 0, is_live };
    film(&mut source, &mut ring, &mut grabbed, seconds, stop)?;
    source.close();
    if grabbed.frames.len() < 3 && !stop.requested() {
        return Err(too_few_frames_error(config, grabbed.frames.len()).into());
    }
    Ok(grabbed)
}

/// Films until [`grab`] has what it needs, and adds each frame to `grabbed`.
fn film(
    source: &mut Source,
    ring: &mut FramePublisher,
    grabbed: &mut Grabbed,
    seconds: f64,
    stop: &Stop,
) -> Result<(), Failure> {
    let (mut queued, mut next, mut torn, mut first_ns) = (0, None, 0, None);
    let mut began = now();
    let mut last_frame = began;
    let mut started = false;
    while !stop.requested() {
        while queued < source.camera().slots().min(Limits::CAMERA_SLOTS) {
            let Some(slot) = ring.lend()? else { break };
            source.camera().queue(slot);
            queued += 1;
        }
        if !std::mem::replace(&mut started, true) {
            source.camera().start()?;
            (began, last_frame) = (now(), now());
        }
        match source.camera().next(FRAME_TIMEOUT)? {
            Next::Frame(mut slot, meta) => {
                let from = *first_ns.get_or_insert(meta.stamp_ns);
                grabbed.add_frame(&meta, slot.bytes_mut(), from);
                grabbed.lost += meta.sequence.saturating_sub(next.unwrap_or(meta.sequence));
                next = Some(meta.sequence + 1);
                torn = 0;
                ring.take_back(slot);
                queued -= 1;
                last_frame = now();
            }
            Next::Incomplete(slot, _) => {
                // The gap in the sequence numbers counts it, unless no complete frame follows.
                torn += 1;
                ring.take_back(slot);
                queued -= 1;
            }
            Next::Timeout => {}
            Next::End => break,
        }
        let enough = if grabbed.is_live {
            began.elapsed().as_secs_f64() >= seconds
        } else {
            grabbed.means.len() >= MAX_ON_DEMAND_FRAMES
        };
        let is_complete = enough && grabbed.means.len() >= MAX_KEPT_FRAMES;
        if is_complete || last_frame.elapsed() > SILENCE_TIMEOUT {
            break;
        }
    }
    grabbed.lost += torn;
    Ok(())
}

/// Returns the error of a camera that delivered only `received` frames.
fn too_few_frames_error(config: &Config, received: usize) -> CameraError {
    let id = config.camera.id.clone().or(config.camera.scenario.clone()).unwrap_or_default();
    let waits = match &config.camera.trigger_source {
        Some(trigger) => format!("; it waits for a trigger on {trigger}"),
        None => String::new(),
    };
    CameraError::NotFound { id, reason: format!("received {received} frames, at least 3 are needed{waits}") }
}

impl Grabbed {
    /// Adds the time and the mean grey level of a frame, and keeps the frame if it is among the first
    /// [`MAX_KEPT_FRAMES`]. `first_ns` is the stamp of the first.
    fn add_frame(&mut self, meta: &FrameMeta, bytes: &[u8], first_ns: u64) {
        let since_s = meta.stamp_ns.saturating_sub(first_ns) as f64 * 1e-9;
        self.means.push((since_s, mean_dn(meta, bytes)));
        if self.frames.len() < MAX_KEPT_FRAMES {
            // Renumbered from 0, so that blocks begin where the measurer expects them.
            let renumbered = FrameMeta { sequence: self.frames.len() as u64, ..*meta };
            let size = meta.stride_bytes as usize * meta.height_px as usize;
            self.frames.push((renumbered, bytes[..size.min(bytes.len())].to_vec()));
        }
    }
}

/// Returns the mean grey level of every [`ROW_STEP`]-th row, DN.
fn mean_dn(meta: &FrameMeta, bytes: &[u8]) -> f64 {
    let (width, size) = (meta.width_px as usize, meta.format.bytes_per_pixel());
    let rows = (0..meta.height_px as usize).step_by(ROW_STEP);
    let lines = rows.filter_map(|row| bytes.get(row * meta.stride_bytes as usize..)?.get(..width * size));
    let (mut sum, mut count) = (0_u64, 0_u64);
    for line in lines {
        sum += match size {
            1 => line.iter().map(|byte| u64::from(*byte)).sum::<u64>(),
            _ => line.chunks_exact(2).map(|pair| u64::from(u16::from_le_bytes([pair[0], pair[1]]))).sum(),
        };
        count += width as u64;
    }
    sum as f64 / count.max(1) as f64
}

/// Reads the clock.
#[expect(clippy::disallowed_methods, reason = "how long is filmed, and when a camera is silent")]
pub(super) fn now() -> Instant {
    Instant::now()
}
