//! Ricochet films an impact with a high-speed camera and measures it while it
//! happens: where the ball is, how fast it moves and spins, when contact begins
//! and ends, how much speed comes back, with an uncertainty on every sample.
//!
//! ```text
//!  camera ──> acquire ══ frames (shared memory) ══> correlate x N ── field ──> track ── track, velocity, impact
//!                 ║                                                   │
//!                 ╚══════════════════ queue = pre-trigger ring ═══════╪═══════> record ──> shot.mcap
//! ```
//!
//! The rooms below are listed bottom to top; each names only rooms above it in
//! this list. Rooms up to [`measure`] are pure: no clock, no file, no thread.

pub mod failure;

pub mod results;

pub mod image;

pub mod numeric;

pub mod dic;

pub mod ball;

pub mod rod;

pub mod motion;

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

pub mod console;

pub mod command;

pub mod study;

pub mod cli;
