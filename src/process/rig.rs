//! From a configuration to the parts of a rig: the camera, the limits, what the measuring rooms are planned with.

use crate::bus::Limits;
use crate::camera::genicam::{GenicamCamera, GenicamSettings};
use crate::camera::recording::{PlaybackRate, RecordingCamera, Repeat, Span};
use crate::camera::simulated::{SimulatedCamera, load_scenario};
use crate::camera::v4l2::{V4l2Camera, V4l2Settings};
use crate::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use crate::config::{self, Config};
use crate::image::{PixelFormat, Tone};
use crate::measure::{BodyParams, MeasureParams};
use crate::motion::{MotionParams, View};
use crate::recording::{Recording, RecordingError};
use crate::synth::{Scenario, World};
use crate::track::TrackerParams;
use std::path::PathBuf;
use std::time::Duration;

/// Frames the ring holds when no trigger asks for more: what a burst may bring before the workers catch up.
const BURST_FRAMES: usize = 512;
/// Time a trigger may take to reach the recorder, s; the ring holds that much more than `pre_s`.
const DECISION_S: f64 = 0.25;

/// How long a process waits for the one before it in the same role to be gone.
pub(super) const SUCCESSION: Duration = Duration::from_secs(5);

/// The camera of a rig, which can be closed and opened again.
pub struct Source {
    camera: Box<dyn Camera>,
    format: StreamFormat,
    identity: CameraIdentity,
    pace: Pace,
    live: bool,
}

impl Source {
    /// Opens the camera that the configuration names.
    ///
    /// # Errors
    ///
    /// When it does not answer or refuses a setting.
    pub fn open(config: &Config) -> Result<Self, CameraError> {
        let camera = open_camera(config)?;
        let live = config.camera.source.is_device();
        Ok(Self { format: camera.format(), identity: camera.identity(), pace: camera.pace(), camera, live })
    }

    /// Shape and rate of its frames.
    pub fn format(&self) -> StreamFormat {
        self.format
    }

    /// Model and serial number.
    pub fn identity(&self) -> &CameraIdentity {
        &self.identity
    }

    /// Whether it can be held back.
    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// Whether its stamps are of now.
    pub fn is_live(&self) -> bool {
        self.live
    }

    /// The camera itself; one that has ended when it is closed.
    pub fn camera(&mut self) -> &mut dyn Camera {
        self.camera.as_mut()
    }

    /// Lets go of the camera and of every slot it holds.
    pub fn close(&mut self) {
        self.camera = Box::new(Closed(self.format));
    }

