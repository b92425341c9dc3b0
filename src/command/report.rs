//! `ricochet report`: recordings as one page.

use super::{Outcome, UsageError, say};
use crate::recording::Recording;
use crate::report::{self, Shot};
use anyhow::Context;
use std::path::{Path, PathBuf};

/// What to report on, and where to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportOptions {
    /// The recordings.
    pub files: Vec<PathBuf>,
    /// Which of several cameras, by its name; the first when absent.
    pub camera: Option<String>,
    /// Where the frames are, when the one recording holds results alone.
    pub film: Option<PathBuf>,
    /// The page; beside the first recording when absent.
    pub output: Option<PathBuf>,
}

/// Writes the page and prints where it is.
///
/// # Errors
///
/// When a recording cannot be read, or the page not be written.
pub fn run(options: &ReportOptions) -> anyhow::Result<Outcome> {
    let Some(first) = options.files.first() else {
        return Err(UsageError("give at least one recording".into()).into());
    };
    let output = options.output.clone().unwrap_or_else(|| beside(first, options.files.len()));
    let same = |file: &PathBuf| file.canonicalize().ok().zip(output.canonicalize().ok()).is_some_and(|(a, b)| a == b);
    if options.files.iter().any(same) {
        return Err(UsageError(format!("{}: the page would take the place of a recording", output.display())).into());
    }
    if options.film.is_some() && options.files.len() > 1 {
        return Err(UsageError("--film: give one recording of results with it".into()).into());
    }
    let mut shots = Vec::with_capacity(options.files.len());
    for file in &options.files {
        let open = |path| Recording::open(path)?.of_camera(options.camera.as_deref());
        let recording = open(file)?;
        shots.push(match &options.film {
            Some(film) => Shot::read_with(&recording, &open(film)?)?,
            None => Shot::read(&recording)?,
        });
    }
    std::fs::write(&output, report::page(&shots)).with_context(|| format!("write {}", output.display()))?;
    say(&output.display().to_string());
    Ok(Outcome::Clean)
}

/// `shot.html` beside `shot.mcap`; of several, `repeatability.html` beside the first.
fn beside(first: &Path, count: usize) -> PathBuf {
    if count == 1 { first.with_extension("html") } else { first.with_file_name("repeatability.html") }
}
