//! The speckle studies.
//!
//! `ricochet study translation`, `translation2`, `rotation`, `general` and `peak` repeat the paper's studies (Figs. 3
//! to 7) at its speeds and at others off every grid of spline points. `noise`, `blur` and `rate` vary one setting of
//! the camera.

mod bar_figure;
mod film;
mod films_plan;
mod method_style;
mod methods;
mod output;
mod peak_figure;
mod plain_correlation;
mod resume_table;
mod row;
mod spline_surface;
mod summary;
mod sweep_figure;
mod workers;

use crate::failure::Failure;
use crate::interrupt;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use serde_json::{Value, json};

use self::film::Filming;
use self::films_plan::{Film, Speeds};
use self::methods::{Evaluator, Method, Windows};
use self::resume_table::{Contents, ResumeTable};
use self::row::Row;
use self::workers::Job;
use crate::console::{Outcome, UsageError, progress};

pub use self::films_plan::SpeckleStudy;

/// Default noise of the films, grey levels of 255.
const NOISE_DN: f64 = 2.0;

/// Standard deviation of the lens blur, px.
const BLUR_PX: f64 = 0.7;

/// Measures films of the paper's speckle patterns.
///
/// Films are rendered at the paper's speeds and at others that lie on no spline grid, and are measured by several
/// methods. With --output, repeating the command resumes a study that was stopped.
#[derive(Debug, Clone, clap::Args)]
pub struct SpeckleOptions {
    /// Patterns, a-I to f-II [default: all 16; e-II where the study is not about patterns].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub patterns: Vec<String>,
    /// Methods: paper, paper-fit, peak-plain, peak-spline, ic-gn, ring, rigid [default: those of the study].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// Sets of speeds: paper, off-grid [default: both].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub speeds: Vec<String>,
    /// Frames per film, 2 to 12.
    #[arg(long, value_name = "COUNT", default_value_t = 3)]
    pub frames: u64,
    /// Subset size, odd, px.
    #[arg(long = "subset", value_name = "PX", default_value_t = 25)]
    pub subset_size_px: u32,
    /// Grid step between subsets, px.
    #[arg(long = "step", value_name = "PX", default_value_t = 12)]
    pub step_px: u32,
    /// Standard deviation of the noise, grey levels of 255 [default: 2].
    #[arg(long, value_name = "DN")]
    pub noise_dn: Option<f64>,
    /// Seed of the speckles and the noise.
    #[arg(long, value_name = "NUMBER", default_value_t = 1)]
    pub seed: u64,
    /// Number of threads [default: all cores]; the results do not depend on it.
    #[arg(long, value_name = "COUNT")]
    pub threads: Option<NonZeroUsize>,
    /// Directory for the tables and the figure; created if missing.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// A completed study.
struct Finished<'a> {
    options: &'a SpeckleOptions,
    job: &'a Job,
    rows: &'a [Row],
}

/// Runs or resumes a study.
///
/// # Errors
///
/// When an option is invalid, or a file belongs to another study or cannot be written.
pub fn run(study: SpeckleStudy, options: &SpeckleOptions) -> Result<Outcome, Failure> {
    let job = resolve_job(study, options)?;
    // Settings without room for a subset are reported before anything is created.
    let evaluator = Evaluator::new(&job.methods, job.windows, film::SIDE_PX)?;
    evaluator.check_room(film::DIAMETERS_PX[0])?;
    let contents = Contents { films: &job.films, methods: &job.methods, frames: job.filming.frames };
    let opened = options
        .output
        .as_ref()
        .map(|directory| ResumeTable::open(directory, study.as_str(), &settings(&job), &contents));
    let (mut table, mut rows) = opened.transpose()?.map_or((None, Vec::new()), |(table, rows)| (Some(table), rows));
    let done = rows.len() / contents.rows();
    if let (Some(table), Some(last)) = (&table, done.checked_sub(1).filter(|_| done < job.films.len())) {
        // A program that measures differently must not resume the study.
        let kept = &rows[last * contents.rows()..];
        if *kept != job.measure_single(last)?[..] {
            return Err(table.film_mismatch_error(last).into());
        }
    }
    if table.is_some() {
        interrupt::set_advice("repeat the command to resume");
    }
    let bar = progress::bar(job.films.len() as u64, "study");
    bar.set_position(done as u64);
    let threads = options.threads.or_else(|| std::thread::available_parallelism().ok()).map_or(1, NonZeroUsize::get);
    let measured = job.run(done, threads, |film| {
        if let Some(table) = &mut table {
            table.append(&film)?;
        }
        rows.extend(film);
        bar.inc(1);
        Ok(())
    });
    bar.finish_and_clear();
    measured?;
    Finished { options, job: &job, rows: &rows }.publish()?;
    Ok(Outcome::Clean)
}