    /// Opens it again after it vanished.
    ///
    /// # Errors
    ///
    /// When it still does not answer, or delivers frames of another shape.
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

/// No camera.
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

/// Opens the camera that the configuration names.
///
/// # Errors
///
/// When it does not answer or refuses a setting.
pub fn open_camera(config: &Config) -> Result<Box<dyn Camera>, CameraError> {
    let camera = &config.camera;
    Ok(match camera.source {
        config::Source::Simulated => {
            let world = World::new(&scenario(config)?).map_err(|error| refused(config, &error))?;
            Box::new(SimulatedCamera::film(world, camera.paced)?.pulsed(camera.pulse)?)
        }
        config::Source::Recording => {
            let path = PathBuf::from(camera.id.clone().unwrap_or_default());
            let rate = if camera.paced { PlaybackRate::Times(camera.playback_rate) } else { PlaybackRate::Max };
            let span = Span { from_s: camera.from_s, to_s: camera.to_s.unwrap_or(f64::INFINITY) };
            let files: Vec<PathBuf> =
                std::iter::once(path.clone()).chain(camera.parts.iter().map(Into::into)).collect();
            let film = Recording::joined(Recording::open_all(&files)?);
            let film = film.ok_or_else(|| RecordingError::invalid(&path, "no recording"))?;
            let film = film.of_camera(camera.view.as_deref())?;
            let recording = RecordingCamera::play(film, rate, Repeat::Once)?.within(span).shifted(camera.shift_ns);
            let recording = if camera.stepped { recording.stepped() } else { recording };
            if recording.format().frame_rate_hz <= 0.0 {
                let reason = "its frames tell no frame rate; `ricochet analyze` takes one with --fps".to_owned();
                return Err(RecordingError::Invalid { path, reason }.into());
            }
            Box::new(recording)
        }
        config::Source::Genicam => Box::new(GenicamCamera::open(&GenicamSettings::from(camera))?),
        config::Source::V4l2 => Box::new(V4l2Camera::open(&V4l2Settings::from(camera))?),
    })
}

/// The simulated world behind the camera, when there is one.
///
/// # Errors
///
/// When the scenario is unknown or wrong.
pub fn truth_world(config: &Config) -> Result<Option<World>, CameraError> {
    if config.camera.source != config::Source::Simulated {
        return Ok(None);
    }
    let world = World::new(&scenario(config)?).map_err(|error| refused(config, &error))?;
    Ok(Some(world))
}

/// The scenario that the configuration names, filmed the way it says.
fn scenario(config: &Config) -> Result<Scenario, CameraError> {
    let camera = &config.camera;
    let name = camera.scenario.clone().unwrap_or_else(|| "lacrosse".into());
    let mut scenario = load_scenario(&name).map_err(|error| refused(config, &error))?;
    let setup = &mut scenario.camera;
    setup.width_px = camera.width_px.unwrap_or(setup.width_px);
    setup.height_px = camera.height_px.unwrap_or(setup.height_px);
    setup.frame_rate_hz = camera.frame_rate_hz.unwrap_or(setup.frame_rate_hz);
    setup.exposure_us = camera.exposure_us.unwrap_or(setup.exposure_us);
    setup.bits = camera.pixel_format.map_or(setup.bits, PixelFormat::bits);
    Ok(scenario)
}

fn refused(config: &Config, error: &dyn std::fmt::Display) -> CameraError {
    let name = config.camera.scenario.clone().unwrap_or_default();
    CameraError::Scenario { origin: config.origin.clone(), name, reason: error.to_string() }
}

/// What all processes of the rig agree on, given what the camera delivers.
pub(super) fn limits(config: &Config, format: &StreamFormat) -> Limits {
    let rate_hz = format.frame_rate_hz;
    let pre = config.pre_trigger_frames(rate_hz) as usize;
    let block = config.workers.block_frames as usize;
    let waits = pre > 0;
    let ring_frames = if waits { pre + block + (DECISION_S * rate_hz).ceil() as usize } else { 0 }.max(BURST_FRAMES);
    // A trigger takes the whole queue at once; the ring goes on behind it however slowly that is written.
    let held_frames = if waits { ring_frames } else { 64 };
    let points = (0..config.bodies.len()).map(|body| {
        let along = |extent_px: f64| (extent_px / f64::from(config.correlation.step_px)).ceil() as usize + 1;
        match config.bodies[body].kind {
            config::BodyKind::Ball => {
                let most_px = 2.0 * config.ball(body, format.width_px, format.height_px).max_radius_px;
                along(most_px) * along(most_px)
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

/// Shape of the stream that this configuration will deliver, without starting the camera.
///
/// # Errors
///
/// When the camera would have to be asked and does not answer.
pub(super) fn expected_format(config: &Config) -> Result<StreamFormat, CameraError> {
    let camera = &config.camera;
    if let (true, Some((width_px, height_px)), Some(frame_rate_hz)) =
        (camera.source.is_device(), camera.image_px(), camera.frame_rate_hz)
    {
        let format = camera.pixel_format.unwrap_or_default();
        let exposure_us = camera.exposure_us.unwrap_or(0.0);
        return Ok(StreamFormat { width_px, height_px, format, frame_rate_hz, exposure_us });
    }
    Ok(open_camera(config)?.format())
}

/// Takes the exposure out of a frame's header where neither the rig file nor the camera's name told it; `true` when it did.
pub(super) fn learn_exposure(config: &Config, format: &mut StreamFormat, exposure_ns: u32) -> bool {
    let learns = config.camera.exposure_us.is_none() && format.exposure_us <= 0.0 && exposure_ns > 0;
    if learns {
        format.exposure_us = f64::from(exposure_ns) * 1e-3;
    }
    learns
}

/// What the measurement is planned with, for frames of this shape.
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
            view: View::of([format.width_px, format.height_px], params.rectifier.as_ref()),
            shutter: params.shutter.over([format.width_px, format.height_px]),
            ..params
        }
    };
    let tracker = TrackerParams {
        motion: bodies.map(motion).collect(),
        longer_frames: config.intervals_frames[1..].to_vec(),
        contact: true,
    };
    (measure, tracker)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GENICAM: &str =
        "[camera]\nsource = \"genicam\"\nid = \"a\"\nwidth_px = 64\nheight_px = 64\nframe_rate_hz = 100\n";

    /// Exposures that tracks are computed with, ns: before and after a frame's header told one.
    fn exposures_ns(text: &str, told_ns: u32) -> (f64, f64) {
        let config = Config::parse(text, "rig.toml").unwrap();
        let mut format = expected_format(&config).unwrap();
        let before = analysis_params(&config, &format).1.motion[0].exposure_ns;
        learn_exposure(&config, &mut format, told_ns);
        (before, analysis_params(&config, &format).1.motion[0].exposure_ns)
    }

    #[test]
    fn the_exposure_that_the_camera_was_left_with_comes_with_the_frames() {
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
