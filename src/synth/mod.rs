//! Ground truth: simulated impacts, drawn without any interpolation of pictures.
//!
//! A [`Scenario`] says what is filmed and with which camera; a [`World`] made
//! from it draws any frame, in any order, and tells the truth behind it. Both
//! are pure functions of the scenario: no clock, no file, no hidden state.

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
