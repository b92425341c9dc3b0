//! The names of files of results.

use std::path::{Path, PathBuf};

/// Returns `shot.results-N.mcap` next to the film `shot.mcap`; `shot.VIEW.results-N.mcap` for a view.
pub fn results_path(film: &Path, view: Option<&str>, number: u32) -> PathBuf {
    let stem = film.file_stem().map_or_else(|| "recording".into(), |stem| stem.to_string_lossy().into_owned());
    let view = view.map_or_else(String::new, |view| format!(".{view}"));
    film.with_file_name(format!("{stem}{view}.results-{number}.mcap"))
}
