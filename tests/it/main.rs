//! The integration tests, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "a test fails by panicking, compares floats to the bit, says what it measured or left out, and waits by the clock"
)]

mod accuracy;
mod allocation;
mod ball;
mod blow;
mod bounce;
mod browser;
mod bus;
mod calibration;
mod camera_contract;
mod check;
mod cli;
mod clock;
mod config;
mod decisions;
mod defective;
mod design;
mod equal;
mod examples;
mod fake_gige;
mod faults;
mod field;
mod figures;
mod film;
mod genicam;
mod genicam_rate;
mod genicam_settings;
mod gige;
mod gige_faults;
mod gige_line;
mod gige_pair;
mod golden;
mod hidden;
mod honest;
mod impact;
mod import;
mod light;
mod line;
mod lined;
mod motion;
mod nearer;
mod parts;
mod patch;
mod pipeline;
mod polar;
mod pretrigger;
mod prompt;
mod pulses;
mod python;
mod recording;
mod recordings;
mod replay;
mod report;
mod rigid;
mod rod;
mod rolling;
mod scenes;
mod series;
mod several;
mod simulated_camera;
mod slots;
mod speckle;
mod storage;
mod study;
mod support;
mod synth;
mod tidy;
mod tone;
mod triggers;
mod tumbling;
mod turned;
mod v4l2;
