//! `[view.NAME]`: further cameras for the same shots.

use super::check::is_name;
use super::error::ConfigError;
use super::raw::RawView;
use super::text::Text;
use super::{CameraSettings, Config, MAX_RIG_NAME_CHARACTERS, TriggerMode};
use std::collections::BTreeMap;
use toml_edit::{DocumentMut, Item, Table, value};

/// `[view.NAME]`: a further camera.
///
/// It has its own tables: `[view.NAME.camera]`, which is required, `.scale`, `.surface`, `.calibration`, `.correlation`,
/// `.rotation`, `.velocity` and `[[view.NAME.body]]`. A missing key has its default, not the value of the first camera. A
/// view without bodies is filmed and recorded, but not measured. Triggers are those of the first camera.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The name in recordings, tables and `--camera`: 1 to 16 of `a-z 0-9 _ -`.
    pub name: String,
    /// The camera as a separate rig, named after the whole rig, `-` and the view.
    pub config: Config,
}

/// The maximum number of views.
const MAX_VIEWS: usize = 8;
/// The maximum length of a view's name, bytes.
const MAX_NAME_CHARACTERS: usize = 16;
/// The tables that a view shares with the first camera's.
pub(super) const TABLES: [&str; 8] =
    ["camera", "scale", "surface", "calibration", "body", "correlation", "rotation", "velocity"];

/// Checks the views and derives a rig from each. `whole` is the checked rig of the first camera.
pub(super) fn check_views(
    file: &Text<'_>,
    raw: BTreeMap<String, RawView>,
    whole: &Config,
) -> Result<Vec<View>, ConfigError> {
    if raw.len() > MAX_VIEWS {
        return Err(file.refuse("view", format!("at most {MAX_VIEWS} tables")));
    }
    let mut views = Vec::new();
    for (name, raw) in raw {
        let rig = format!("{}-{name}", whole.rig.name);
        if !is_name(&name, MAX_NAME_CHARACTERS) || rig.len() > MAX_RIG_NAME_CHARACTERS {
            let allowed = format!(
                "named with 1 to {MAX_NAME_CHARACTERS} of the characters a-z 0-9 _ -, and at most \
                 {MAX_RIG_NAME_CHARACTERS} together with rig.name"
            );
            return Err(file.refuse(&format!("view.{}", super::text::path_name(&name)), allowed));
        }
        let worker_count = raw.body.is_empty().then_some(0);
        // This check reports errors with their line in the file.
        CameraSettings::new(&file.within(&format!("view.{name}.")), raw)?;
        let text = view_rig_text(whole, &name, &rig, worker_count);
        let config = Config::parse(&text, &format!("{} [view.{name}]", whole.origin))?;
        views.push(View { name, config });
    }
    Ok(views)
}

/// Returns the rig file of the view `name`, whose rig is called `rig`.
///
/// It has the view's own tables, and the recorder and the workers of the whole rig, with `worker_count` workers if that
/// is given. Shots are those of the whole rig: its hardware line, or requests with its times around them.
fn view_rig_text(whole: &Config, name: &str, rig: &str, worker_count: Option<i64>) -> String {
    // The text was parsed before, so it parses again.
    let document = whole.text.parse::<DocumentMut>().unwrap_or_default();
    let own = document.get("view").and_then(|views| views.get(name));
    let mut view = DocumentMut::new();
    let table = |entries: &[(&str, toml_edit::Value)]| {
        let mut table = Table::new();
        entries.iter().for_each(|(key, entry)| drop(table.insert(key, value(entry.clone()))));
        Item::Table(table)
    };
    view.insert("rig", table(&[("name", rig.into())]));
    for key in TABLES {
        if let Some(item) = own.and_then(|own| own.get(key)) {
            view.insert(key, item.clone());
        }
    }
    let trigger = &whole.trigger;
    let entries: &[(&str, toml_edit::Value)] = match trigger.mode {
        TriggerMode::Off => &[],
        TriggerMode::Hardware => &[("mode", "hardware".into()), ("silence_s", trigger.silence_s.into())],
        _ => &[("mode", "software".into()), ("pre_s", trigger.pre_s.into()), ("post_s", trigger.post_s.into())],
    };
    if !entries.is_empty() {
        view.insert("trigger", table(entries));
    }
    for key in ["record", "workers"] {
        if let Some(item) = document.get(key) {
            view.insert(key, item.clone());
        }
    }
    if let Some(count) = worker_count
        && let Some(workers) = view.entry("workers").or_insert_with(|| table(&[])).as_table_like_mut()
    {
        workers.insert("count", value(count));
    }
    view.to_string()
}
