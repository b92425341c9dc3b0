//! The integration tests, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::disallowed_methods,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "a test fails by panicking, compares floats to the bit, prints what it measured or left out, and waits by the clock"
)]

mod accuracy;
mod allocation;
mod ball;
mod bench_live;
#[cfg(feature = "zenoh")]
mod bridge;
mod browser;
mod bus;
mod calibration;
mod camera_contract;
mod check;
mod cli;
mod clock;
mod config;
mod cut_off_contact;
mod defective_pixels;
mod diagnose;
mod doctor;
mod equal;
mod examples;
mod failure_honesty;
mod fake_gige;
mod faults;
mod field;
mod field_reports;
mod field_series;
mod figures;
mod film_apart;
mod fuzz_corpus;
mod genicam;
mod genicam_rate;
mod genicam_settings;
mod gige;
mod gige_faults;
mod gige_line;
mod gige_pair;
mod golden;
mod hardware_trigger;
mod honesty;
mod illumination;
mod impact;
mod import;
mod init;
mod interrupted;
mod live_rate;
mod long_contact;
mod manual;
mod measured_world;
mod misleading_marks;
mod motion;
mod moving_surface;
mod multi_file;
mod newcomer;
mod not_measured;
mod occlusion;
mod out_of_plane_rotation;
mod out_of_plane_translation;
mod packaging;
mod patch;
mod patch_footage;
mod phone_film;
mod photo;
mod pipeline;
mod pipeline_faults;
mod plain_ball_film;
mod polar;
mod predicted_rows;
mod pretrigger;
mod python;
mod python_package;
mod recording;
mod recordings;
mod replay;
mod report;
mod result_latency;
mod rigid_match;
mod rim_marks;
mod rod;
mod rod_light;
mod rolling_shutter;
mod rotation_search;
mod rules_of_thumb;
mod scenes;
mod serve;
mod several_cameras;
mod shards;
mod simulated_camera;
mod slots;
mod small_ball;
mod still_ground;
mod storage;
mod study_convergence;
mod study_design;
mod study_speckle;
mod support;
mod survival;
mod synth;
mod synth_physics;
mod tidy;
mod tone_curve;
mod trigger_latency;
mod triggers;
mod unobserved_impact;
mod v4l2;
mod worker_memory;
