//! `ricochet study translation`, `translation2`, `rotation`, `general` and `peak`: the speckle studies of the paper
//! (Figs. 3 to 7), on its speeds and on others that no grid of spline points favours; and `noise`, `blur` and `rate`,
//! which go over one setting of the camera.

mod axis;
mod bars;
mod film;
mod journal;
mod peak;
mod plain;
mod plan;
mod pool;
mod row;
mod summary;
mod sweep;
mod tell;
mod way;

use std::num::NonZeroUsize;
use std::path::PathBuf;

use serde_json::{Value, json};

use self::film::Filming;
use self::journal::{Contents, Journal};
use self::plan::{Film, Speeds};
use self::pool::Job;
use self::row::Row;
use self::way::{Bench, Way, Windows};
use crate::command::{Outcome, UsageError, progress};
use crate::process::Stop;

pub use self::plan::SpeckleStudy;

/// Noise of the films, grey levels of 255, where nothing else is said.
const NOISE_DN: f64 = 2.0;

/// Blur of the lens, standard deviation, px.
const BLUR_PX: f64 = 0.7;

/// What a speckle study was asked to do.
#[derive(Debug, Clone)]
pub struct SpeckleOptions {
    /// Which one.
    pub study: SpeckleStudy,
    /// Patterns of the paper, as `e-I`; all of them when empty (the peak study: e-II).
    pub patterns: Vec<String>,
    /// Methods; the study's own when empty.
    pub methods: Vec<String>,
    /// `paper`, `off-grid` or both; both when empty. A study over a setting has speeds of its own.
    pub speeds: Vec<String>,
    /// Frames a film: 2 to 12, in which the fastest ball stays in the picture.
    pub frames: u64,
    /// Full width of a window, odd, px: 9 to 255.
    pub subset_size_px: u32,
    /// From one window to the next, px: 1 to 255.
    pub step_px: u32,
    /// Standard deviation of the noise, grey levels of 255: 0 to 64; 2 when there is none. The study of noise has its own.
    pub noise_dn: Option<f64>,
    /// Of the speckles and the noise.
    pub seed: u64,
    /// Threads; as many as the machine runs at once when there is none.
    pub threads: Option<NonZeroUsize>,
    /// A directory for the tables and the figure, made when it is not there; what it has of this study is kept.
    pub output: Option<PathBuf>,
    /// Print one JSON object.
    pub json: bool,
}

/// A study whose films are all measured.
struct Finished<'a> {
    options: &'a SpeckleOptions,
    job: &'a Job,
    rows: &'a [Row],
}

/// Runs a study, or goes on with one.
///
/// # Errors
///
/// One line naming the option, or the file that is not that of this study or cannot be written.
pub fn run(options: &SpeckleOptions, stop: &Stop) -> anyhow::Result<Outcome> {
    let job = job(options)?;
    // Settings that leave no room are told before anything is made.
    let bench = Bench::new(&job.ways, job.windows, film::SIDE_PX)?;
    bench.check_room(film::DIAMETERS_PX[0])?;
    let contents = Contents { films: &job.films, ways: &job.ways, frames: job.filming.frames };
    let opened = options
        .output
        .as_ref()
        .map(|directory| Journal::open(directory, options.study.word(), &settings(options, &job), &contents));
    let (mut journal, mut rows) =
        opened.transpose()?.map_or((None, Vec::new()), |(journal, rows)| (Some(journal), rows));
    let done = rows.len() / contents.rows();
    if let (Some(journal), Some(last)) = (&journal, done.checked_sub(1).filter(|_| done < job.films.len())) {
        // A program that measures otherwise must not go on with what another one began.
        let kept = &rows[last * contents.rows()..];
        if *kept != job.only(last)?[..] {
            return Err(journal.measured_otherwise(last).into());
        }
    }
    let bar = progress::parts(job.films.len() as u64, "study");
    bar.set_position(done as u64);
    let threads = options.threads.or_else(|| std::thread::available_parallelism().ok()).map_or(1, NonZeroUsize::get);
    let measured = job.run(done, threads, stop, |film| {
        if let Some(journal) = &mut journal {
            journal.add(&film)?;
        }
        rows.extend(film);
        bar.inc(1);
        Ok(())
    });
    bar.finish_and_clear();
    measured?;
    let missing = job.films.len() - rows.len() / contents.rows();
    if missing > 0 {
        let rest = if journal.is_some() { "; the same command goes on with the rest" } else { "" };
        let cause = format!("films not measured when it was stopped{rest}");
        return Ok(Outcome::Lost { count: missing as u64, cause: Some(cause) });
    }
    Finished { options, job: &job, rows: &rows }.tell()?;
    Ok(Outcome::Clean)
}

