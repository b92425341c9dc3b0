//! The main loops, one file for each role.
//!
//! Each `run` knows nothing of command lines, signals or exit codes: it gets a checked configuration and a [`Stop`],
//! works until its stream ends or it is asked to stop, and returns a [`Summary`] of what it took, gave and lost.

mod acquire;
mod action;
mod analysis;
mod clock;
mod correlate;
mod frame_stamp;
mod hardware_trigger;
mod latency;
mod launch;
mod live_trigger;
mod readers;
mod record;
pub mod reference_picture;
mod resume;
mod rig_losses;
mod setup;
mod shot;
mod status_reporter;
mod stepping;
mod stop;
mod storage;
mod stream_state;
mod summary;
mod supervise;
mod supervisor_pipe;
mod track;
mod waiting;

pub use acquire::run as acquire;
pub use analysis::{EmptyFilm, FilmToMeasure, MeasuredFilm, measure_film, results_record};
pub use clock::host_ns;
pub use correlate::run as correlate;
pub use launch::Launch;
pub use record::{Matcher, Matching, run as record};
pub use rig_losses::RigLosses;
pub use setup::{Source, analysis_params, open_camera, truth_world};
pub use shot::{FrameRange, Shot, recording_info};
pub use stepping::StepControl;
pub use stop::Stop;
pub use summary::Summary;
pub use supervise::{Child, Extras, Page, run as supervise};
pub use supervisor_pipe::{follow_supervisor, read_config};
pub use track::run as track;
