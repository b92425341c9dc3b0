//! What can be wrong with a scenario.

use crate::synth::physics::PhysicsError;

/// Why a scenario cannot be filmed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScenarioError {
    /// Not TOML, or not the keys of a scenario.
    #[error("read scenario: {0}")]
    Syntax(String),
    /// Neither a built-in scenario nor a file that can be read.
    #[error("scenario {name:?} is not built in ({known}) and no file that can be read: {reason}")]
    Unreadable {
        /// What was asked for.
        name: String,
        /// The built-in ones.
        known: String,
        /// The system's answer.
        reason: String,
    },
    /// A number is out of range.
    #[error("{key} = {value} is out of range: allowed is {range}")]
    OutOfRange {
        /// Name of the key, with its tables.
        key: &'static str,
        /// What was given.
        value: String,
        /// What is allowed.
        range: String,
    },
    /// The ball does not fit.
    #[error(
        "body.diameter_mm = {diameter_mm} is a ball of {diameter_px:.1} px at scale.mm_per_px = {mm_per_px}: \
         larger than the picture of {width_px} x {height_px} px"
    )]
    BallTooLarge {
        /// The key's value.
        diameter_mm: f64,
        /// The scale.
        mm_per_px: f64,
        /// In the picture.
        diameter_px: f64,
        /// The picture.
        width_px: u32,
        /// The picture.
        height_px: u32,
    },
    /// Speckles of these sizes cannot be packed so densely.
    #[error("body.pattern.coverage = {wanted} cannot be reached with speckles that do not overlap: {reached:.3} was")]
    TooDense {
        /// The key's value.
        wanted: f64,
        /// Where packing stopped.
        reached: f64,
    },
    /// So many lines cannot keep clear of each other.
    #[error("body.pattern.lines = {wanted} do not fit on the ball without crossing: {reached} did")]
    TooManyLines {
        /// The key's value.
        wanted: u32,
        /// How many found a place.
        reached: usize,
    },
    /// The ball would come back before the film ends.
    #[error(
        "camera.frames = {frames} lasts {film_s:.4} s, but the ball touches again at {again_s:.4} s: one collision a film"
    )]
    TouchesAgain {
        /// The key's value.
        frames: u64,
        /// Length of the film.
        film_s: f64,
        /// Second touch.
        again_s: f64,
    },
    /// A rod that does something only a ball can do.
    #[error("body.rod stands upright and does not turn: {0}")]
    RodOnly(&'static str),
    /// Straight lines on a sphere.
    #[error(
        "body.pattern.lines = {0} is out of range: allowed is 0 with body.shape = \"sphere\", on which nothing is straight"
    )]
    LinesOnSphere(u32),
    /// What does not go with the rest of the scenario.
    #[error("{key} is out of place: {why}")]
    Misplaced {
        /// Name of the key, with its tables.
        key: &'static str,
        /// What stands against it.
        why: &'static str,
    },
    /// Something is wrong with the second ball.
    #[error("other: {0}")]
    Other(Box<ScenarioError>),
    /// An edge that nothing places.
    #[error("occluder.point_px is missing: only motion.kind = \"impact\" has a point of first touch to take its place")]
    OccluderPlace,
    /// No bounce.
    #[error("motion: {0}")]
    Physics(#[from] PhysicsError),
}
