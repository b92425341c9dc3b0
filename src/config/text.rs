//! The rig file as text: the position of each key, for error messages.

use super::error::{ConfigError, Problem};
use super::key::one_line;
use super::raw::RawConfig;
use std::ops::Range;
use toml::de::{DeTable, DeValue};

/// The number of characters of a value that an error message shows.
const SHOWN_CHARACTERS: usize = 60;

/// The position of a key, or of an element of a list.
#[derive(Clone)]
struct Place {
    path: String,
    /// The start of its own name in `path`.
    name_at: usize,
    key: Range<usize>,
    value: Range<usize>,
}

/// The text of a rig file that is valid TOML.
pub(super) struct Text<'t> {
    text: &'t str,
    origin: &'t str,
    places: Vec<Place>,
    /// The table that paths start from, with a dot at its end.
    prefix: String,
}

/// Returns a hint for a line whose value is a number with a decimal comma; `None` for any other line.
fn decimal_comma_hint(line: &str) -> Option<&'static str> {
    let (_, value) = line.split_once('=')?;
    let (whole, rest) = value.trim().split_once(',')?;
    let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_number = is_digits(whole.trim_start_matches(['-', '+'])) && is_digits(rest.split(' ').next()?);
    is_number.then_some("; decimals follow a point, as in 63.25")
}

impl<'t> Text<'t> {
    /// Parses the text as TOML with any content; `origin` names it in errors.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] with the line of the first error of syntax.
    pub fn new(text: &'t str, origin: &'t str) -> Result<Self, ConfigError> {
        let table = DeTable::parse(text).map_err(|error| {
            let line = line_at(text, error.span().map_or(text.len(), |span| span.start));
            let hint = text.lines().nth(line.saturating_sub(1)).and_then(decimal_comma_hint).unwrap_or_default();
            let problem = Problem::Syntax(one_line(error.message()) + hint).into();
            ConfigError { origin: origin.into(), line: Some(line), problem }
        })?;
        let mut places = Vec::new();
        collect_table(table.get_ref(), "", &mut places);
        Ok(Self { text, origin, places, prefix: String::new() })
    }

    /// Returns the same file with paths that start from a table; `prefix` is its path with a dot at the end.
    pub fn within(&self, prefix: &str) -> Self {
        Self { places: self.places.clone(), prefix: prefix.to_owned(), ..*self }
    }

    /// Reads names and types of the whole file, without any check of the values.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] with the key that is unknown or has the wrong type.
    pub fn raw(&self) -> Result<RawConfig, ConfigError> {
        toml::from_str(self.text).map_err(|error| self.explain(&error))
    }

    /// Returns the error that refuses the value at `path`, or its absence; `allowed` completes the sentence "must be
    /// ...".
    pub fn refuse(&self, path: &str, allowed: impl Into<String>) -> ConfigError {
        let (key, allowed) = (self.full_path(path), allowed.into());
        let problem = match self.find_place(&key) {
            Some(place) => Problem::Value { key: key.clone(), value: self.shown_value(&place.value), allowed },
            None => Problem::Missing { key: key.clone(), allowed },
        };
        self.key_error(&key, problem)
    }

    /// Returns the error for a key that belongs to the settings `owners`, not to the chosen one.
    pub fn foreign_key_error(&self, path: &str, chosen: impl Into<String>, owners: impl Into<String>) -> ConfigError {
        let key = self.full_path(path);
        let value = self.find_place(&key).map_or_else(String::new, |place| self.shown_value(&place.value));
        self.key_error(&key, Problem::Foreign { key: key.clone(), value, chosen: chosen.into(), owners: owners.into() })
    }

    /// Returns the error of a key, with its line if the file has it.
    fn key_error(&self, key: &str, problem: Problem) -> ConfigError {
        let line = self.find_place(key).map(|place| line_at(self.text, place.value.start));
        ConfigError { origin: self.origin.into(), line, problem: problem.into() }
    }

    /// Returns a path from the start of the file.
    fn full_path(&self, path: &str) -> String {
        format!("{}{path}", self.prefix)
    }

