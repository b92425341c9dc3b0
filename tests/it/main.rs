//! The integration tests, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "a test that cannot go on panics, and one that is left out says so"
)]

mod ball;
mod bus;
mod config;
mod fake_gige;
mod genicam;
mod recording;
mod camera_contract;
mod fake_gige;
mod genicam;
mod genicam_rate;
mod genicam_settings;
mod slots;
mod simulated_camera;
mod synth;
mod tidy;

mod bounce;
mod impact;
mod motion;
