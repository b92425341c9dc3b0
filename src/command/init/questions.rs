//! Questions at a terminal, or answered by lines of standard input.

use crate::command::cameras::FoundCamera;
use crate::config::{BodyKind, Entry, Key, find};
use crate::console::{UsageError, print_note};
use crate::failure::Failure;
use std::io::{BufRead, Write};

/// The folder of recordings that is proposed.
const DIRECTORY: &str = "shots";
/// The size of an image that is proposed.
const SIZE: &str = "640x480";

/// The treatment of questions that no option answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unanswered {
    /// They are asked.
    Ask,
    /// Their default is taken.
    TakeDefault,
}

/// Asks, or takes the default of every question.
pub(super) struct Questions {
    unanswered: Unanswered,
}

impl Questions {
    /// Returns the questions with the treatment of those that no option answers.
    pub fn new(unanswered: Unanswered) -> Self {
        Self { unanswered }
    }

    /// Whether defaults are taken instead of asking.
    fn takes_defaults(&self) -> bool {
        self.unanswered == Unanswered::TakeDefault
    }

    /// Asks for a camera by its number, from 1, in the list of those found, or by its name; returns its name.
    ///
    /// The default is the first one found, else the simulated one.
    pub fn ask_camera(&mut self, given: Option<&str>, found: &[FoundCamera]) -> Result<String, Failure> {
        if given.is_none() && !self.takes_defaults() {
            let names = found.iter().enumerate().map(|(k, camera)| format!("  {}  {}", k + 1, camera.description));
            names.for_each(|line| print_note(&line));
        }
        let question = match found.len() {
            0 => "No camera was found. Camera: simulated, a device file, or an address".to_owned(),
            count => format!("Camera: 1 to {count}, simulated, a device file, or an address"),
        };
        let default = if found.is_empty() { "simulated" } else { "1" };
        self.ask(&question, given, Some(default), |answer| match answer.parse::<usize>() {
            Ok(number) if (1..=found.len()).contains(&number) => Ok(found[number - 1].id.clone()),
            Ok(_) if answer.len() < 3 => Err(format!("camera {answer}: must be 1 to {}, or a name", found.len())),
            _ => Ok(answer.to_owned()),
        })?
        .ok_or_else(|| UsageError("no camera is named".into()).into())
    }

    /// Asks for width and height of the image, each 16 to 65535 px; the default is [`SIZE`].
    pub fn ask_size(&mut self, given: Option<&str>) -> Result<[u32; 2], Failure> {
        let size = self.ask("Size of the image, WIDTHxHEIGHT in px", given, Some(SIZE), |answer| {
            let sides: Option<Vec<u32>> = answer.split(['x', 'X']).map(|side| side.trim().parse().ok()).collect();
            let sides = sides.and_then(|sides| <[u32; 2]>::try_from(sides).ok());
            let range = 16..=65_535;
            let sides = sides.filter(|sides| sides.iter().all(|side| range.contains(side)));
            sides.ok_or_else(|| format!("size {answer:?}: must be WIDTHxHEIGHT, each 16 to 65535 px"))
        })?;
        size.ok_or_else(|| UsageError("no size is given".into()).into())
    }

    /// Asks for the kind of the body; the default is a ball.
    pub fn ask_body(&mut self, given: Option<&str>) -> Result<BodyKind, Failure> {
        let body = self.ask("Body: ball, rod or patch", given, Some("ball"), |answer| {
            answer.parse().map_err(|_| format!("body {answer:?}: must be ball, rod or patch"))
        })?;
        Ok(body.unwrap_or(BodyKind::Ball))
    }

    /// Asks for a number in the range of a key of the rig file, `TABLE.KEY`; `None` if it is left open.
    pub fn ask_number(
        &mut self,
        key: &str,
        question: &str,
        given: Option<f64>,
        default: Option<f64>,
    ) -> Result<Option<f64>, Failure> {
        let (given, default) = (given.map(|x| x.to_string()), default.map(|x| x.to_string()));
        let key = find_key(key)?;
        self.ask(question, given.as_deref(), default.as_deref(), |answer| {
            // A decimal comma is what half of the world types.
            let number = answer.replace(',', ".").parse::<f64>().ok();
            let is_allowed = |x: &f64| key.range().is_none_or(|range| range.contains(*x));
            number.filter(is_allowed).ok_or_else(|| format!("{answer}: must be {}", key.allowed))
        })
    }

    /// Asks for the folder of the recordings; `None` if nothing is to be recorded.
    pub fn ask_directory(&mut self, given: Option<&str>) -> Result<Option<String>, Failure> {
        let question = "Folder of the recordings (- records nothing)";
        let folder = self.ask(question, given, Some(DIRECTORY), |answer| match answer {
            answer if answer.chars().any(char::is_control) => Err("the path must be one line of text".into()),
            answer => Ok(answer.to_owned()),
        })?;
        Ok(folder.filter(|folder| folder != "-"))
    }

    /// Asks until an answer is accepted. A given answer is only checked, and so is the default if defaults are taken.
    ///
    /// Returns `None` for an empty answer without a default.
    ///
    /// # Errors
    ///
    /// When standard input ends, or the given answer is not accepted.
    fn ask<T>(
        &mut self,
        question: &str,
        given: Option<&str>,
        default: Option<&str>,
        accept: impl Fn(&str) -> Result<T, String>,
    ) -> Result<Option<T>, Failure> {
        if let Some(given) = given.or(default.filter(|_| self.takes_defaults())) {
            return Ok(Some(accept(given).map_err(UsageError)?));
        }
        if self.takes_defaults() {
            return Ok(None);
        }
        let shown = default.map_or_else(String::new, |default| format!(" [{default}]"));
        loop {
            let _ = write!(std::io::stderr(), "{question}{shown}: ");
            let _ = std::io::stderr().flush();
            let mut line = String::new();
            if std::io::stdin().lock().read_line(&mut line)? == 0 {
                let cure = "answer it, or pass --defaults";
                return Err(
                    UsageError(format!("standard input ended before the answer to {question:?}; {cure}")).into()
                );
            }
            match (line.trim(), default) {
                ("", None) => return Ok(None),
                (answer, default) => match accept(if answer.is_empty() { default.unwrap_or_default() } else { answer })
                {
                    Ok(value) => return Ok(Some(value)),
                    Err(reason) => print_note(&reason),
                },
            }
        }
    }
}

/// Returns the key of the rig file with this path, `TABLE.KEY`.
fn find_key(name: &str) -> Result<&'static Key, UsageError> {
    match find(name) {
        Ok(Entry::Key(_, key)) => Ok(key),
        _ => Err(UsageError(format!("no key {name:?}"))),
    }
}
