//! The parts of a rig from its configuration: the camera, the limits, the measurement parameters.

use crate::bus::Limits;
use crate::camera::genicam::GenicamCamera;
use crate::camera::replay::{Playback, PlaybackRate, ReplayCamera, TimeRange};
use crate::camera::simulated::{SimulatedCamera, load_scenario, stream_format};
use crate::camera::v4l2::V4l2Camera;
use crate::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::config::{self, Config};
use crate::image::{PixelFormat, Tone};
use crate::measure::{BodyParams, MeasureParams};
use crate::motion::{MotionParams, View};
use crate::recording::{Recording, RecordingError};
use crate::results::FrameCoding;
use crate::synth::{Scenario, SimulatedFilm};
use crate::track::TrackerParams;
use std::path::PathBuf;
use std::time::Duration;

/// Minimum size of the ring, frames: a burst that may arrive before the workers catch up.
const BURST_FRAMES: usize = 512;
/// Maximum time from a trigger condition to the recorder, s; the ring is larger than `pre_s` by this.
const MAX_DECISION_S: f64 = 0.25;

/// Time for the predecessor in the same role to end.
pub(super) const SUCCESSION_TIMEOUT: Duration = Duration::from_secs(5);

/// The camera of a rig, which can be closed and reopened.
pub struct Source {
    camera: Box<dyn Camera>,
    format: StreamFormat,
    identity: CameraIdentity,
    pace: Pace,
    live: bool,
}

impl Source {
    /// Opens the configured camera.
    ///
    /// # Errors
    ///
    /// If it does not answer or refuses a setting.
    pub fn open(config: &Config) -> Result<Self, CameraError> {
        let camera = open_camera(config)?;
        let live = config.camera.has_present_stamps();
        Ok(Self { format: camera.format(), identity: camera.identity(), pace: camera.pace(), camera, live })
    }

    /// Returns the image size, pixel format and frame rate.
    pub fn format(&self) -> StreamFormat {
        self.format
    }

    /// Returns the model and serial number.
    pub fn identity(&self) -> &CameraIdentity {
        &self.identity
    }

    /// Returns who sets the pace: the camera's own clock or its consumer.
    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// Whether its stamps are of the present.
    pub fn is_live(&self) -> bool {
        self.live
    }

    /// Returns the camera; a closed one has ended.
    pub fn camera(&mut self) -> &mut dyn Camera {
        self.camera.as_mut()
    }

    /// Closes the camera and releases every slot it holds.
    pub fn close(&mut self) {
        self.camera = Box::new(Closed(self.format));
    }

    /// Reopens the camera after it was lost.
    ///
    /// # Errors
    ///
    /// If it still does not answer, or delivers another frame size.
    pub fn reopen(&mut self, config: &Config) -> Result<(), CameraError> {
        let camera = open_camera(config)?;
        if camera.format().slot_bytes() != self.format.slot_bytes() {
            let id = config.camera.id.clone().unwrap_or_default();
            return Err(CameraError::NotFound { id, reason: "it came back with another frame size".into() });
        }
        self.camera = camera;
        Ok(())
    }
}

/// A closed camera, whose stream has ended.
struct Closed(StreamFormat);