/// Resolves the films, methods and settings of the options.
///
/// # Errors
///
/// [`UsageError`] when an option is invalid.
fn resolve_job(study: SpeckleStudy, options: &SpeckleOptions) -> Result<Job, UsageError> {
    let single = study == SpeckleStudy::Peak || !study.levels().is_empty();
    let or_default = |given: &[String], otherwise: &[&str]| -> Vec<String> {
        if given.is_empty() { otherwise.iter().map(|word| (*word).to_owned()).collect() } else { given.to_vec() }
    };
    let names = films_plan::patterns();
    let all: Vec<&str> = names.iter().map(|(name, _)| *name).collect();
    let patterns = or_default(&options.patterns, if single { &["e-II"] } else { &all });
    let methods: &[&str] = if study == SpeckleStudy::Peak {
        &["paper", "peak-plain", "peak-spline", "paper-fit", "ic-gn"]
    } else {
        &["paper", "paper-fit", "ic-gn", "rigid"]
    };
    let methods = or_default(&options.methods, methods);
    if !study.levels().is_empty() && !options.speeds.is_empty() {
        return Err(UsageError(format!("--speeds: not allowed, study {} has its own speeds", study.as_str())));
    }
    let sets: &[&str] = if study.levels().is_empty() { &Speeds::ALL.map(Speeds::as_str) } else { &["off-grid"] };
    let speeds = or_default(&options.speeds, sets);
    let speeds = films_plan::resolve_words("--speeds", &speeds, &Speeds::ALL.map(|speeds| (speeds.as_str(), speeds)))?;
    let patterns = films_plan::resolve_words("--patterns", &patterns, &names)?;
    if !(2..=12).contains(&options.frames) {
        return Err(UsageError(format!("--frames {}: must be 2 to 12", options.frames)));
    }
    if let (SpeckleStudy::Noise, Some(noise_dn)) = (study, options.noise_dn) {
        return Err(UsageError(format!("--noise-dn {noise_dn}: not allowed, study noise has its own levels")));
    }
    let noise_dn = options.noise_dn.unwrap_or(NOISE_DN);
    if !(0.0..=64.0).contains(&noise_dn) {
        return Err(UsageError(format!("--noise-dn {noise_dn}: must be 0 to 64")));
    }
    Ok(Job {
        study,
        films: study.plan(&patterns, &speeds),
        methods: films_plan::resolve_words("--methods", &methods, &Method::WORDS)?,
        windows: Windows { subset_size_px: options.subset_size_px, step_px: options.step_px },
        filming: Filming { frames: options.frames, noise_dn, blur_px: BLUR_PX, seed: options.seed },
    })
}

/// Returns the settings that the rows depend on, and the version; a table made with others is not resumed.
fn settings(job: &Job) -> Value {
    let mut patterns: Vec<&str> = Vec::new();
    let mut speeds: Vec<&str> = Vec::new();
    for Film { pattern, speeds: set, .. } in &job.films {
        let name = crate::synth::PatternSetup::PAPER[*pattern];
        if !patterns.contains(&name) {
            patterns.push(name);
        }
        if !speeds.contains(&set.as_str()) {
            speeds.push(set.as_str());
        }
    }
    json!({
        "study": job.study.as_str(),
        "version": env!("CARGO_PKG_VERSION"),
        "patterns": patterns,
        "speeds": speeds,
        "methods": job.methods.iter().map(|method| method.as_str()).collect::<Vec<_>>(),
        "frames": job.filming.frames,
        "subset_size_px": job.windows.subset_size_px,
        "step_px": job.windows.step_px,
        "noise_dn": (job.study != SpeckleStudy::Noise).then_some(job.filming.noise_dn),
        "seed": job.filming.seed,
        "films": job.films.len(),
    })
}
