//! Ricochet measures impacts live with a high-speed camera.
//!
//! It follows a ball, rod or patch by digital image correlation while the camera runs. It publishes position, velocity and
//! spin for every frame and contact times, restitution and friction for every collision, each with its uncertainty.
//!
//! ```text
//!  camera ─> acquire ══ frames (shared memory) ══> correlate x N ─ field ─> track ─> rows
//!               ║                                                   │
//!               ╚═══════════ queue = pre-trigger ring ══════════════╪═════> record ─> shot.mcap
//! ```
//!
//! # Rooms
//!
//! A room is a top-level module. Each names only rooms below it in this picture, or to the left of it. Those in brackets
//! are documented here:
//!
//! ```text
//!  the program              console  command  study  cli
//!  a running rig            camera  [bus]  process  serve
//!  settings and files       config  [message]  [recording]  plot  report  import
//!  from frames to results   trigger  impact  measure  track  synth
//!                           dic  ball  rod  motion  survey
//!  the ground               failure  interrupt  input  [results]  [image]  numeric
//! ```
//!
//! Rooms from [`results`] to `synth` are pure: they use no clock, file or thread.
//!
//! # For programs
//!
//! A program that listens to a running rig, or reads its recordings, needs five rooms:
//!
//! - [`bus`] joins a rig and receives its topics, and [`message`] has their types;
//! - [`recording`] reads and writes recordings, and [`image`] has their frames;
//! - [`results`] has the rows of both: positions, velocities, collisions and displacement fields.
//!
//! ```
//! use ricochet::recording::Recording;
//!
//! // A simulated shot, so it has the true collision. `impacts` reads the measured ones.
//! let recording = Recording::open("recordings/lacrosse.mcap".as_ref())?;
//! let impact = recording.truth_impacts()?.next().unwrap()?;
//! let restitution = impact.restitution.unwrap();
//! assert_eq!(format!("{:.3}", restitution.value), "0.798");
//! # Ok::<(), ricochet::recording::RecordingError>(())
//! ```
//!
//! A value that could not be measured is `None`, and a status has the reason.
//!
//! # For contributors
//!
//! The other rooms, and some items of these five, are public only for the program and its tests. They are hidden here and
//! may change in any version. `RUSTDOCFLAGS='--cfg internals' cargo doc --no-deps` shows them.

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod failure;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod interrupt;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod input;

pub mod results;

pub mod image;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod numeric;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod dic;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod ball;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod rod;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod motion;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod survey;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod trigger;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod impact;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod measure;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod track;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod synth;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod config;

pub mod message;

pub mod recording;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod plot;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod report;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod import;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod camera;

pub mod bus;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod process;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod serve;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod console;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod command;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod study;

#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub mod cli;
