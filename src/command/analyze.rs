//! `ricochet analyze`: measures a recording offline.

use super::body_summary::{self, BodySummary, FilmShape};
use super::frame_source::{Film, GIVEN_ORDER, GIVEN_RATE, span};
use super::image_order::ImageOrder;
use super::json_cells;
use super::shard::{SETTINGS, Shard};
use crate::camera::CameraIdentity;
use crate::console::{Outcome, Overwrite, UsageError, print_line, print_note, progress, table};
use crate::failure::Failure;
use crate::process::{FilmToMeasure, MeasuredFilm, measure_film, recording_info, results_record};
use crate::recording::{Recording, RecordingError, results_path};
use crate::report;
use crate::results::{Estimate, Impact};
use std::path::{Path, PathBuf};

/// The options of `ricochet analyze`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct AnalyzeOptions {
    /// A recording, the parts of one stream, footage of another program, or the images of one sequence, their folder or
    /// a pattern such as 'shot/*.png'.
    #[arg(required = true)]
    pub inputs: Vec<PathBuf>,
    /// Camera to measure, by the name of its view [default: the first].
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Rig file [default: the one attached to the recording].
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Frame rate, Hz; replaces the file's own, for files that record none or only a playback rate.
    #[arg(long)]
    pub fps: Option<f64>,
    /// The order of the images of a sequence.
    #[command(flatten)]
    pub order: ImageOrder,
    /// Start at this time after the first frame, s.
    #[arg(long = "from", value_name = "S")]
    pub from_s: Option<f64>,
    /// Stop before this time after the first frame, s.
    #[arg(long = "to", value_name = "S")]
    pub to_s: Option<f64>,
    /// Results file [default: next to the recording]; with --shard the folder of the results.
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Measure each input on its own, and of these only share K of N. A text file (.txt) lists inputs. Films whose results
    /// are complete are skipped.
    #[arg(long, value_name = "K/N", requires = "output")]
    pub shard: Option<Shard>,
    /// Number of workers; the results do not depend on it.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub workers: Option<u32>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Measures a film into a results file and prints its impacts.
///
/// # Errors
///
/// When the film or the rig file cannot be used, or the results cannot be written.
pub fn run(options: &AnalyzeOptions) -> Result<Outcome, Failure> {
    let film = open(options, &options.inputs)?;
    let output =
        options.output.clone().unwrap_or_else(|| free_results_path(&options.inputs, options.camera.as_deref()));
    measure_and_print(film, options, &options.inputs, &output)
}

/// Opens a film with the chosen rig file and number of workers, within the chosen interval. Nothing but the results is
/// recorded.
///
/// # Errors
///
/// When the film or the rig file cannot be used, or there is nothing to measure.
pub(super) fn open(options: &AnalyzeOptions, inputs: &[PathBuf]) -> Result<Film, Failure> {
    let span = span(options.from_s, options.to_s)?;
    let film =
        Film::open(inputs, options.camera.as_deref(), options.config.as_deref(), options.fps, options.order.order())?;
    let mut film = film.within(span);
    if let Some(count) = options.workers {
        film.config.workers.count = count;
    }
    if film.config.workers.count == 0 {
        let (origin, input) = (&film.config.origin, inputs[0].display());
        let reason = "0 workers or no bodies; pass a rig file with --config, or --workers";
        return Err(UsageError(format!("{input}: nothing to measure with {origin}: {reason}")).into());
    }
    film.config.record = Some(results_record());
    Ok(film)
}

/// Measures an opened film into a results file and prints its impacts.
///
/// Missing frames and a truncated film are losses. The outcome is `NothingMeasured` if no body was measured in any
/// frame.
///
/// # Errors
///
/// When the results exist or cannot be written, or the film cannot be read.
pub(super) fn measure_and_print(
    film: Film,
    options: &AnalyzeOptions,
    inputs: &[PathBuf],
    output: &Path,
) -> Result<Outcome, Failure> {
    Overwrite::REFUSED.check(output)?;
    let (truncated, format, config) = (film.truncated.clone(), film.format, film.config.clone());
    let measured = measure(film, output)?;
    let results = Recording::open(&measured.path)?;
    let rows = results.velocities()?.collect::<Result<Vec<_>, _>>()?;
    let rows = rows.iter().filter(|row| measured.runs.contains(row.frame));
    let film = FilmShape { size_px: Some([format.width_px, format.height_px]), first_frame: measured.runs.first() };
    let bodies = body_summary::summarize_rows(rows, &config, &film);
    print_results(&last_revisions(&results)?, &bodies, &results, options);
    let outcome = Outcome::from_file(measured.missing, &inputs[0], truncated.as_deref());
    Ok(if bodies.iter().all(BodySummary::is_empty) { outcome.with_nothing_measured() } else { outcome })
}

