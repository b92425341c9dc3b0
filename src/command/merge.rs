//! `ricochet merge`: one table of many recordings.

use super::export::{TABLES, write_merged};
use crate::console::{Outcome, OutputFile, Overwrite, UsageError, check_no_input, print_note, progress};
use crate::failure::Failure;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// The options of `ricochet merge`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct MergeOptions {
    /// Recordings, or folders of them.
    #[arg(required = true)]
    pub inputs: Vec<PathBuf>,
    /// Table: velocity, field, track, impact, truth, truth_impact or events.
    #[arg(long, default_value = "impact")]
    pub topic: String,
    /// File to write [default: standard output].
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
}

/// Merges the tables of the recordings in the order given, those of a folder by name. Unfinished ones count as lost.
///
/// # Errors
///
/// When no recording is found, one cannot be read, two have different columns, or the output is one of them.
pub fn run(options: &MergeOptions) -> Result<Outcome, Failure> {
    let topic = options.topic.as_str();
    if !TABLES.contains(&topic) {
        return Err(UsageError(format!("--topic {topic}: not one of {}", TABLES.join(", "))).into());
    }
    let (mut recordings, mut unfinished) = (Vec::new(), Vec::new());
    for input in &options.inputs {
        if input.is_dir() {
            list_recordings(input, &mut recordings, &mut unfinished)?
        } else {
            recordings.push(input.clone())
        }
    }
    if recordings.is_empty() {
        return Err(UsageError(format!("{}: holds no recording", options.inputs[0].display())).into());
    }
    match &options.output {
        None => {
            let bar = progress::bar_of_output(recordings.len() as u64, "merge");
            write_merged(&recordings, topic, std::io::stdout().lock(), "standard output", &bar)?
        }
        Some(path) => {
            check_no_input(path, &recordings)?;
            let mut file = OutputFile::create(path, options.overwrite)?;
            let mut buffered = BufWriter::new(&mut file);
            let bar = progress::bar(recordings.len() as u64, "merge");
            let rows = write_merged(&recordings, topic, &mut buffered, &path.display().to_string(), &bar)?;
            buffered.flush()?;
            drop(buffered);
            file.finish()?;
            rows
        }
    };
    unfinished.iter().for_each(|path| print_note(&format!("{}: unfinished, left out", path.display())));
    Ok(Outcome::from_losses(unfinished.len() as u64))
}

/// Adds the recordings of a folder (`.mcap`), and those that are unfinished (`.part`), each by name.
fn list_recordings(folder: &Path, recordings: &mut Vec<PathBuf>, unfinished: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let mut paths = std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>()?;
    paths.sort();
    for path in paths {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("mcap") => recordings.push(path),
            Some("part") => unfinished.push(path),
            _ => {}
        }
    }
    Ok(())
}
