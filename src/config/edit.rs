//! A rig file with some of its values replaced.

use super::{Config, ConfigError};
use std::path::Path;
use toml_edit::{DocumentMut, Item, Table, Value, value};

/// What is told of a camera's frames holds whoever delivers them.
const TOLD_OF_FRAMES: [&str; 4] = ["exposure_us", "gamma", "row_time_us", "defective_px"];

/// One value to set, by its path (`camera.source`).
pub type Change<'a> = (&'a str, Value);

impl Config {
    /// The same rig with these values set; everything else, comments included, stays as it is.
    ///
    /// # Errors
    ///
    /// When the changed file is not a valid rig file.
    pub fn with(&self, changes: &[Change<'_>]) -> Result<Self, ConfigError> {
        self.edited(|document| {
            for (path, new) in changes {
                set(document, path, new.clone());
            }
        })
    }

    /// The same rig, fed from a recording as fast as it can be measured, or in real time.
    ///
    /// # Errors
    ///
    /// When the changed file is not a valid rig file.
    pub fn fed_from(&self, recording: &Path, changes: &[Change<'_>]) -> Result<Self, ConfigError> {
        self.edited(|document| {
            let told = TOLD_OF_FRAMES.map(|key| document.get("camera").and_then(|camera| camera.get(key)).cloned());
            let corner = ["offset_x_px", "offset_y_px"]
                .map(|key| document.get("camera").and_then(|camera| camera.get(key)).and_then(Item::as_integer));
            document.insert("camera", Item::Table(Table::new()));
            // A recording does not say which window of the sensor it shows.
            if let ([Some(x), Some(y)], Some(calibration)) = (corner, document.get_mut("calibration"))
                && let Some(table) = calibration.as_table_like_mut().filter(|table| !table.contains_key("offset_px"))
            {
                table.insert("offset_px", value([x, y].into_iter().collect::<toml_edit::Array>()));
            }
            set(document, "camera.source", "recording".into());
            for (key, told) in TOLD_OF_FRAMES.iter().zip(told) {
                if let Some(Item::Value(told)) = told {
                    set(document, &format!("camera.{key}"), told);
                }
            }
            set(document, "camera.id", recording.display().to_string().into());
            document.remove("view");
            document.remove("trigger");
            document.remove("record");
            for (path, new) in changes {
                set(document, path, new.clone());
            }
        })
    }

    fn edited(&self, edit: impl FnOnce(&mut DocumentMut)) -> Result<Self, ConfigError> {
        // The text was parsed before, so it parses again.
        let mut document = self.text.parse::<DocumentMut>().unwrap_or_default();
        edit(&mut document);
        Self::parse(&document.to_string(), &self.origin)
    }
}

fn set(document: &mut DocumentMut, path: &str, new: Value) {
    let (table, key) = path.split_once('.').unwrap_or(("rig", path));
    let entry = document.entry(table).or_insert_with(|| Item::Table(Table::new()));
    if let Some(table) = entry.as_table_like_mut() {
        table.insert(key, value(new));
    }
}
