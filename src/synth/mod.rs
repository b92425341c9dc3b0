//! Ground truth: simulated impacts, rendered without any interpolation of images.
//!
//! A [`Scenario`] describes the filmed objects and the camera. A [`World`] made from it renders any frame in any order
//! and returns its ground truth. Both are pure functions of the scenario: no clock, no file, no hidden state.

mod attitude;
mod blur;
mod built_in;
mod cap;
mod cover;
mod draw;
mod motion;
mod mover;
pub mod physics;
mod rod;
mod scenario;
mod scene;
mod sensor;
mod speckle;
mod sphere;
mod texture;
mod truth;
mod world;

#[cfg(test)]
mod twin;

pub use mover::PictureMover;
pub use scenario::{
    BodySetup, CameraSetup, ImpactSetup, LightSetup, MotionSetup, OccluderSetup, OtherSetup, PartSetup, PatternSetup,
    RingingSetup, RodSetup, ScaleSetup, Scenario, ScenarioError, ShadeSetup, Shape, SurfaceSetup,
};
pub use world::World;
