//! Checks that every table of the rig file shares.

use super::error::ConfigError;
use super::text::Text;
use crate::results::UnknownName;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// The range of a number, with its unit.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    low: f64,
    high: f64,
    low_is_allowed: bool,
    unit: &'static str,
}

impl Bounds {
    /// Allows `low` to `high`, both included.
    pub const fn closed(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, low_is_allowed: true, unit }
    }

    /// Allows values above `low` and at most `high`.
    pub const fn above(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, low_is_allowed: false, unit }
    }

    /// Whether the value is within the range.
    pub fn contains(self, value: f64) -> bool {
        value <= self.high && (value > self.low || self.low_is_allowed && value >= self.low)
    }

    /// Describes the range with its unit, to complete the sentence "must be ...".
    fn allowed(self) -> String {
        let Self { low, high, unit, .. } = self;
        let range =
            if self.low_is_allowed { format!("{low} to {high}") } else { format!("above {low} and at most {high}") };
        with_unit(range, unit)
    }
}

/// Appends the unit, if there is one.
fn with_unit(range: String, unit: &str) -> String {
    if unit.is_empty() { range } else { format!("{range} {unit}") }
}

/// A table of the file, by its path.
pub(super) struct Table<'t> {
    pub text: &'t Text<'t>,
    path: String,
}

impl<'t> Table<'t> {
    /// Returns the table with this path in the file.
    pub fn new(text: &'t Text<'t>, path: impl Into<String>) -> Self {
        Self { text, path: path.into() }
    }

    /// Returns the full path of a key.
    pub fn key(&self, key: &str) -> String {
        format!("{}.{key}", self.path)
    }

    /// Returns the error that refuses the value of a key, or its absence; `allowed` completes the sentence "must be
    /// ...".
    pub fn refuse(&self, key: &str, allowed: impl Into<String>) -> ConfigError {
        self.text.refuse(&self.key(key), allowed)
    }

    /// Returns the error for a key that belongs to the settings `owners`, not to the chosen one.
    pub fn foreign_key_error(&self, key: &str, chosen: impl Into<String>, owners: impl Into<String>) -> ConfigError {
        self.text.foreign_key_error(&self.key(key), chosen, owners)
    }

    /// Refuses the first given key that does not belong to the chosen value of `setting`.
    pub fn check_owners<T: Copy + PartialEq>(
        &self,
        setting: Setting<T>,
        chosen: T,
        keys: &[OwnedKey<'_, T>],
    ) -> Result<(), ConfigError> {
        match keys.iter().find(|(_, is_given, owners)| *is_given && !owners.contains(&chosen)) {
            None => Ok(()),
            Some((key, _, owners)) => {
                Err(self.foreign_key_error(key, setting.assignment(&[chosen]), setting.assignment(owners)))
            }
        }
    }

    /// Returns a number that is within the bounds, `None` without one, else the error that refuses it.
    pub fn number(&self, key: &str, value: Option<f64>, bounds: Bounds) -> Result<Option<f64>, ConfigError> {
        match value {
            Some(value) if !bounds.contains(value) => Err(self.refuse(key, bounds.allowed())),
            value => Ok(value),
        }
    }

    /// Returns a whole number that is within the range, converted, `None` without one, else the error that refuses it.
    pub fn integer<T: TryFrom<i64>>(
        &self,
        key: &str,
        value: Option<i64>,
        range: RangeInclusive<i64>,
        unit: &str,
    ) -> Result<Option<T>, ConfigError> {
        let Some(value) = value else { return Ok(None) };
        match T::try_from(value) {
            Ok(fitting) if range.contains(&value) => Ok(Some(fitting)),
            _ => Err(self.refuse(key, with_unit(format!("{} to {}", range.start(), range.end()), unit))),
        }
    }

    /// Parses the name of an enum's value; `None` without a name. An unknown one is refused with all names.
    pub fn named<T: FromStr<Err = UnknownName>>(
        &self,
        key: &str,
        value: Option<&str>,
    ) -> Result<Option<T>, ConfigError> {
        let value = value.map(str::parse).transpose();
        value.map_err(|error: UnknownName| self.refuse(key, quoted(error.known.iter().copied())))
    }

    /// Looks up the value of a word; `None` without a word. An unknown one is refused with all words.
    pub fn choice<T: Copy>(
        &self,
        key: &str,
        value: Option<&str>,
        words: &[(&str, T)],
    ) -> Result<Option<T>, ConfigError> {
        let Some(value) = value else { return Ok(None) };
        let found = words.iter().find(|(word, _)| *word == value);
        found.map(|(_, chosen)| Some(*chosen)).ok_or_else(|| self.refuse(key, quoted(words.iter().map(|(w, _)| *w))))
    }

    /// Checks that a text is one line and not empty.
    pub fn single_line(&self, key: &str, value: Option<String>) -> Result<Option<String>, ConfigError> {
        match value {
            Some(value) if value.trim().is_empty() || value.chars().any(char::is_control) => {
                Err(self.refuse(key, "a text of one line that is not empty"))
            }
            value => Ok(value),
        }
    }

    /// Checks a name of 1 to `length_max` of the characters `a-z 0-9 _ -`.
    pub fn name(&self, key: &str, value: String, length_max: usize) -> Result<String, ConfigError> {
        if is_name(&value, length_max) {
            return Ok(value);
        }
        Err(self.refuse(key, format!("1 to {length_max} of the characters a-z 0-9 _ -")))
    }

    /// Checks a region as x, y, width, height, px, which must lie inside the image, of at most 65535 px where its size
    /// is unknown.
    pub fn region(
        &self,
        key: &str,
        value: Option<&[i64]>,
        image_px: Option<(u32, u32)>,
    ) -> Result<Option<[u32; 4]>, ConfigError> {
        let Some(value) = value else { return Ok(None) };
        let (width, height) = image_px.unwrap_or((65_535, 65_535));
        let numbers: Option<Vec<u32>> = value.iter().map(|px| u32::try_from(*px).ok()).collect();
        let fits =
            |start: u32, size: u32, limit: u32| size >= 1 && start.checked_add(size).is_some_and(|end| end <= limit);
        match numbers.as_deref() {
            Some(&[x, y, w, h]) if fits(x, w, width) && fits(y, h, height) => Ok(Some([x, y, w, h])),
            _ => {
                let room = if image_px.is_some() { "the image of" } else { "an image of at most" };
                Err(self.refuse(key, format!("[x, y, width, height] inside {room} {width} x {height} px")))
            }
        }
    }
}

/// A key, whether the file has it, and the values of a setting that it belongs to.
pub(super) type OwnedKey<'a, T> = (&'static str, bool, &'a [T]);

/// A key whose values are those of an enum.
#[derive(Clone, Copy)]
pub(super) struct Setting<T> {
    pub key: &'static str,
    pub name: fn(T) -> &'static str,
}

impl<T: Copy> Setting<T> {
    /// Returns `key = "name"`, with the names of all these values.
    pub fn assignment(self, values: &[T]) -> String {
        format!("{} = {}", self.key, quoted(values.iter().map(|value| (self.name)(*value))))
    }
}

/// Whether a name has 1 to `length_max` of the characters `a-z 0-9 _ -`.
pub(super) fn is_name(name: &str, length_max: usize) -> bool {
    let letter = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"_-".contains(&byte);
    (1..=length_max).contains(&name.len()) && name.bytes().all(letter)
}

/// Returns a list of words, each in quotes.
pub(super) fn quoted<'w>(words: impl Iterator<Item = &'w str>) -> String {
    words.map(|word| format!("{word:?}")).collect::<Vec<_>>().join(", ")
}
