//! The rig file as text: where each key stands, and errors that say so.

use super::error::ConfigError;
use super::raw::RawConfig;
use std::ops::Range;
use toml::de::{DeTable, DeValue};

/// A value longer than this is cut in an error message, characters.
const SHOWN_CHARACTERS: usize = 60;

/// One key, or one element of a list, and where it stands.
#[derive(Clone)]
struct Place {
    path: String,
    /// Where in `path` its own name begins.
    name_at: usize,
    key: Range<usize>,
    value: Range<usize>,
}

/// A rig file that is at least TOML.
pub(super) struct Text<'t> {
    text: &'t str,
    origin: &'t str,
    places: Vec<Place>,
    /// What stands in front of every path that is asked for.
    prefix: String,
}

impl<'t> Text<'t> {
    /// Parses the text as TOML of any content; `origin` names it in errors.
    pub fn new(text: &'t str, origin: &'t str) -> Result<Self, ConfigError> {
        let table = DeTable::parse(text).map_err(|error| ConfigError::Syntax {
            origin: origin.into(),
            line: line_of(text, error.span().map_or(text.len(), |span| span.start)),
            reason: one_line(error.message()),
        })?;
        let mut places = Vec::new();
        collect_table(table.get_ref(), "", &mut places);
        Ok(Self { text, origin, places, prefix: String::new() })
    }

    /// The same file, in which paths begin inside a table.
    pub fn within(&self, prefix: &str) -> Self {
        Self { places: self.places.clone(), prefix: prefix.to_owned(), ..*self }
    }

    /// Reads names and types.
    pub fn raw(&self) -> Result<RawConfig, ConfigError> {
        toml::from_str(self.text).map_err(|error| self.explain(&error))
    }

    /// Refuses the value at `path`, or its absence; `allowed` completes the sentence "must be ...".
    pub fn refuse(&self, path: &str, allowed: impl Into<String>) -> ConfigError {
        let path = self.full(path);
        let (origin, key, allowed) = (self.origin.to_string(), path.clone(), allowed.into());
        match self.place(&path) {
            Some(place) => {
                ConfigError::Value { origin, line: self.line(place), key, value: self.shown(&place.value), allowed }
            }
            None => ConfigError::Missing { origin, key, allowed },
        }
    }

    /// Refuses a key that belongs to another setting than the one it was met with.
    pub fn out_of_place(&self, path: &str, with: &str, belongs_to: &str) -> ConfigError {
        let path = self.full(path);
        let place = self.place(&path);
        ConfigError::OutOfPlace {
            origin: self.origin.into(),
            line: place.map_or(1, |place| self.line(place)),
            key: path.clone(),
            value: place.map_or_else(String::new, |place| self.shown(&place.value)),
            settings: format!("{with}; it belongs to {belongs_to}"),
        }
    }

    /// Refuses a value that this version cannot do.
    pub fn not_offered(&self, path: &str, instead: impl Into<String>) -> ConfigError {
        let path = self.full(path);
        let place = self.place(&path);
        let what = match place {
            Some(place) if self.text[place.value.clone()].starts_with(&format!("[{path}]")) => {
                format!("the table [{path}]")
            }
            Some(place) => format!("{path} = {}", self.shown(&place.value)),
            None => path.clone(),
        };
        let line = place.map_or(1, |place| self.line(place));
        ConfigError::NotOffered { origin: self.origin.into(), line, what, instead: instead.into() }
    }

    fn full(&self, path: &str) -> String {
        format!("{}{path}", self.prefix)
    }

    /// Turns serde's words into ours.
    fn explain(&self, error: &toml::de::Error) -> ConfigError {
        let message = error.message();
        let span = error.span().unwrap_or(0..self.text.len());
        let line = line_of(self.text, span.start);
        let origin = self.origin.to_string();
        let Some(place) = self.place_at(&span) else {
            return ConfigError::Syntax { origin, line, reason: one_line(message) };
        };
        let key = place.path.clone();
        if message.starts_with("unknown field") {
            let (table, name) = key.split_at(place.name_at);
            let nearest = format!("{table}{}", nearest(name, known_words(message)));
            return ConfigError::UnknownKey { origin, line, key, nearest };
        }
        let allowed = message.rsplit_once("expected ").map_or(message, |(_, expected)| expected);
        ConfigError::Value { origin, line, key, value: self.shown(&span), allowed: plain_type(allowed) }
    }

    /// The key or value an error points at: the same span, else the smallest around it.
    fn place_at(&self, span: &Range<usize>) -> Option<&Place> {
        let around = |range: &Range<usize>| range.start <= span.start && span.end <= range.end;
        let size = |place: &Place| {
            let spans = [&place.key, &place.value];
            spans.into_iter().filter(|range| around(range)).map(|range| range.len()).min()
        };
        self.places.iter().filter_map(|place| Some((size(place)?, place))).min_by_key(|(size, _)| *size).map(|(_, p)| p)
    }

    fn place(&self, path: &str) -> Option<&Place> {
        self.places.iter().find(|place| place.path == path)
    }

    fn line(&self, place: &Place) -> usize {
        line_of(self.text, place.value.start)
    }

    fn shown(&self, span: &Range<usize>) -> String {
        let line = one_line(&self.text[span.clone()]);
        if line.chars().count() <= SHOWN_CHARACTERS {
            return line;
        }
        line.chars().take(SHOWN_CHARACTERS).chain("...".chars()).collect()
    }
}

/// A key as it stands in a path: in quotes, with escapes, when it is more than a plain word.
pub(super) fn path_name(key: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_-".contains(&byte);
    if !key.is_empty() && key.bytes().all(plain) { key.into() } else { format!("{key:?}") }
}

fn collect_table(table: &DeTable<'_>, parent: &str, places: &mut Vec<Place>) {
    for (key, value) in table {
        let start = if parent.is_empty() { String::new() } else { format!("{parent}.") };
        let path = format!("{start}{}", path_name(key.get_ref()));
        collect_value(value.get_ref(), &path, places);
        places.push(Place { path, name_at: start.len(), key: key.span(), value: value.span() });
    }
}

fn collect_value(value: &DeValue<'_>, path: &str, places: &mut Vec<Place>) {
    match value {
        DeValue::Table(table) => collect_table(table, path, places),
        DeValue::Array(array) => {
            for (index, element) in array.iter().enumerate() {
                let element_path = format!("{path}[{index}]");
                collect_value(element.get_ref(), &element_path, places);
                places.push(Place {
                    path: element_path,
                    name_at: path.len(),
                    key: element.span(),
                    value: element.span(),
                });
            }
        }
        _ => {}
    }
}

fn line_of(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|byte| *byte == b'\n').count()
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The names serde lists after "expected", each between backticks.
fn known_words(message: &str) -> impl Iterator<Item = &str> {
    let expected = message.rsplit_once(", expected").map_or("", |(_, expected)| expected);
    expected.split('`').skip(1).step_by(2)
}

/// The known word that is spelled most like `name`.
fn nearest<'w>(name: &str, known: impl Iterator<Item = &'w str>) -> &'w str {
    known.min_by_key(|word| edit_distance(name, word)).unwrap_or_default()
}

/// Letters to add, drop or change to get from one word to the other (Levenshtein).
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

/// Names of types as a user of TOML knows them.
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
