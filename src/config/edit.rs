//! Rig files with some of their values replaced.

use super::{Config, ConfigError};
use std::path::Path;
use toml_edit::{DocumentMut, Item, Table, Value, value};

/// The keys of `[camera]` that describe frames and hold for a recording of them too.
const FRAME_KEYS: [&str; 4] = ["exposure_us", "gamma", "row_time_us", "defective_px"];

/// A value to set, with its path (`camera.source`).
pub type Change<'a> = (&'a str, Value);

impl Config {
    /// Returns the same rig with these values set, in order. Missing tables are added. Everything else stays as it is,
    /// including comments.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when the changed file is not a valid rig file.
    pub fn with(&self, changes: &[Change<'_>]) -> Result<Self, ConfigError> {
        self.with_edit(|document| set_all(document, changes))
    }

    /// Returns the same rig with a recording as its camera, without views, trigger and recorder, and then sets these
    /// values.
    ///
    /// Exposure, tone curve, row time and defective pixels of the camera are kept. The corner of its window goes to the
    /// calibration, unless that has one.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when the changed file is not a valid rig file.
    pub fn with_recording(&self, recording: &Path, changes: &[Change<'_>]) -> Result<Self, ConfigError> {
        self.with_edit(|document| {
            let camera = document.insert("camera", Item::Table(Table::new())).unwrap_or_default();
            let corner = ["offset_x_px", "offset_y_px"].map(|key| camera.get(key).and_then(Item::as_integer));
            // A recording does not contain which window of the sensor it shows.
            if let ([Some(x), Some(y)], Some(calibration)) = (corner, document.get_mut("calibration"))
                && let Some(table) = calibration.as_table_like_mut().filter(|table| !table.contains_key("offset_px"))
            {
                table.insert("offset_px", value([x, y].into_iter().collect::<toml_edit::Array>()));
            }
            set(document, "camera.source", "recording".into());
            for key in FRAME_KEYS {
                if let Some(Item::Value(kept)) = camera.get(key) {
                    set(document, &format!("camera.{key}"), kept.clone());
                }
            }
            set(document, "camera.id", recording.display().to_string().into());
            for table in ["view", "trigger", "record"] {
                document.remove(table);
            }
            set_all(document, changes);
        })
    }

    /// Returns the rig of this file after an edit of its text.
    fn with_edit(&self, edit: impl FnOnce(&mut DocumentMut)) -> Result<Self, ConfigError> {
        // The text was parsed before, so it parses again.
        let mut document = self.text.parse::<DocumentMut>().unwrap_or_default();
        edit(&mut document);
        Self::parse(&document.to_string(), &self.origin)
    }
}

/// Sets values in order.
fn set_all(document: &mut DocumentMut, changes: &[Change<'_>]) {
    for (path, new) in changes {
        set(document, path, new.clone());
    }
}

/// Sets the value at `table.key`, and adds the table if it is missing. A path without a dot is a key of `[rig]`.
fn set(document: &mut DocumentMut, path: &str, new: Value) {
    let (table, key) = path.split_once('.').unwrap_or(("rig", path));
    let entry = document.entry(table).or_insert_with(|| Item::Table(Table::new()));
    if let Some(table) = entry.as_table_like_mut() {
        table.insert(key, value(new));
    }
}
