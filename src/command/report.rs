//! `ricochet report`: a report page of one or several recordings.

use super::{body_summary, frame_source, result_film};
use crate::console::{Outcome, Overwrite, UsageError, check_no_input, print_line, write_file};
use crate::failure::Failure;
use crate::recording::Recording;
use crate::report::{self, Shot};
use std::path::{Path, PathBuf};

/// The options of `ricochet report`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct ReportOptions {
    /// One recording, or several of the same experiment.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Camera to report on, by the name of its view [default: the first].
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Film that the results were measured in; the page shows its frames. Several files are one sequence.
    #[arg(long, num_args = 1..)]
    pub film: Vec<PathBuf>,
    /// HTML page to write [default: next to the first recording].
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
}

/// Writes the page and prints its path.
///
/// # Errors
///
/// When a recording cannot be read or the page cannot be written.
pub fn run(options: &ReportOptions) -> Result<Outcome, Failure> {
    let Some(first) = options.files.first() else {
        return Err(UsageError("give at least one recording".into()).into());
    };
    let output = options.output.clone().unwrap_or_else(|| default_path(first, options.files.len()));
    check_no_input(&output, options.files.iter().chain(&options.film))?;
    options.overwrite.check(&output)?;
    if !options.film.is_empty() && options.files.len() > 1 {
        return Err(UsageError("--film: only allowed with a single recording of results".into()).into());
    }
    let mut shots = Vec::with_capacity(options.files.len());
    for file in &options.files {
        let camera = options.camera.as_deref();
        let recording = Recording::open(file)?.select_view(camera)?;
        let mut shot = match options.film.first() {
            None => Shot::read(&recording)?,
            Some(path) => Shot::read_with(
                &recording,
                path,
                result_film::open_frames(&recording, &options.film, camera, "report")?,
            )?,
        };
        if let Ok(config) = frame_source::rig_config(&recording, camera, None) {
            shot.set_measured(body_summary::summarize_shot(&shot, &config));
        }
        shots.push(shot);
    }
    write_file(&output, report::page(&shots), options.overwrite)?;
    print_line(&output.display().to_string());
    Ok(Outcome::Clean)
}

/// Returns `shot.html` next to `shot.mcap`, or `repeatability.html` next to the first of several.
fn default_path(first: &Path, count: usize) -> PathBuf {
    if count == 1 { first.with_extension("html") } else { first.with_file_name("repeatability.html") }
}
