//! The rig file: TOML in, checked settings out.
//!
//! Two stages. The first reads names and types and nothing else (`raw`); the
//! second checks every number and word and how they go together, so that nothing
//! downstream checks again. What the file format knows but this version cannot
//! do is refused by name; nothing is accepted and then ignored.
//!
//! Every error is one line with the file, the line, the key, the value and what
//! is allowed. Relative paths in the file (`camera.id` of a recording,
//! `camera.scenario`, `record.directory`) start at the working directory, so that
//! a file may be kept anywhere and its text means the same inside a recording.
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
mod calibration;
mod camera;
mod capture;
mod check;
mod correlation;
mod edit;
mod error;
mod geometry;
mod plan;
mod raw;
mod text;
mod trigger;
mod view;

pub use crate::dic::CorrelationParams;
pub use crate::motion::{Rectifier, Rotation, Scale};
pub use body::{Body, BodyKind};
pub use camera::{Camera, FeatureValue, Pulse, Source};
pub use capture::{Compression, Record, Workers};
pub use error::ConfigError;
pub use geometry::{Surface, Velocity};
pub use trigger::{Trigger, TriggerMode};
pub use view::View;

use check::Table;
use raw::RawView;
use std::io::Read;
use std::path::Path;
use text::Text;

/// A rig file is a page or two; whatever is larger than this is something else, bytes.
const FILE_BYTES_MAX: u64 = 1 << 20;

/// `[rig]`: the rig as a whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rig {
    /// Its name in shared memory, 1 to 32 of `a-z 0-9 _ -`, default `rig`. Two rigs on one machine need two names.
    pub name: String,
}

/// A whole rig, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// `[rig]`: the rig as a whole.
    pub rig: Rig,
    /// `[camera]`: where the frames come from.
    pub camera: Camera,
    /// `[scale]`: either `mm_per_px` (0.000001 to 1000 mm/px) or `ball_diameter_mm` (above 0, at most 10000 mm;
    /// then the scale follows from the measured radius), or that of the calibrated plane. `None` without: pixels only.
    pub scale: Option<Scale>,
    /// `[calibration]`: the camera's lens (`camera_matrix`, `distortion_model`, `distortion`), the plane that bodies move
    /// in (`homography_mm`, from undistorted pixels), or both, of a picture of `image_px` in which the recorded one
    /// begins at `offset_px`; or the `file` that holds them, whose numbers take its place in `text`. `None` when the file
    /// has no such table: then a pixel is equally large everywhere.
    pub calibration: Option<Rectifier>,
    /// `[surface]`: what the bodies strike.
    pub surface: Surface,
    /// `[[body]]`: what is followed, 1 to 16; a ball named `ball` when the file has none.
    pub bodies: Vec<Body>,
    /// `[correlation]`: how displacements are found. Ranges: `subset_size_px` odd, 9 to 255; `step_px` 1 to 255;
    /// `spline_points` 0 to 20; `search_px` 1 to 1024; `min_zncc` 0 to 1. Which methods,
    /// shapes and windows can be used is decided where the correlator is planned.
    pub correlation: CorrelationParams,
    /// `[correlation] interval_frames`: from reference to target, rising, each 1 to 255 frames, default `[1]`. The
    /// first leads from frame to frame, longer ones keep the sum of its steps from drifting.
    pub intervals_frames: Vec<u32>,
    /// `[rotation]`: what motion and spin of balls are taken from, `method` default `rigid`. A `ring` lies between
    /// `ring_inner_px` and `ring_outer_px`, each 1 to 32768 px and at least 4 px apart; left out, 0.35 and 0.96 of the
    /// ball's radius. A rod's motion always comes from its subsets: where all bodies are rods, only `field` is taken.
    pub rotation: Rotation,
    /// `[velocity]`: how positions become velocities.
    pub velocity: Velocity,
    /// `[trigger]`: what starts a shot.
    pub trigger: Trigger,
    /// `[record]`: where recordings go; `None` when the file has no such table, then nothing is kept.
    pub record: Option<Record>,
    /// `[workers]`: how the measuring is shared out.
    pub workers: Workers,
    /// `[view.NAME]`: further cameras, at most 8, in the order of their names.
    pub views: Vec<View>,
    /// The file, letter by letter, but for the numbers of a calibration file; attached to every recording.
    pub text: String,
    /// What errors call the file.
    pub origin: String,
}

