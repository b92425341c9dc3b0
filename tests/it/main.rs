//! The integration tests, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "a test fails by panicking, compares floats to the bit, and says what it measured or left out"
)]

mod ball;
mod bounce;
mod bus;
mod camera_contract;
mod config;
mod fake_gige;
mod field;
mod genicam;
mod genicam_rate;
mod genicam_settings;
mod impact;
mod import;
mod motion;
mod recording;
mod simulated_camera;
mod slots;
mod synth;
mod tidy;
