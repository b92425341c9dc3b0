//! `ricochet diagnose`: shows what was searched in a film, what was found, and why it was refused.

mod changes;
mod choice;
mod drawing;
mod evidence;
mod output;

use super::analyze;
use super::body_summary::{self, FilmShape};
use super::film_survey::{self, FilmFiles, Surveyed, Visit};
use super::frame_source::Film;
use super::image_order::ImageOrder;
use crate::config::Config;
use crate::console::{Outcome, Overwrite, UsageError, print_note};
use crate::failure::Failure;
use crate::image::{Frame, Image};
use crate::import;
use crate::interrupt::{self, Unfinished};
use crate::process::results_record;
use crate::recording::Recording;
use crate::report::{BodyDiagnosis, Diagnosis};
use crate::results::{PairField, TrackSample, VelocitySample};
use choice::{Choice, choose_frames};
use evidence::{Evidence, Examiner};
use output::Target;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The options of `ricochet diagnose`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct DiagnoseOptions {
    /// A film, a recording, or the images of one sequence.
    #[arg(required = true, value_name = "FILM")]
    pub film: Vec<PathBuf>,
    /// Rig file [default: the one attached to the recording; without any, only what moves is shown].
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Camera to diagnose, by the name of its view [default: the first].
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Frame rate, Hz; replaces the file's own.
    #[arg(long)]
    pub fps: Option<f64>,
    /// The order of the images of a sequence.
    #[command(flatten)]
    pub order: ImageOrder,
    /// Frame to show, from 0; may be repeated [default: the first, the middle, the last, and the first of each reason].
    #[arg(long, value_name = "N")]
    pub frame: Vec<u64>,
    /// HTML page, or folder for the page and its pictures [default: a folder next to the film].
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// The rows of a measured film, in memory.
struct Measured {
    config: Config,
    first_frame: u64,
    rows: Vec<VelocitySample>,
    tracks: Vec<TrackSample>,
    results: Recording,
}

/// Measures and surveys the film, and writes the page.
///
/// # Errors
///
/// When the film or the rig file cannot be used, or the page cannot be written.
pub fn run(options: &DiagnoseOptions) -> Result<Outcome, Failure> {
    let target = Target::new(options)?;
    let (camera, order) = (options.camera.clone(), options.order.order());
    let film = FilmFiles { inputs: options.film.clone(), camera, fps: options.fps, order };
    let results = Scratch::new(target.scratch());
    let measured = match has_config(options)? {
        true => Some(measure_film(options, &results.path)?),
        false => None,
    };
    let surveyed = film_survey::survey(&film)?;
    let mut diagnosis = Diagnosis {
        film: options.film[0].file_name().unwrap_or_default().to_string_lossy().into_owned(),
        facts: film_facts(&surveyed, measured.as_ref()),
        movers: evidence::mover_lines(&surveyed),
        ..Diagnosis::default()
    };
    if let Some(measured) = &measured {
        diagnosis.bodies = diagnose_bodies(&film, measured, &surveyed, &options.frame)?;
    }
    diagnosis.movement = drawing::draw_movement(&film, &surveyed)?;
    target.write(&diagnosis, options)?;
    if !options.json {
        diagnosis.bodies.iter().for_each(|body| print_note(&body.line));
        diagnosis.movers.iter().filter(|_| measured.is_none()).for_each(|line| print_note(line));
    }
    // The diagnosis itself succeeds, whatever it finds.
    Ok(Outcome::Clean)
}

/// A file that is removed at the end.
struct Scratch {
    path: PathBuf,
    _unfinished: Unfinished,
}

impl Scratch {
    fn new(path: PathBuf) -> Self {
        Self { _unfinished: interrupt::note(&path), path }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Whether there is a rig file: the given one, or an attached one.
///
/// # Errors
///
/// When a recording cannot be opened.
fn has_config(options: &DiagnoseOptions) -> Result<bool, Failure> {
    if options.config.is_some() {
        return Ok(true);
    }
    let first = &options.film[0];
    Ok(!import::is_importable(first) && Recording::open(first)?.config_toml().is_some())
}

/// Measures the film into a file, with one worker at least, and reads its rows, by body and frame.
///
/// # Errors
///
/// When the film or the rig file cannot be used, or the file cannot be written.
fn measure_film(options: &DiagnoseOptions, results: &Path) -> Result<Measured, Failure> {
    let (camera, config) = (options.camera.as_deref(), options.config.as_deref());
    let mut film = Film::open(&options.film, camera, config, options.fps, options.order.order())?;
    film.config.workers.count = film.config.workers.count.max(1);
    film.config.record = Some(results_record());
    let config = film.config.clone();
    let measured = analyze::measure(film, results)?;
    let results = Recording::open(&measured.path)?;
    let mut rows = results.velocities()?.collect::<Result<Vec<_>, _>>()?;
    rows.retain(|row| measured.runs.contains(row.frame));
    rows.sort_by_key(|row| (row.body, row.frame));
    let tracks = results.tracks()?.collect::<Result<Vec<_>, _>>()?;
    Ok(Measured { config, first_frame: measured.runs.first(), rows, tracks, results })
}

/// Describes size, length and rate of the film, and the rig file.
fn film_facts(surveyed: &Surveyed, measured: Option<&Measured>) -> Vec<String> {
    let [width, height] = surveyed.size_px;
    let mut facts = vec![
        format!("{} frames of {width} × {height} px", surveyed.count),
        format!("{} frames/s {}", surveyed.frame_rate_hz, surveyed.rate_source),
    ];
    facts.push(match measured {
        Some(measured) => format!("measured with {}", measured.config.origin),
        None => "no rig file".into(),
    });
    facts
}

/// Diagnoses every body, in the `wanted` frames, counted from 0, or in chosen ones if there are none.
fn diagnose_bodies(
    film: &FilmFiles,
    measured: &Measured,
    surveyed: &Surveyed,
    wanted: &[u64],
) -> Result<Vec<BodyDiagnosis>, Failure> {
    let config = &measured.config;
    let size_px = Some(surveyed.size_px.map(|size| size as u32));
    let shape = FilmShape { size_px, first_frame: measured.first_frame };
    let summaries = body_summary::summarize_rows(measured.rows.iter(), config, &shape);
    let mut found = Vec::new();
    for (index, body) in config.bodies.iter().enumerate() {
        let rows: Vec<VelocitySample> =
            measured.rows.iter().filter(|row| row.body as usize == index).copied().collect();
        let chosen = choose_frames(&rows, measured.first_frame, wanted);
        let evidence = collect_evidence(film, measured, surveyed, index, &chosen)?;
        let summary = &summaries[index];
        found.push(BodyDiagnosis {
            name: body.name.clone(),
            line: summary.describe(),
            is_complete: summary.is_complete(),
            changes: changes::advise_changes(summary, &evidence, config, index, surveyed),
            statuses: rows.iter().map(|row| row.status).collect(),
            frames: evidence
                .iter()
                .map(|evidence| drawing::draw_frame(evidence, config, index, surveyed))
                .collect::<Result<_, Failure>>()?,
        });
    }
    Ok(found)
}

/// Collects the evidence of one body in the chosen frames.
///
/// # Errors
///
/// When no frame was chosen, or the film or its results cannot be read.
fn collect_evidence(
    film: &FilmFiles,
    measured: &Measured,
    surveyed: &Surveyed,
    body: usize,
    chosen: &BTreeMap<u64, Choice>,
) -> Result<Vec<Evidence>, Failure> {
    if chosen.is_empty() {
        return Err(UsageError(format!("--frame: no such frame; the film has {} frames", surveyed.count)).into());
    }
    let mut fields: BTreeMap<u64, PairField> = BTreeMap::new();
    for field in measured.results.fields()? {
        let field = field?;
        if field.body as usize == body && chosen.contains_key(&field.frame) {
            // The first is the one over the shortest interval.
            fields.entry(field.frame).or_insert(field);
        }
    }
    let mut examiner = Examiner::new(&measured.config, body, surveyed)?;
    let (mut evidence, mut image) = (Vec::new(), Image::default());
    let mut first_ns = None;
    film.visit(|index, meta, bytes| {
        let first_ns = *first_ns.get_or_insert(meta.stamp_ns);
        let Some(choice) = chosen.get(&meta.sequence) else { return Ok(Visit::Continue) };
        Frame { meta, bytes }.unpack(&mut image)?;
        let levels = super::export::grey_levels(meta, bytes)?;
        let track = measured.tracks.iter().find(|row| row.body as usize == body && row.frame == meta.sequence);
        evidence.push(Evidence {
            index,
            time_ms: meta.stamp_ns.saturating_sub(first_ns) as f64 * 1e-6,
            choice: *choice,
            levels,
            is_moving: surveyed.movement.as_ref().map(|movement| movement.moving_pixels(image.view())),
            track: track.copied(),
            field: fields.remove(&meta.sequence),
            searched: examiner.search(&mut image, index, meta),
        });
        Ok(Visit::Continue)
    })?;
    Ok(evidence)
}
