//! Measuring many films, each on its own, by several processes or computers: `ricochet analyze --shard K/N`.
//!
//! Every process takes each N-th film of the same list, so they need not know of each other. A film whose results are
//! complete is skipped, and so a list can be continued after any interruption.

use super::analyze::{self, AnalyzeOptions};
use super::shard::{SETTINGS, Shard};
use crate::config::Config;
use crate::console::{Outcome, UsageError, print_note};
use crate::failure::{ExitCode, Failure, Fatal};
use crate::interrupt;
use crate::recording::{Recording, part_path};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Films that could not be measured.
#[derive(Debug, thiserror::Error)]
#[error("{count} of {films} films could not be measured; the first: {first}")]
struct FailedFilms {
    count: usize,
    films: usize,
    first: Failure,
}

impl Fatal for FailedFilms {
    fn exit_code(&self) -> ExitCode {
        self.first.exit_code()
    }
}

/// Measures the films of one share into a folder.
///
/// # Errors
///
/// A list that cannot be read, films of one name, or films that cannot be measured. These do not keep others from being
/// measured.
pub fn run(options: &AnalyzeOptions, shard: Shard) -> Result<Outcome, Failure> {
    let folder = options.output.clone().unwrap_or_else(|| PathBuf::from("."));
    std::fs::create_dir_all(&folder)?;
    let films = list_films(&options.inputs)?;
    let named = results_by_film(&films, &folder)?;
    let _lock = lock_share(&folder, shard)?;
    interrupt::set_advice("the same command continues with the films that are left");
    let (mut lost, mut empty, mut failures, mut tried) = (0, 0, Vec::new(), 0);
    for (film, results) in named.iter().skip(shard.index - 1).step_by(shard.of) {
        tried += 1;
        match measure_film(options, film, results) {
            Ok(Outcome::Clean) => {}
            Ok(Outcome::Lost { count, .. }) => lost += count,
            Ok(Outcome::RigLost { losses, .. }) => lost += losses.largest(),
            Ok(Outcome::NothingMeasured { count, .. }) => {
                lost += count;
                empty += 1;
            }
            Err(failure) => {
                print_note(&format!("{}: {failure}", film.display()));
                failures.push(failure);
            }
        }
    }
    let count = failures.len();
    match failures.into_iter().next() {
        Some(first) => Err(FailedFilms { count, films: tried, first }.into()),
        None if tried > 0 && empty == tried => Ok(Outcome::from_losses(lost).with_nothing_measured()),
        None => Ok(Outcome::from_losses(lost)),
    }
}

/// Returns the films of the arguments. A text file (`.txt` or `.list`) has the path of a film on each line; blank lines
/// and those that begin with `#` are skipped.
///
/// # Errors
///
/// [`UsageError`] when a list cannot be read, or there is no film.
fn list_films(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut films = Vec::new();
    for input in inputs {
        if !input.extension().is_some_and(|extension| extension == "txt" || extension == "list") {
            films.push(input.clone());
            continue;
        }
        let text = std::fs::read_to_string(input)
            .map_err(|error| UsageError(format!("cannot read the list {}: {error}", input.display())))?;
        let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
        films.extend(lines.map(PathBuf::from));
    }
    if films.is_empty() { Err(UsageError("the list names no film".into()).into()) } else { Ok(films) }
}

/// Returns each film with the file of its results: the film's name in `folder`, ending in `.mcap`.
///
/// # Errors
///
/// [`UsageError`] when two films would share their results, or these would replace a film.
fn results_by_film(films: &[PathBuf], folder: &Path) -> Result<Vec<(PathBuf, PathBuf)>, UsageError> {
    let mut taken: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut named = Vec::new();
    for film in films {
        let stem = film.file_stem().ok_or_else(|| UsageError(format!("{}: names no film", film.display())))?;
        let results = folder.join(stem).with_extension("mcap");
        if let Some(other) = taken.insert(results.clone(), film) {
            let (film, other) = (film.display(), other.display());
            return Err(UsageError(format!("{other} and {film} would have the same results, {}", results.display())));
        }
        if results == *film {
            return Err(UsageError(format!("{}: --output must be another folder than the film's", film.display())));
        }
        named.push((film.clone(), results));
    }
    Ok(named)
}

/// Locks a share, so that two processes never measure the same film. The lock ends with the returned file.
///
/// # Errors
///
/// [`UsageError`] when another process holds the lock.
fn lock_share(folder: &Path, shard: Shard) -> Result<std::fs::File, Failure> {
    let path = folder.join(format!(".shard-{}-of-{}", shard.index, shard.of));
    let file = std::fs::File::create(&path)?;
    file.try_lock().map_err(|_| {
        let share = format!("share {} of {}", shard.index, shard.of);
        UsageError(format!("{}: another process measures {share}", path.display()))
    })?;
    Ok(file)
}

/// Measures a film into its results file, unless that is complete, which is a clean outcome.
///
/// # Errors
///
/// When the results are those of other settings, or the film cannot be measured.
fn measure_film(options: &AnalyzeOptions, film: &Path, results: &Path) -> Result<Outcome, Failure> {
    let inputs = [film.to_owned()];
    let mut opened = analyze::open(options, &inputs)?;
    let settings = settings_checksum(options, &opened.config, film);
    if let Ok(made) = Recording::open(results) {
        let is_same = made.metadata().get(SETTINGS) == Some(&settings);
        if is_same && made.truncated().is_none() {
            return Ok(Outcome::Clean);
        }
        let reason = "has results of another version or of other settings; remove it, or choose another folder";
        return Err(UsageError(format!("{} {reason}", results.display())).into());
    }
    // The share is locked, so an unfinished file is that of a process that died.
    let _ = std::fs::remove_file(part_path(results));
    opened.metadata.insert(SETTINGS.into(), settings);
    analyze::measure_and_print(opened, options, &inputs, results)
}

/// Returns the version, and a CRC-32 of everything that results depend on; of the film itself only its size in bytes.
fn settings_checksum(options: &AnalyzeOptions, config: &Config, film: &Path) -> String {
    let bytes = film.metadata().map_or(0, |metadata| metadata.len());
    let given = (&options.camera, options.fps, options.order.reverse, options.from_s, options.to_s, bytes);
    let checksum = crc32fast::hash(format!("{given:?} {}", config.text).as_bytes());
    format!("{} {checksum:08x}", env!("CARGO_PKG_VERSION"))
}
