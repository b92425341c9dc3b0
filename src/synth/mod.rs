//! Ground truth: simulated impacts, rendered without any interpolation of images.
//!
//! A [`Scenario`] describes the filmed objects and the camera. A [`SimulatedFilm`] made from it renders any frame in any order
//! and returns its ground truth. Both are pure functions of the scenario: no clock, no file, no hidden state.

mod background;
mod film;
mod flat;
mod ground_truth;
mod orientation;
pub mod physics;
mod render;
mod scenario;
mod sensor;
#[cfg(test)]
mod tests;
mod trajectory;

pub use film::SimulatedFilm;
pub use scenario::{
    BodySetup, CameraSetup, ImpactSetup, Layout, LightSetup, MotionSetup, OccluderSetup, OtherSetup, PartSetup,
    PatternSetup, RingingSetup, RodSetup, ScaleSetup, Scenario, ScenarioError, ShadeSetup, Shape, SurfaceSetup,
};
