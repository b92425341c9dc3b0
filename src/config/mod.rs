//! The rig file: from TOML to checked settings.
//!
//! There are two stages. The first reads only names and types (`raw`). The second checks every number and word and their
//! combinations, so that nothing downstream checks again. Settings that this version does not support are refused by
//! name. No setting is accepted and then ignored.
//!
//! Every error is one line with the file, the line, the key, the value and the allowed range. Relative paths in the file
//! (`camera.id` of a recording, `camera.scenario`, `record.directory`) start at the working directory. The file may be
//! anywhere, and its text means the same inside a recording.
//!
//! ```
//! use ricochet::config::Config;
//!
//! let config = Config::parse("[camera]\nsource = \"simulated\"\n", "rig.toml")?;
//! assert_eq!(config.bodies[0].name, "ball");
//!
//! let error = Config::parse("[camera]\nsorce = \"simulated\"\n", "rig.toml").unwrap_err();
//! assert_eq!(
//!     error.to_string(),
//!     "rig.toml, line 2: unknown key camera.sorce; the nearest known key is camera.source"
//! );
//! # Ok::<(), ricochet::config::ConfigError>(())
//! ```

mod body;
mod bridge;
mod calibration;
mod camera;
mod capture;
mod check;
mod correlation;
mod drawing;
mod edit;
mod error;
mod geometry;
mod key;
mod plan;
mod polygon;
mod raw;
mod reference;
mod serve;
mod text;
mod trigger;
mod view;

pub use crate::dic::CorrelationParams;
pub use crate::motion::{Rectifier, Rotation, Scale};
pub use body::{Body, BodyKind};
pub use bridge::Bridge;
pub use camera::{Camera, FeatureValue, Pulse, Source};
pub use capture::{Compression, DEFAULT_BLOCK_FRAMES, Record, WorkerMode, Workers};
pub use drawing::{DrawingError, Shape, ShapeKey};
pub use error::{ConfigError, Problem};
pub use geometry::{Surface, Velocity};
pub use key::{Key, NumberRange, Section};
pub use reference::{Entry, find, reference, schema, to_markdown};
pub use serve::{Broker, Serve};
pub use trigger::{Trigger, TriggerMode};
pub use view::View;

use check::Table;
use raw::RawView;
use std::io::{ErrorKind, Read};
use std::path::Path;
use text::Text;

/// The maximum size of a rig file, bytes. A larger file is something else.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// The maximum length of a rig's name, bytes.
const MAX_RIG_NAME_CHARACTERS: usize = 32;

/// `[rig]`: the rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rig {
    /// The name in shared memory, 1 to 32 of `a-z 0-9 _ -`, default `rig`. Two rigs on one machine need different names.
    pub name: String,
}

/// A rig, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// `[rig]`: the rig.
    pub rig: Rig,
    /// `[camera]`: the source of the frames.
    pub camera: Camera,
    /// `[scale]`: either `mm_per_px` (0.000001 to 1000 mm/px), or `ball_diameter_mm` (above 0, at most 10000 mm), which
    /// takes the scale from the measured radius, or the scale of the calibrated plane. `None`: results are in pixels only.
    pub scale: Option<Scale>,
    /// `[calibration]`: the camera's lens (`camera_matrix`, `distortion_model`, `distortion`), the plane of motion
    /// (`homography_mm`, from undistorted pixels), or both. They hold for an image of `image_px`, in which the recorded one
    /// begins at `offset_px`. `file` names a file with these numbers, which replace it in `text`. `None`: a pixel has the
    /// same size everywhere.
    pub calibration: Option<Rectifier>,
    /// `[surface]`: the surface that bodies strike.
    pub surface: Surface,
    /// `[[body]]`: the bodies to follow, 1 to 16. A file without any has a ball named `ball`.
    pub bodies: Vec<Body>,
    /// `[correlation]`: the measurement of displacements. Ranges: `subset_size_px` odd, 9 to 255; `step_px` 1 to 255;
    /// `spline_points` 0 to 20; `search_px` 1 to 1024; `min_zncc` 0 to 1. The correlator decides which methods, shapes and
    /// windows can be combined.
    pub correlation: CorrelationParams,
    /// `[correlation] interval_frames`: the intervals from reference to target, rising, each 1 to 255 frames, default
    /// `[1]`. Longer ones keep the sum of the first one's steps from drifting.
    pub intervals_frames: Vec<u32>,
    /// `[rotation]`: the source of motion and spin of balls, `method` default `rigid`. A `ring` is between `ring_inner_px`
    /// and `ring_outer_px`, each 1 to 32768 px and at least 4 px apart, default 0.35 and 0.96 of the ball's radius. The
    /// motion of a rod always comes from its subsets. If all bodies are rods, only `field` is accepted.
    pub rotation: Rotation,
    /// `[velocity]`: the fit of velocities to positions.
    pub velocity: Velocity,
    /// `[trigger]`: the start of a shot.
    pub trigger: Trigger,
    /// `[record]`: the recordings; `None` without this table, and then nothing is recorded.
    pub record: Option<Record>,
    /// `[workers]`: the division of the work.
    pub workers: Workers,
    /// `[serve]`: the operator's page and the streams.
    pub serve: Serve,
    /// `[bridge]`: the topics for other hosts.
    pub bridge: Bridge,
    /// `[view.NAME]`: further cameras, at most 8, in order of their names.
    pub views: Vec<View>,
    /// The text of the file, with calibration files replaced by their numbers. It is attached to every recording.
    pub text: String,
    /// The name of the file in error messages.
    pub origin: String,
}