/// The films and methods that the options ask for.
fn job(options: &SpeckleOptions) -> Result<Job, UsageError> {
    let study = options.study;
    let single = study == SpeckleStudy::Peak || !study.levels().is_empty();
    let words = |given: &[String], otherwise: &[&str]| -> Vec<String> {
        if given.is_empty() { otherwise.iter().map(|word| (*word).to_owned()).collect() } else { given.to_vec() }
    };
    let names = plan::patterns();
    let all: Vec<&str> = names.iter().map(|(name, _)| *name).collect();
    let patterns = words(&options.patterns, if single { &["e-II"] } else { &all });
    let methods: &[&str] = if study == SpeckleStudy::Peak {
        &["paper", "peak-plain", "peak-spline", "paper-fit", "ic-gn"]
    } else {
        &["paper", "paper-fit", "ic-gn", "rigid"]
    };
    let methods = words(&options.methods, methods);
    if !study.levels().is_empty() && !options.speeds.is_empty() {
        return Err(UsageError(format!("--speeds: the study of {} has speeds of its own", study.word())));
    }
    let sets: &[&str] = if study.levels().is_empty() { &Speeds::ALL.map(Speeds::word) } else { &["off-grid"] };
    let speeds = words(&options.speeds, sets);
    let speeds = plan::chosen("--speeds", &speeds, &Speeds::ALL.map(|speeds| (speeds.word(), speeds)))?;
    let patterns = plan::chosen("--patterns", &patterns, &names)?;
    if !(2..=12).contains(&options.frames) {
        return Err(UsageError(format!("--frames {}: allowed is 2 to 12", options.frames)));
    }
    if let (SpeckleStudy::Noise, Some(noise_dn)) = (study, options.noise_dn) {
        return Err(UsageError(format!("--noise-dn {noise_dn}: the study of noise has its own")));
    }
    let noise_dn = options.noise_dn.unwrap_or(NOISE_DN);
    if !(0.0..=64.0).contains(&noise_dn) {
        return Err(UsageError(format!("--noise-dn {noise_dn}: allowed is 0 to 64")));
    }
    Ok(Job {
        study,
        films: study.plan(&patterns, &speeds),
        ways: plan::chosen("--methods", &methods, &Way::WORDS)?,
        windows: Windows { subset_size_px: options.subset_size_px, step_px: options.step_px },
        filming: Filming { frames: options.frames, noise_dn, blur_px: BLUR_PX, seed: options.seed },
    })
}

/// Everything that the films' rows depend on; a table made with other settings is not gone on with.
fn settings(options: &SpeckleOptions, job: &Job) -> Value {
    let mut patterns: Vec<&str> = Vec::new();
    let mut speeds: Vec<&str> = Vec::new();
    for Film { pattern, speeds: set, .. } in &job.films {
        let name = crate::synth::PatternSetup::PAPER[*pattern];
        if !patterns.contains(&name) {
            patterns.push(name);
        }
        if !speeds.contains(&set.word()) {
            speeds.push(set.word());
        }
    }
    json!({
        "study": options.study.word(),
        "version": env!("CARGO_PKG_VERSION"),
        "patterns": patterns,
        "speeds": speeds,
        "methods": job.ways.iter().map(|way| way.word()).collect::<Vec<_>>(),
        "frames": job.filming.frames,
        "subset_size_px": job.windows.subset_size_px,
        "step_px": job.windows.step_px,
        "noise_dn": (options.study != SpeckleStudy::Noise).then_some(job.filming.noise_dn),
        "seed": job.filming.seed,
        "films": job.films.len(),
    })
}
