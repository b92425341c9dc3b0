//! The integration tests, in one binary.
mod simulated_camera;
mod synth;