    /// Translates an error of serde to one with the key, its value and the allowed type.
    fn explain(&self, error: &toml::de::Error) -> ConfigError {
        let message = error.message();
        let span = error.span().unwrap_or(0..self.text.len());
        let problem = match self.place_at(&span) {
            None => Problem::Syntax(one_line(message)),
            Some(place) if message.starts_with("unknown field") => {
                let (table, name) = place.path.split_at(place.name_at);
                let nearest = format!("{table}{}", nearest(name, known_words(message)));
                Problem::UnknownKey { key: place.path.clone(), nearest }
            }
            Some(place) => {
                let allowed = message.rsplit_once("expected ").map_or(message, |(_, expected)| expected);
                Problem::Value { key: place.path.clone(), value: self.shown_value(&span), allowed: plain_type(allowed) }
            }
        };
        ConfigError { origin: self.origin.into(), line: Some(line_at(self.text, span.start)), problem: problem.into() }
    }

    /// Finds the key or value that an error refers to: the smallest one around its span of bytes. `None` if there is none.
    fn place_at(&self, span: &Range<usize>) -> Option<&Place> {
        let around = |range: &Range<usize>| range.start <= span.start && span.end <= range.end;
        let size = |place: &Place| {
            let spans = [&place.key, &place.value];
            spans.into_iter().filter(|range| around(range)).map(|range| range.len()).min()
        };
        self.places.iter().filter_map(|place| Some((size(place)?, place))).min_by_key(|(size, _)| *size).map(|(_, p)| p)
    }

    /// Finds the key or list element with this full path.
    fn find_place(&self, path: &str) -> Option<&Place> {
        self.places.iter().find(|place| place.path == path)
    }

    /// Returns a part of the file in one line, shortened to [`SHOWN_CHARACTERS`].
    fn shown_value(&self, span: &Range<usize>) -> String {
        let line = one_line(&self.text[span.clone()]);
        if line.chars().count() <= SHOWN_CHARACTERS {
            return line;
        }
        line.chars().take(SHOWN_CHARACTERS).chain("...".chars()).collect()
    }
}

/// Returns a key as it is written in a path: in quotes with escapes, unless it is a plain word.
pub(super) fn path_name(key: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_-".contains(&byte);
    if !key.is_empty() && key.bytes().all(plain) { key.into() } else { format!("{key:?}") }
}

/// Adds the places of a table's keys and of everything within them. `parent` is the path of the table.
fn collect_table(table: &DeTable<'_>, parent: &str, places: &mut Vec<Place>) {
    for (key, value) in table {
        let start = if parent.is_empty() { String::new() } else { format!("{parent}.") };
        let path = format!("{start}{}", path_name(key.get_ref()));
        collect_value(value.get_ref(), &path, places);
        places.push(Place { path, name_at: start.len(), key: key.span(), value: value.span() });
    }
}

/// Adds the places within a value. `parent` is the path of the value.
fn collect_value(value: &DeValue<'_>, parent: &str, places: &mut Vec<Place>) {
    match value {
        DeValue::Table(table) => collect_table(table, parent, places),
        DeValue::Array(array) => {
            for (index, element) in array.iter().enumerate() {
                let path = format!("{parent}[{index}]");
                collect_value(element.get_ref(), &path, places);
                places.push(Place { path, name_at: parent.len(), key: element.span(), value: element.span() });
            }
        }
        _ => {}
    }
}

/// Returns the line at a byte offset, counted from 1.
fn line_at(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|byte| *byte == b'\n').count()
}

/// Returns the names that serde lists after "expected", each between backticks.
fn known_words(message: &str) -> impl Iterator<Item = &str> {
    let expected = message.rsplit_once(", expected").map_or("", |(_, expected)| expected);
    expected.split('`').skip(1).step_by(2)
}

/// Returns the known word with the most similar spelling; empty if none is known.
pub(super) fn nearest<'w>(name: &str, known: impl Iterator<Item = &'w str>) -> &'w str {
    known.min_by_key(|word| edit_distance(name, word)).unwrap_or_default()
}

/// Counts the characters to insert, delete or replace to turn one word into the other (Levenshtein distance).
fn edit_distance(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (index, letter) in from.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = index + 1;
        for (column, other) in to.iter().enumerate() {
            let changed = diagonal + usize::from(letter != *other);
            diagonal = row[column + 1];
            row[column + 1] = changed.min(diagonal + 1).min(row[column] + 1);
        }
    }
    row[to.len()]
}

/// Returns the name of a type, by serde's name, as a user of TOML knows it. An unknown one stays as it is.
fn plain_type(expected: &str) -> String {
    match expected {
        "i64" => "a whole number".into(),
        "f64" => "a number".into(),
        "a boolean" => "true or false".into(),
        "a sequence" => "a list".into(),
        "a string" => "a text in quotes".into(),
        "a map" => "a table".into(),
        other => one_line(other),
    }
}
