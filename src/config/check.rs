//! Small checks that every table of the rig file is put through.

use super::error::ConfigError;
use super::text::Text;
use std::ops::RangeInclusive;

/// The numbers a value may have.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    low: f64,
    high: f64,
    low_is_allowed: bool,
    unit: &'static str,
}

impl Bounds {
    /// From `low` to `high`, both allowed.
    pub const fn closed(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, low_is_allowed: true, unit }
    }

    /// More than `low`, at most `high`.
    pub const fn above(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, low_is_allowed: false, unit }
    }

    pub(super) fn hold(self, value: f64) -> bool {
        let high_enough = if self.low_is_allowed { value >= self.low } else { value > self.low };
        high_enough && value <= self.high
    }

    fn words(self) -> String {
        let Self { low, high, unit, .. } = self;
        let words =
            if self.low_is_allowed { format!("{low} to {high}") } else { format!("above {low} and at most {high}") };
        with_unit(words, unit)
    }
}

fn with_unit(words: String, unit: &str) -> String {
    if unit.is_empty() { words } else { format!("{words} {unit}") }
}

/// One table of the file, by its path.
pub(super) struct Table<'t> {
    pub text: &'t Text<'t>,
    path: String,
}

impl<'t> Table<'t> {
    pub fn new(text: &'t Text<'t>, path: impl Into<String>) -> Self {
        Self { text, path: path.into() }
    }

    /// Full path of one of its keys.
    pub fn key(&self, key: &str) -> String {
        format!("{}.{key}", self.path)
    }

    /// Refuses the value of one of its keys; `allowed` completes the sentence "must be ...".
    pub fn refuse(&self, key: &str, allowed: impl Into<String>) -> ConfigError {
        self.text.refuse(&self.key(key), allowed)
    }

    /// A finite number within bounds.
    pub fn number(&self, key: &str, value: Option<f64>, bounds: Bounds) -> Result<Option<f64>, ConfigError> {
        match value {
            Some(value) if !bounds.hold(value) => Err(self.refuse(key, bounds.words())),
            value => Ok(value),
        }
    }

    /// A whole number within a range.
    pub fn whole<T: TryFrom<i64>>(
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

    /// One of a few words.
    pub fn choice<T: Copy>(
        &self,
        key: &str,
        value: Option<&str>,
        words: &[(&str, T)],
    ) -> Result<Option<T>, ConfigError> {
        let Some(value) = value else { return Ok(None) };
        let found = words.iter().find(|(word, _)| *word == value);
        found.map(|(_, meaning)| Some(*meaning)).ok_or_else(|| self.refuse(key, listed(words.iter().map(|(w, _)| *w))))
    }

    /// A text with something in it, on one line.
    pub fn filled(&self, key: &str, value: Option<String>) -> Result<Option<String>, ConfigError> {
        match value {
            Some(value) if value.trim().is_empty() || value.chars().any(char::is_control) => {
                Err(self.refuse(key, "a text of one line that is not empty"))
            }
            value => Ok(value),
        }
    }

    /// A region as x, y, width, height; inside the image where its size is known.
    pub fn region(
        &self,
        key: &str,
        value: Option<&[i64]>,
        image_px: Option<(u32, u32)>,
    ) -> Result<Option<[u32; 4]>, ConfigError> {
        let Some(value) = value else { return Ok(None) };
        let (width, height) = image_px.map_or((65_535, 65_535), |(width, height)| (width.into(), height.into()));
        let fits = |start: i64, size: i64, limit: i64| {
            start >= 0 && size >= 1 && start <= limit && size <= limit && start + size <= limit
        };
        let refusal = || {
            let room = if image_px.is_some() { "the image of" } else { "an image of at most" };
            self.refuse(key, format!("[x, y, width, height] inside {room} {width} x {height} px"))
        };
        let [x, y, w, h] = <[i64; 4]>::try_from(value).map_err(|_| refusal())?;
        if !fits(x, w, width) || !fits(y, h, height) {
            return Err(refusal());
        }
        let mut region = [0; 4];
        for (to, from) in region.iter_mut().zip([x, y, w, h]) {
            *to = u32::try_from(from).map_err(|_| refusal())?;
        }
        Ok(Some(region))
    }
}

/// The words there are, each in quotes.
pub(super) fn listed<'w>(words: impl Iterator<Item = &'w str>) -> String {
    words.map(|word| format!("{word:?}")).collect::<Vec<_>>().join(", ")
}
