//! The integration tests, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "a test that cannot go on panics, and one that is left out says so"
)]

mod ball;
mod bounce;
mod bus;
mod camera_contract;
mod config;
mod fake_gige;
mod genicam;
mod genicam_rate;
mod genicam_settings;
mod impact;
mod motion;
#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "a test fails by panicking, compares floats to the bit and prints figures"
)]

mod import;
mod recording;
mod simulated_camera;
mod slots;
mod synth;
mod tidy;

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod field;
