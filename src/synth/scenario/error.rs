//! Errors of a scenario.

use crate::failure::{ExitCode, Fatal};
use crate::synth::physics::PhysicsError;

/// The reason why a scenario cannot be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScenarioError {
    /// The text is not TOML, or has other keys than a scenario.
    #[error("cannot read scenario: {0}")]
    Syntax(String),
    /// The name is neither a built-in scenario nor a readable file.
    #[error("scenario {name:?} is not built in ({known}) and not a readable file: {reason}")]
    Unreadable {
        /// The given name.
        name: String,
        /// The built-in scenarios.
        known: String,
        /// The system's error.
        reason: String,
    },
    /// A value is out of range.
    #[error("{key} = {value} is out of range: allowed is {range}")]
    OutOfRange {
        /// The key, with its tables.
        key: &'static str,
        /// The given value.
        value: String,
        /// The allowed range.
        range: String,
    },
    /// The ball does not fit the image.
    #[error(
        "body.diameter_mm = {diameter_mm} is a ball of {diameter_px:.1} px at scale.mm_per_px = {mm_per_px}: \
         larger than the picture of {width_px} x {height_px} px"
    )]
    BallTooLarge {
        /// The value of the key.
        diameter_mm: f64,
        /// The scale.
        mm_per_px: f64,
        /// The diameter in the image.
        diameter_px: f64,
        /// The width of the image.
        width_px: u32,
        /// The height of the image.
        height_px: u32,
    },
    /// Speckles of these sizes cannot be packed so densely.
    #[error(
        "body.pattern.coverage = {wanted} cannot be reached without overlapping speckles: {reached:.3} was reached"
    )]
    TooDense {
        /// The value of the key.
        wanted: f64,
        /// The coverage that was reached.
        reached: f64,
    },
    /// There is no room for so many lines.
    #[error("body.pattern.lines = {wanted} do not fit on the ball without crossing: {reached} fit")]
    TooManyLines {
        /// The value of the key.
        wanted: u32,
        /// The number of lines that were placed.
        reached: usize,
    },
    /// The ball would touch the surface again before the film ends.
    #[error(
        "camera.frames = {frames} lasts {film_s:.4} s, but the ball touches again at {again_s:.4} s: one collision per film"
    )]
    TouchesAgain {
        /// The value of the key.
        frames: u64,
        /// The length of the film.
        film_s: f64,
        /// The time of the second contact.
        again_s: f64,
    },
    /// A setting that a rod does not support.
    #[error("body.rod stands upright and does not turn: {0}")]
    RodOnly(&'static str),
    /// A setting that contradicts the rest of the scenario.
    #[error("{key} is out of place: {why}")]
    Misplaced {
        /// The key, with its tables.
        key: &'static str,
        /// The contradiction.
        why: &'static str,
    },
    /// The second ball is invalid.
    #[error("other: {0}")]
    Other(Box<ScenarioError>),
    /// The position of an occluding edge is missing.
    #[error("occluder.point_px is missing: only motion.kind = \"impact\" has a point of first touch to take its place")]
    OccluderPlace,
    /// The ball does not bounce.
    #[error("motion: {0}")]
    Physics(#[from] PhysicsError),
}

impl Fatal for ScenarioError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}
