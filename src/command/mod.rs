//! The commands of the program, one file per command.

pub mod analyze;
pub mod batch;
pub mod bench;
pub mod bindings;
mod body_summary;
#[cfg(feature = "zenoh")]
pub mod bridge;
pub mod cameras;
pub mod check;
pub mod config;
pub mod control;
pub mod demo;
pub mod diagnose;
pub mod doctor;
pub mod export;
pub mod field;
mod film_survey;
mod frame_source;
pub mod image_order;
pub mod import;
pub mod info;
pub mod init;
pub mod listen;
pub mod merge;
pub mod recover;
pub mod replay;
pub mod report;
mod result_film;
pub mod rig;
mod rod;
pub mod serve;
pub mod setup;
mod shard;
pub mod shell;
pub mod simulate;
pub mod status;
#[cfg(feature = "zenoh")]
pub mod via;

use crate::config::Config;
use crate::console::UsageError;
use crate::serve::json_cells;

/// Selects the configuration of one camera by name, or that of the first camera.
///
/// # Errors
///
/// [`UsageError`] when there is no such camera.
pub(crate) fn view_config(config: Config, camera: Option<&str>) -> Result<Config, UsageError> {
    let Some(name) = camera else { return Ok(config) };
    let views: Vec<&str> = config.views.iter().map(|view| view.name.as_str()).collect();
    let known = if views.is_empty() { "it has one camera".into() } else { format!("it has {views:?}") };
    let refusal = UsageError(format!("--camera {name}: {} has no such [view], {known}", config.origin));
    config.views.into_iter().find(|view| view.name == name).map(|view| view.config).ok_or(refusal)
}
