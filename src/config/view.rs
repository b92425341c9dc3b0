//! `[view.NAME]`: further cameras that film the same shots.

use super::error::ConfigError;
use super::raw::RawView;
use super::text::Text;
use super::{Config, Picture, TriggerMode};
use std::collections::BTreeMap;
use toml_edit::{DocumentMut, Item, Table, value};

/// `[view.NAME]`: a further camera, with tables of its own: `[view.NAME.camera]`, which must be given, and
/// `[view.NAME.scale]`, `.surface`, `.calibration`, `.correlation`, `.rotation`, `.velocity` and `[[view.NAME.body]]`.
///
/// Nothing of them is taken from the first camera: what is left out has its default. A view without bodies is filmed
/// and recorded, but not measured. Triggers are those of the first camera.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// 1 to 16 of `a-z 0-9 _ -`; what recordings, tables and `--camera` call it.
    pub name: String,
    /// The camera as a rig of its own: its name is that of the whole rig, `-` and the name of the view.
    pub config: Config,
}

const VIEWS_MAX: usize = 8;
const NAME_MAX: usize = 16;
const RIG_NAME_MAX: usize = 32;
/// Tables that a view may have, as the first camera has them.
const TABLES: [&str; 8] = ["camera", "scale", "surface", "calibration", "body", "correlation", "rotation", "velocity"];

/// Checks the views and makes a rig of each.
pub(super) fn views(file: &Text<'_>, raw: BTreeMap<String, RawView>, whole: &Config) -> Result<Vec<View>, ConfigError> {
    if raw.len() > VIEWS_MAX {
        return Err(file.refuse("view", format!("at most {VIEWS_MAX} tables")));
    }
    let mut views = Vec::new();
    for (name, raw) in raw {
        let letter = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"_-".contains(&byte);
        let rig = format!("{}-{name}", whole.rig.name);
        if !((1..=NAME_MAX).contains(&name.len()) && name.bytes().all(letter) && rig.len() <= RIG_NAME_MAX) {
            let allowed = format!(
                "named with 1 to {NAME_MAX} of the characters a-z 0-9 _ -, and at most {RIG_NAME_MAX} together with \
                 rig.name"
            );
            return Err(file.refuse(&format!("view.{}", super::text::path_name(&name)), allowed));
        }
        let is_measured = !raw.body.is_empty();
        // Checked where it stands, so that what is wrong is told with its place in the file.
        Picture::new(&file.within(&format!("view.{name}.")), raw)?;
        let text = text_of(whole, &name, &rig, is_measured);
        let config = Config::parse(&text, &format!("{} [view.{name}]", whole.origin))?;
        views.push(View { name, config });
    }
    Ok(views)
}

/// The rig file of one view.
fn text_of(whole: &Config, name: &str, rig: &str, is_measured: bool) -> String {
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
    if !is_measured && let Some(workers) = view.entry("workers").or_insert_with(|| table(&[])).as_table_like_mut() {
        workers.insert("count", value(0));
    }
    view.to_string()
}