impl Config {
    /// Reads and checks a rig file.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when the file cannot be read, is larger than 1 MiB, is not UTF-8, or [`parse`](Self::parse) refuses
    /// it.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let origin = path.as_ref().display().to_string();
        match read_limited(path.as_ref()) {
            Ok(text) => Self::parse_with_files(&text, &origin),
            Err(reason) => Err(ConfigError { origin, line: None, problem: Problem::Unreadable(reason).into() }),
        }
    }

    /// Replaces calibration files by their numbers, then [parses](Self::parse).
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when a calibration file cannot be used, or as [`parse`](Self::parse).
    fn parse_with_files(text: &str, origin: &str) -> Result<Self, ConfigError> {
        match calibration::embed_files(text, |name| read_limited(Path::new(name))) {
            None => Self::parse(text, origin),
            Some(Ok(text)) => Self::parse(&text, origin),
            Some(Err((key, reason))) => Err(Text::new(text, origin)?.refuse(&key, reason)),
        }
    }

    /// Parses and checks the text of a rig file. `origin` is its name in error messages.
    ///
    /// No other file is read, so `calibration.file` is refused; [`load`](Self::load) replaces it by the numbers of the file.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when the text is not TOML or has an unknown key, a wrong type, a value out of range, contradicting
    /// values, or an unsupported setting.
    pub fn parse(text: &str, origin: &str) -> Result<Self, ConfigError> {
        let file = Text::new(text, origin)?;
        let raw = file.raw()?;
        let record =
            raw.record.map(|record| capture::check_record(&Table::new(&file, "record"), record)).transpose()?;
        let rig = check_rig(&Table::new(&file, "rig"), raw.rig.name)?;
        let (camera, scale, surface, calibration) = (raw.camera, raw.scale, raw.surface, raw.calibration);
        let (correlation, rotation, velocity) = (raw.correlation, raw.rotation, raw.velocity);
        let settings = RawView { camera, scale, surface, calibration, body: raw.body, correlation, rotation, velocity };
        let settings = CameraSettings::new(&file, settings)?;
        let context = trigger::TriggerContext {
            image_px: settings.camera.image_px(),
            bodies: &settings.bodies,
            scale: settings.scale,
            has_edge: settings.surface.edge.is_some(),
            is_pulsed: settings.camera.is_pulsed(),
            rig: &rig.name,
        };
        let mut config = Self {
            trigger: trigger::check_trigger(&Table::new(&file, "trigger"), raw.trigger, &context)?,
            rig,
            scale: settings.scale,
            surface: settings.surface,
            bodies: settings.bodies,
            intervals_frames: settings.intervals_frames,
            correlation: settings.correlation,
            rotation: settings.rotation,
            velocity: settings.velocity,
            workers: capture::check_workers(&Table::new(&file, "workers"), &raw.workers)?,
            serve: serve::check_serve(&Table::new(&file, "serve"), raw.serve)?,
            bridge: bridge::check_bridge(&Table::new(&file, "bridge"), raw.bridge.unwrap_or_default())?,
            camera: settings.camera,
            record,
            calibration: settings.calibration,
            views: Vec::new(),
            text: text.into(),
            origin: origin.into(),
        };
        config.views = view::check_views(&file, raw.view, &config)?;
        config.check_ring_if_known()?;
        Ok(config)
    }
}

