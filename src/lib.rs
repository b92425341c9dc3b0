//! Ricochet measures impacts live with a high-speed camera.
//!
//! It follows a ball, rod or patch by digital image correlation while the camera runs. It publishes position, velocity and
//! spin for every frame and contact times, restitution and friction for every collision, each with its uncertainty.
//!
//! ```text
//!  camera ──> acquire ══ frames (shared memory) ══> correlate x N ── field ──> track ── track, velocity, impact
//!                 ║                                                   │
//!                 ╚══════════════════ queue = pre-trigger ring ═══════╪═══════> record ──> shot.mcap
//! ```
//!
//! The rooms below are listed from bottom to top. Each names only rooms above it in this list. Rooms from [`results`] to
//! [`synth`] are pure: they use no clock, file or thread.

pub mod failure;

pub mod interrupt;

pub mod input;

pub mod results;

pub mod image;

pub mod numeric;

pub mod dic;

pub mod ball;

pub mod rod;

pub mod motion;

pub mod survey;

pub mod trigger;

pub mod impact;

pub mod measure;

pub mod track;

pub mod synth;

pub mod config;

pub mod message;

pub mod recording;

pub mod plot;

pub mod report;

pub mod import;

pub mod camera;

pub mod bus;

pub mod process;

pub mod serve;

pub mod console;

pub mod command;

pub mod study;

pub mod cli;