/// Returns `shot.results-1.mcap` next to `shot.mcap`, or the next free number; of a view, `shot.VIEW.results-1.mcap`.
fn free_results_path(inputs: &[PathBuf], camera: Option<&str>) -> PathBuf {
    let input = inputs.first().map_or_else(|| Path::new("film"), PathBuf::as_path);
    let stem = input.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    // A pattern such as `shot/*.png` is no name of a file.
    let stem = stem.replace(['*', '?', '[', ']'], "");
    let film = input.with_file_name(format!("{}.mcap", if stem.is_empty() { "images" } else { &stem }));
    let numbered = |number: u32| results_path(&film, camera, number);
    (1..u32::MAX).map(numbered).find(|path| !path.exists()).unwrap_or_else(|| numbered(u32::MAX))
}

/// Measures every frame of a film into a results file, with a progress bar.
///
/// # Errors
///
/// When the film cannot be read or the results cannot be written. No partial results file remains.
pub(super) fn measure(film: Film, output: &Path) -> Result<MeasuredFilm, Failure> {
    let Film { format, config, metadata, count, frames, reference, .. } = film;
    let mut info = recording_info(&config, &format, &CameraIdentity::default(), "none: analysed offline");
    for key in ["camera", "serial", "host", "date", "trigger", GIVEN_RATE, GIVEN_ORDER, SETTINGS] {
        if let Some(value) = metadata.get(key) {
            info.metadata.insert(key.to_owned(), value.clone());
        }
    }
    let bar = progress::bar(count, "analyze");
    let counted = frames.inspect(|_| bar.inc(1));
    let measured = measure_film(FilmToMeasure { config: &config, format, reference }, counted, info, output);
    bar.finish_and_clear();
    measured
}

/// Reads the impacts of a recording and returns the last revision of each.
pub(super) fn last_revisions(recording: &Recording) -> Result<Vec<Impact>, RecordingError> {
    Ok(report::last_revisions(recording.impacts()?.collect::<Result<_, _>>()?))
}

/// Prints the impacts with their uncertainties, and the measured frames of each body, as text or JSON.
fn print_results(impacts: &[Impact], bodies: &[BodySummary], results: &Recording, options: &AnalyzeOptions) {
    let path = results.path();
    if options.json {
        let rows: Vec<_> = impacts.iter().map(|impact| impact_as_json(impact, results)).collect();
        let bodies: Vec<_> = bodies.iter().map(BodySummary::json).collect();
        print_line(&serde_json::json!({ "results": path, "impacts": rows, "bodies": bodies }).to_string());
        return;
    }
    print_line(&path.display().to_string());
    for impact in impacts {
        let cell = |estimate: Estimate| vec![format!("{:.6}", estimate.value), format!("{:.2e}", estimate.sigma)];
        let line = |(name, estimate): (&str, Option<Estimate>)| {
            let mut row = vec![name.to_owned()];
            row.extend(estimate.map_or_else(|| vec!["-".into(), String::new()], cell));
            row
        };
        let title = format!("{}, impact {}", results.body_name(impact.body), impact.number + 1);
        let mut rows = vec![vec![title, "value".into(), "sigma".into()]];
        rows.extend(impact.numbers().into_iter().map(line));
        print_line(&table(&rows));
    }
    bodies.iter().for_each(|body| print_note(&body.describe()));
}

/// Returns an impact as a JSON object: the body, then each number with its uncertainty.
fn impact_as_json(impact: &Impact, results: &Recording) -> serde_json::Value {
    let mut row = serde_json::Map::new();
    row.insert("body".into(), results.body_name(impact.body).into());
    row.extend(json_cells(impact, &Impact::json_columns()).map(|(name, value)| (name.to_owned(), value)));
    serde_json::Value::Object(row)
}