impl Camera for Closed {
    fn format(&self) -> StreamFormat {
        self.0
    }
    fn identity(&self) -> CameraIdentity {
        CameraIdentity::default()
    }
    fn pace(&self) -> Pace {
        Pace::Live
    }
    fn slots(&self) -> usize {
        0
    }
    fn queue(&mut self, _slot: Slot) {}
    fn start(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
    fn next(&mut self, _timeout: Duration) -> Result<Next, CameraError> {
        Ok(Next::End)
    }
}

/// Opens the configured camera.
///
/// # Errors
///
/// If it does not answer or refuses a setting.
pub fn open_camera(config: &Config) -> Result<Box<dyn Camera>, CameraError> {
    let camera = &config.camera;
    let source = camera
        .source
        .ok_or_else(|| CameraError::NotFound { id: config.origin.clone(), reason: "it has no camera.source".into() })?;
    Ok(match source {
        config::Source::Simulated => {
            let world = simulated_world(config)?;
            match camera.endless {
                true => Box::new(SimulatedCamera::endless(world)?),
                false => {
                    let pace = if camera.paced { Pace::Live } else { Pace::OnDemand };
                    Box::new(SimulatedCamera::film(world, pace)?.pulsed(camera.pulse)?)
                }
            }
        }
        config::Source::Recording => {
            let path = PathBuf::from(camera.id.clone().unwrap_or_default());
            let rate = match camera.paced {
                _ if camera.stepped => PlaybackRate::Stepped,
                true => PlaybackRate::Times(camera.playback_rate),
                false => PlaybackRate::Max,
            };
            let range = TimeRange { from_s: camera.from_s, to_s: camera.to_s.unwrap_or(f64::INFINITY) };
            let files: Vec<PathBuf> =
                std::iter::once(path.clone()).chain(camera.parts.iter().map(Into::into)).collect();
            let film = Recording::joined(Recording::open_all(&files)?);
            let film = film.ok_or_else(|| RecordingError::invalid(&path, "no recording"))?;
            let film = film.select_view(camera.view.as_deref())?;
            let recording = ReplayCamera::new(film, Playback { rate, range, shift_ns: camera.shift_ns })?;
            if recording.format().frame_rate_hz <= 0.0 {
                let reason = "it has no frame rate; pass one with `ricochet analyze --fps`";
                return Err(RecordingError::invalid(&path, reason).into());
            }
            Box::new(recording)
        }
        config::Source::Genicam => Box::new(GenicamCamera::open(camera)?),
        config::Source::V4l2 => Box::new(V4l2Camera::open(camera)?),
    })
}

/// Returns the simulated film that is played once and has the ground truth; `None` for other cameras.
///
/// # Errors
///
/// If the scenario is unknown or invalid.
pub fn truth_world(config: &Config) -> Result<Option<SimulatedFilm>, CameraError> {
    let is_played_once = config.camera.source == Some(config::Source::Simulated) && !config.camera.endless;
    is_played_once.then(|| simulated_world(config)).transpose()
}

/// Returns the configured film, without a rendered frame.
///
/// # Errors
///
/// If the scenario is unknown or invalid.
fn simulated_world(config: &Config) -> Result<SimulatedFilm, CameraError> {
    SimulatedFilm::new(&load_configured_scenario(config)?).map_err(|error| scenario_error(config, &error))
}

/// Returns the configured scenario, `lacrosse` by default, with the camera settings of the rig.
///
/// # Errors
///
/// [`CameraError::Scenario`] if the scenario is unknown or invalid.
fn load_configured_scenario(config: &Config) -> Result<Scenario, CameraError> {
    let camera = &config.camera;
    let name = camera.scenario.clone().unwrap_or_else(|| "lacrosse".into());
    let mut scenario = load_scenario(&name).map_err(|error| scenario_error(config, &error))?;
    let setup = &mut scenario.camera;
    setup.width_px = camera.width_px.unwrap_or(setup.width_px);
    setup.height_px = camera.height_px.unwrap_or(setup.height_px);
    setup.frame_rate_hz = camera.frame_rate_hz.unwrap_or(setup.frame_rate_hz);
    setup.exposure_us = camera.exposure_us.unwrap_or(setup.exposure_us);
    setup.bits = camera.pixel_format.map_or(setup.bits, PixelFormat::bits);
    Ok(scenario)
}

/// Returns the error for a scenario that cannot be simulated.
fn scenario_error(config: &Config, error: &dyn std::fmt::Display) -> CameraError {
    let name = config.camera.scenario.clone().unwrap_or_default();
    CameraError::Scenario { origin: config.origin.clone(), name, reason: error.to_string() }
}

/// Returns the limits of the bus services, on which all processes of the rig agree.
pub(super) fn limits(config: &Config, format: &StreamFormat) -> Limits {
    let rate_hz = format.frame_rate_hz;
    let pre = config.pre_trigger_frames(rate_hz) as usize;
    let block = config.workers.block_frames as usize;
    let has_pre_trigger = pre > 0;
    let ring_frames =
        if has_pre_trigger { pre + block + (MAX_DECISION_S * rate_hz).ceil() as usize } else { 0 }.max(BURST_FRAMES);
    // A trigger takes the whole queue at once, and the ring continues behind it however slow the writing is.
    let held_frames = if has_pre_trigger { ring_frames } else { 64 };
    let points = (0..config.bodies.len()).map(|body| {
        // The number of subsets along a side.
        let along = |extent_px: f64| (extent_px / f64::from(config.correlation.step_px)).ceil() as usize + 1;
        match config.bodies[body].kind {
            config::BodyKind::Ball => {
                let diameter_px = 2.0 * config.ball(body, format.width_px, format.height_px).max_radius_px;
                along(diameter_px) * along(diameter_px)
            }
            config::BodyKind::Rod | config::BodyKind::Patch => {
                along(f64::from(format.width_px)) * along(f64::from(format.height_px))
            }
        }
    });
    Limits {
        workers: config.workers.count,
        fields: (config.bodies.len() * config.intervals_frames.len()) as u32,
        ring_frames,
        held_frames,
        field_points: points.max().unwrap_or(1),
    }
}

/// Returns the stream format of this configuration without starting the camera.
///
/// # Errors
///
/// If the camera must be opened for that and does not answer.
pub(super) fn expected_format(config: &Config) -> Result<StreamFormat, CameraError> {
    let camera = &config.camera;
    if let (true, Some((width_px, height_px)), Some(frame_rate_hz)) =
        (camera.is_device(), camera.image_px(), camera.frame_rate_hz)
    {
        let format = camera.pixel_format.unwrap_or_default();
        let exposure_us = camera.exposure_us.unwrap_or(0.0);
        return Ok(StreamFormat {
            width_px,
            height_px,
            format,
            frame_rate_hz,
            exposure_us,
            coding: FrameCoding::default(),
        });
    }
    if camera.source == Some(config::Source::Simulated) {
        // An open camera may render its whole film first.
        return Ok(stream_format(&simulated_world(config)?));
    }
    Ok(open_camera(config)?.format())
}

/// Copies the exposure from the header of a frame, ns (0 if unknown), if neither rig file nor camera gave it. Returns
/// whether it did.
pub(super) fn update_exposure(config: &Config, format: &mut StreamFormat, exposure_ns: u32) -> bool {
    let is_new = config.camera.exposure_us.is_none() && format.exposure_us <= 0.0 && exposure_ns > 0;
    if is_new {
        format.exposure_us = f64::from(exposure_ns) * 1e-3;
    }
    is_new
}

/// Returns the parameters of measurement and tracking for frames of this format.
pub fn analysis_params(config: &Config, format: &StreamFormat) -> (MeasureParams, TrackerParams) {
    let bodies = 0..config.bodies.len();
    let measure = MeasureParams {
        correlation: config.correlation(),
        intervals_frames: config.intervals_frames.clone(),
        rotation: config.rotation,
        bodies: bodies
            .clone()
            .map(|body| match (&config.bodies[body].patch, config.bodies[body].kind) {
                (Some(patch), _) => BodyParams::Patch(patch.clone()),
                (None, config::BodyKind::Rod) => BodyParams::Rod(config.rod(body)),
                (None, _) => BodyParams::Ball(config.ball(body, format.width_px, format.height_px)),
            })
            .collect(),
        tone: Tone::new(config.camera.gamma, format.format),
        defective_px: config.camera.defective_px.clone(),
        block_frames: config.workers.block_frames,
    };
    let motion = |body: usize| {
        let params = config.motion(body, format.frame_rate_hz, format.exposure_us);
        MotionParams {
            view: View::new([format.width_px, format.height_px], params.rectifier.as_ref()),
            coding: format.coding,
            shutter: params.shutter.over([format.width_px, format.height_px]),
            ..params
        }
    };
    let tracker = TrackerParams {
        motion: bodies.map(motion).collect(),
        longer_frames: config.intervals_frames[1..].to_vec(),
        contact: true,
        surface_body: config.surface.body,
    };
    (measure, tracker)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GENICAM: &str =
        "[camera]\nsource = \"genicam\"\nid = \"a\"\nwidth_px = 64\nheight_px = 64\nframe_rate_hz = 100\n";

    /// Returns the exposures that tracks are computed with, ns: before and after a frame's header gave one.
    fn exposures_ns(text: &str, header_ns: u32) -> (f64, f64) {
        let config = Config::parse(text, "rig.toml").unwrap();
        let mut format = expected_format(&config).unwrap();
        let before = analysis_params(&config, &format).1.motion[0].exposure_ns;
        update_exposure(&config, &mut format, header_ns);
        (before, analysis_params(&config, &format).1.motion[0].exposure_ns)
    }

    #[test]
    fn an_exposure_that_is_not_configured_comes_with_the_frames() {
        assert_eq!(exposures_ns(GENICAM, 4_000_000), (0.0, 4.0e6));
        assert_eq!(exposures_ns(GENICAM, 0), (0.0, 0.0));
        assert_eq!(
            exposures_ns(&format!("{GENICAM}exposure_us = 30\n"), 4_000_000),
            (3.0e4, 3.0e4),
            "the file goes first"
        );
        assert_eq!(exposures_ns("[camera]\nsource = \"simulated\"\n", 5), (2.0e4, 2.0e4), "what is known stays");
    }
}
