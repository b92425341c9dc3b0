//! `ricochet setup`: proposes a rig file for a film.

mod gravity;
mod picture;
mod proposal;
mod rig_text;

use super::film_survey::{self, FilmFiles};
use super::image_order::ImageOrder;
use crate::config::Config;
use crate::console::{Outcome, Overwrite, UsageError, WriteError, check_no_input, print_line, print_note, write_file};
use crate::failure::{ExitCode, Failure, Fatal};
use crate::image::{Frame, encode_png};
use proposal::Proposal;
use serde_json::json;
use std::io::{IsTerminal, Write as _};
use std::path::{Path, PathBuf};

/// The options of `ricochet setup`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct SetupOptions {
    /// A film, a recording, or the images of one sequence.
    #[arg(required = true, value_name = "FILM")]
    pub film: Vec<PathBuf>,
    /// Frame rate, Hz; replaces the file's own, for files that record none or only a playback rate.
    #[arg(long)]
    pub fps: Option<f64>,
    /// The order of the images of a sequence.
    #[command(flatten)]
    pub order: ImageOrder,
    /// True diameter of the ball, or width of the rod, mm; asked for at a terminal.
    #[arg(long, value_name = "MM")]
    pub diameter_mm: Option<f64>,
    /// Rig file to write; a picture of the proposal is written next to it.
    #[arg(short, long, default_value = "rig.toml")]
    pub output: PathBuf,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// A rig file that lacks its scale.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
struct Incomplete(String);

impl Fatal for Incomplete {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}

/// Nothing in a film can be followed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
struct NothingFound(String);

impl Fatal for NothingFound {
    fn exit_code(&self) -> ExitCode {
        ExitCode::NothingMeasured
    }
}

/// Surveys the film, writes the rig file and its picture, and prints the proposal.
///
/// # Errors
///
/// When the film cannot be read, nothing in it can be followed, a file exists without `--force`, or the scale is missing. In
/// the last case the files are written all the same.
pub fn run(options: &SetupOptions) -> Result<Outcome, Failure> {
    let picture_path = options.output.with_extension("png");
    check_outputs(options, &picture_path)?;
    if let Some(diameter_mm) = options.diameter_mm.filter(|mm| !(*mm > 0.0 && *mm <= 10_000.0)) {
        return Err(UsageError(format!("--diameter-mm {diameter_mm}: must be above 0 and at most 10000 mm")).into());
    }
    let film = FilmFiles { inputs: options.film.clone(), camera: None, fps: options.fps, order: options.order.order() };
    let surveyed = film_survey::survey(&film)?;
    let name = options.film[0].display().to_string();
    let diameter_mm = match options.diameter_mm {
        None if proposal::needs_diameter(&surveyed) => ask_diameter()?,
        given => given,
    };
    let proposal =
        Proposal::from_survey(&surveyed, diameter_mm).map_err(|reason| NothingFound(format!("{name}: {reason}")))?;
    let command = next_command(options, &name);
    let text = rig_text::rig_text(&proposal, &name, &command);
    // A proposal that the program itself refuses would be a bug.
    Config::parse(&text, &options.output.display().to_string())?;
    let (meta, bytes) = film.frame(proposal.shown_frame)?;
    let drawn = picture::draw(&proposal, &surveyed, &Frame { meta, bytes: &bytes })?;
    write_file(&options.output, &text, options.overwrite)?;
    let png = encode_png(&drawn).map_err(|error| WriteError::new(&picture_path, error))?;
    write_file(&picture_path, png, options.overwrite)?;
    print_proposal(options, &proposal, &picture_path, &command);
    match proposal.missing {
        Some(missing) => Err(Incomplete(format!("{}: {missing}", options.output.display())).into()),
        None => Ok(Outcome::Clean),
    }
}

/// Checks that no file is overwritten, and that the picture does not lie among the images of the film.
fn check_outputs(options: &SetupOptions, picture_path: &Path) -> Result<(), UsageError> {
    for path in [options.output.as_path(), picture_path] {
        check_no_input(path, &options.film)?;
        options.overwrite.check(path)?;
    }
    // The next command would take the picture for a frame.
    let folder = |path: &Path| path.parent().and_then(|parent| parent.join(".").canonicalize().ok());
    let holds_picture = |input: &PathBuf| match input.is_dir() {
        true => input.canonicalize().ok() == folder(picture_path),
        false => options.film.len() > 1 && folder(input) == folder(picture_path),
    };
    if options.film.iter().any(holds_picture) {
        let picture = picture_path.display();
        return Err(UsageError(format!(
            "{picture} would lie among the images of the film; choose another folder with -o"
        )));
    }
    Ok(())
}

/// Asks for the diameter, mm, at a terminal; `None` elsewhere, or for an empty answer.
///
/// # Errors
///
/// [`UsageError`] for an answer that is not above 0 and at most 10000 mm.
fn ask_diameter() -> Result<Option<f64>, Failure> {
    if !(std::io::stdin().is_terminal() && std::io::stderr().is_terminal()) {
        return Ok(None);
    }
    eprint!("True diameter of the ball, mm: ");
    std::io::stderr().flush()?;
    let mut line = String::new();
    std::io::stdin().read_line(&mut line)?;
    let answer = line.trim();
    if answer.is_empty() {
        return Ok(None);
    }
    let diameter_mm = answer.parse().ok().filter(|mm: &f64| *mm > 0.0 && *mm <= 10_000.0);
    diameter_mm
        .map(Some)
        .ok_or_else(|| UsageError(format!("diameter {answer:?}: must be a number above 0 and at most 10000 mm")).into())
}

/// Returns the command that measures the film with the proposal.
fn next_command(options: &SetupOptions, name: &str) -> String {
    let quoted = |word: &str| {
        let is_plain = word.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"/._-".contains(&byte));
        if is_plain { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
    };
    let more = if options.film.len() > 1 { " ..." } else { "" };
    let rate = options.fps.map_or_else(String::new, |fps| format!(" --fps {fps}"));
    let config = options.output.display().to_string();
    let order = if options.order.reverse { " --reverse" } else { "" };
    format!("ricochet analyze {}{more}{rate}{order} --config {}", quoted(name), quoted(&config))
}

/// Prints the files, the proposal, its warnings and the next command, as text or JSON.
fn print_proposal(options: &SetupOptions, proposal: &Proposal, picture_path: &Path, command: &str) {
    let facts = proposal.facts();
    if options.json {
        let facts: serde_json::Map<_, _> =
            facts.into_iter().map(|(name, text)| (name.to_owned(), text.into())).collect();
        let printed = json!({
            "rig": options.output, "picture": picture_path, "proposal": facts, "warnings": proposal.warnings,
            "next": command,
        });
        return print_line(&printed.to_string());
    }
    print_line(&options.output.display().to_string());
    print_line(&picture_path.display().to_string());
    facts.iter().for_each(|(name, text)| print_line(&format!("{name:<9} {text}")));
    proposal.warnings.iter().for_each(|warning| print_note(&format!("warning: {warning}")));
    print_line(&format!("next      {command}"));
}
