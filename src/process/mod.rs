//! The main loops, one file a role.
//!
//! Each `run` knows nothing of command lines, signals or exit codes: it gets a checked configuration and a [`Stop`],
//! works until its stream ends or it is asked to stop, and returns a [`Summary`] of what it took, gave and lost.

mod acquire;
mod action;
mod clock;
mod conclude;
mod correlate;
mod line;
mod pace;
mod record;
pub mod reference;
mod reins;
mod report;
mod resume;
mod rig;
mod shot;
mod stop;
mod storage;
mod stream;
mod summary;
mod supervise;
mod track;

pub use acquire::run as acquire;
pub use clock::host_ns;
pub use correlate::run as correlate;
pub use record::{Matcher, Matching, run as record};
pub use reins::{END_OF_CONFIG, StepControl};
pub use resume::Resume;
pub use rig::{Source, analysis_params, open_camera, truth_world};
pub use shot::{FrameRange, Shot, recording_info};
pub use stop::Stop;
pub use summary::Summary;
pub use supervise::{Child, ChildFailure, run as supervise, run_stepped as supervise_stepped};
pub use track::run as track;