impl Config {
    /// Reads and checks a rig file.
    ///
    /// # Errors
    ///
    /// When the file cannot be read, is larger than 1 MiB, is not UTF-8, or [`parse`](Self::parse) refuses it.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        let origin = path.as_ref().display().to_string();
        match read_small(path.as_ref()) {
            Ok(text) => Self::parse_with_files(&text, &origin),
            Err(reason) => Err(ConfigError::Unreadable { origin, reason }),
        }
    }

    /// As [`parse`](Self::parse), after the numbers of the calibration file were put in the place of its name.
    fn parse_with_files(text: &str, origin: &str) -> Result<Self, ConfigError> {
        match calibration::embedded(text, |name| read_small(Path::new(name))) {
            None => Self::parse(text, origin),
            Some(Ok(text)) => Self::parse(&text, origin),
            Some(Err((key, reason))) => Err(Text::new(text, origin)?.refuse(&key, reason)),
        }
    }

    /// Checks the text of a rig file; `origin` is what errors call it.
    ///
    /// # Errors
    ///
    /// When it is not TOML, has an unknown key, a wrong type, a value out of range, two values at odds, or asks for
    /// what this version does not offer.
    pub fn parse(text: &str, origin: &str) -> Result<Self, ConfigError> {
        let file = Text::new(text, origin)?;
        let raw = file.raw()?;
        for (path, given) in [("serve", raw.serve.is_some()), ("bridge", raw.bridge.is_some())] {
            if given {
                return Err(file.not_offered(path, "leave it out"));
            }
        }
        let record = raw.record.map(|record| capture::record(&Table::new(&file, "record"), record)).transpose()?;
        let rig = rig(&Table::new(&file, "rig"), raw.rig.name)?;
        let (camera, scale, surface, calibration) = (raw.camera, raw.scale, raw.surface, raw.calibration);
        let (correlation, rotation, velocity) = (raw.correlation, raw.rotation, raw.velocity);
        let picture = RawView { camera, scale, surface, calibration, body: raw.body, correlation, rotation, velocity };
        let picture = Picture::new(&file, picture)?;
        let around = trigger::Surroundings {
            image_px: picture.camera.image_px(),
            bodies: &picture.bodies,
            scale: picture.scale,
            has_edge: picture.surface.edge.is_some(),
            is_pulsed: picture.camera.is_pulsed(),
            rig: &rig.name,
        };
        let mut config = Self {
            trigger: trigger::trigger(&Table::new(&file, "trigger"), raw.trigger, &around)?,
            rig,
            scale: picture.scale,
            surface: picture.surface,
            bodies: picture.bodies,
            intervals_frames: picture.intervals_frames,
            correlation: picture.correlation,
            rotation: picture.rotation,
            velocity: picture.velocity,
            workers: capture::workers(&Table::new(&file, "workers"), &raw.workers)?,
            camera: picture.camera,
            record,
            calibration: picture.calibration,
            views: Vec::new(),
            text: text.into(),
            origin: origin.into(),
        };
        config.views = view::views(&file, raw.view, &config)?;
        config.check_ring_if_known()?;
        Ok(config)
    }
}

/// What belongs to one camera and its picture, checked.
struct Picture {
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

impl Picture {
    fn new(file: &Text<'_>, raw: RawView) -> Result<Self, ConfigError> {
        let camera = camera::camera(&Table::new(file, "camera"), raw.camera)?;
        let image_px = camera.image_px();
        let corner_px = camera.offset_x_px.zip(camera.offset_y_px).map(<[u32; 2]>::from);
        let calibration = match &raw.calibration {
            None => None,
            Some(raw) => Some(calibration::calibration(&Table::new(file, "calibration"), raw, corner_px)?),
        };
        let surface = geometry::surface(&Table::new(file, "surface"), &raw.surface)?;
        geometry::check_edge(file, &surface, calibration.as_ref())?;
        let picture = Self {
            scale: geometry::scale(&Table::new(file, "scale"), &raw.scale, calibration.as_ref())?,
            surface,
            bodies: body::bodies(file, raw.body, image_px)?,
            correlation: correlation::correlation(&Table::new(file, "correlation"), &raw.correlation, image_px)?,
            intervals_frames: correlation::intervals(&Table::new(file, "correlation"), &raw.correlation)?,
            rotation: geometry::rotation(&Table::new(file, "rotation"), &raw.rotation)?,
            velocity: geometry::velocity(&Table::new(file, "velocity"), &raw.velocity)?,
            camera,
            calibration,
        };
        picture.check_bodies(file, raw.rotation.method.as_deref())?;
        Ok(picture)
    }

    /// Refuses what goes with none of the bodies.
    fn check_bodies(&self, file: &Text<'_>, method: Option<&str>) -> Result<(), ConfigError> {
        let has = |kind: BodyKind| self.bodies.iter().any(|body| body.kind == kind);
        if let (true, Some(Scale::BallDiameterMm(_))) = (has(BodyKind::Patch), self.scale) {
            return Err(file.out_of_place("scale.ball_diameter_mm", "kind = \"patch\"", "kind = \"ball\""));
        }
        if let (false, Rotation::Ring(_) | Rotation::Center) = (has(BodyKind::Ball), self.rotation) {
            return Err(file.refuse("rotation.method", "\"rigid\" or \"field\", since no body is a ball"));
        }
        let only_rods = !has(BodyKind::Ball) && !has(BodyKind::Patch);
        if only_rods && method.is_some_and(|method| method != "field") {
            return Err(file.out_of_place("rotation.method", "kind = \"rod\"", "kind = \"ball\""));
        }
        Ok(())
    }
}

/// A small file's text; why not, otherwise.
fn read_small(path: &Path) -> Result<String, String> {
    let mut text = String::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(FILE_BYTES_MAX + 1).read_to_string(&mut text));
    match read {
        Ok(bytes) if bytes as u64 > FILE_BYTES_MAX => Err(format!("larger than {FILE_BYTES_MAX} bytes")),
        Ok(_) => Ok(text),
        Err(error) => Err(error.to_string()),
    }
}

fn rig(table: &Table<'_>, name: Option<String>) -> Result<Rig, ConfigError> {
    let letter = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"_-".contains(&byte);
    let name = name.unwrap_or_else(|| "rig".into());
    if (1..=32).contains(&name.len()) && name.bytes().all(letter) {
        return Ok(Rig { name });
    }
    Err(table.refuse("name", "1 to 32 of the characters a-z 0-9 _ -"))
}