/// The settings of one camera and its image, checked.
struct CameraSettings {
    camera: Camera,
    scale: Option<Scale>,
    surface: Surface,
    calibration: Option<Rectifier>,
    bodies: Vec<Body>,
    correlation: CorrelationParams,
    intervals_frames: Vec<u32>,
    rotation: Rotation,
    velocity: Velocity,
}

impl CameraSettings {
    /// Checks the settings of one camera. Those of the bodies' kinds are checked last.
    fn new(file: &Text<'_>, raw: RawView) -> Result<Self, ConfigError> {
        let camera = camera::check_camera(&Table::new(file, "camera"), raw.camera)?;
        let image_px = camera.image_px();
        let corner_px = camera.offset_x_px.zip(camera.offset_y_px).map(<[u32; 2]>::from);
        let calibration = match &raw.calibration {
            None => None,
            Some(raw) => Some(calibration::check_calibration(&Table::new(file, "calibration"), raw, corner_px)?),
        };
        let bodies = body::check_bodies(file, raw.body, image_px)?;
        let surface = geometry::check_surface(&Table::new(file, "surface"), &raw.surface, &bodies)?;
        geometry::check_edge(file, &surface, calibration.as_ref())?;
        let settings = Self {
            scale: geometry::check_scale(&Table::new(file, "scale"), &raw.scale, calibration.as_ref())?,
            surface,
            bodies,
            correlation: correlation::check_correlation(&Table::new(file, "correlation"), &raw.correlation, image_px)?,
            intervals_frames: correlation::check_intervals(&Table::new(file, "correlation"), &raw.correlation)?,
            rotation: geometry::check_rotation(&Table::new(file, "rotation"), &raw.rotation)?,
            velocity: geometry::check_velocity(&Table::new(file, "velocity"), &raw.velocity)?,
            camera,
            calibration,
        };
        settings.check_bodies(file, raw.rotation.method.as_deref())?;
        Ok(settings)
    }

    /// Refuses settings that do not apply to the kinds of the bodies.
    fn check_bodies(&self, file: &Text<'_>, method: Option<&str>) -> Result<(), ConfigError> {
        let has = |kind: BodyKind| self.bodies.iter().any(|body| body.kind == kind);
        if let (true, Some(Scale::BallDiameterMm(_))) = (has(BodyKind::Patch), self.scale) {
            let (chosen, owner) = (BodyKind::Patch.assignment(), BodyKind::Ball.assignment());
            return Err(file.foreign_key_error("scale.ball_diameter_mm", chosen, owner));
        }
        if let (false, Rotation::Ring(_) | Rotation::Center) = (has(BodyKind::Ball), self.rotation) {
            return Err(file.refuse("rotation.method", "\"rigid\" or \"field\", since no body is a ball"));
        }
        let only_rods = !has(BodyKind::Ball) && !has(BodyKind::Patch);
        if only_rods && method.is_some_and(|method| method != "field") {
            return Err(file.foreign_key_error(
                "rotation.method",
                BodyKind::Rod.assignment(),
                BodyKind::Ball.assignment(),
            ));
        }
        Ok(())
    }
}

/// Reads a file of at most [`MAX_FILE_BYTES`], or returns the reason why it cannot.
fn read_limited(path: &Path) -> Result<String, String> {
    let mut text = String::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(MAX_FILE_BYTES + 1).read_to_string(&mut text));
    match read {
        Ok(bytes) if bytes as u64 > MAX_FILE_BYTES => Err(format!("larger than {MAX_FILE_BYTES} bytes")),
        Ok(_) => Ok(text),
        Err(error) if error.kind() == ErrorKind::InvalidData => Err("not a text file".into()),
        Err(error) => Err(error.to_string()),
    }
}

/// Checks the name of the rig.
fn check_rig(table: &Table<'_>, name: Option<String>) -> Result<Rig, ConfigError> {
    Ok(Rig { name: table.name("name", name.unwrap_or_else(|| "rig".into()), MAX_RIG_NAME_CHARACTERS)? })
}
