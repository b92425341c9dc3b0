//! The reference of the rig file: each table and key with its meaning, range and default.

use super::key::{Key, Section};
use super::raw::SECTIONS;
use super::text::nearest;
use serde_json::{Map, Value, json};
use std::fmt::Write;

/// The tables that one camera has, and so a `[view.NAME]` too.
const VIEW_TABLES: [&str; 8] = super::view::TABLES;

/// A table or key of the reference.
#[derive(Debug, Clone, Copy)]
pub enum Entry {
    /// A table.
    Section(&'static Section),
    /// A key of a table.
    Key(&'static Section, &'static Key),
}

/// Returns the tables of the rig file.
///
/// ```
/// let body = ricochet::config::reference().iter().find(|section| section.path == "body").unwrap();
/// let diameter = body.keys.iter().find(|key| key.name == "diameter_mm").unwrap();
/// assert_eq!(diameter.allowed, "above 0 and at most 10000 mm");
/// ```
pub fn reference() -> &'static [Section] {
    SECTIONS
}

/// Finds a table by its name, or a key as `TABLE.KEY`, with or without brackets, and within a `view.NAME`.
///
/// A key without its table is found if one table alone has it.
///
/// # Errors
///
/// The most similar name if there is none.
pub fn find(name: &str) -> Result<Entry, String> {
    let plain: String = name.chars().filter(|letter| !"[]".contains(*letter)).collect();
    let within =
        plain.strip_prefix("view.").and_then(|rest| rest.split_once('.')).map_or(plain.as_str(), |(_, key)| key);
    let path = |section: &Section, key: &Key| format!("{}.{}", section.path, key.name);
    for section in SECTIONS {
        if section.path == within {
            return Ok(Entry::Section(section));
        }
        if let Some(key) = section.keys.iter().find(|key| path(section, key) == within) {
            return Ok(Entry::Key(section, key));
        }
    }
    let mut named = SECTIONS.iter().flat_map(|section| section.keys.iter().map(move |key| (section, key)));
    // A key without its table is clear if one table alone has it.
    let mut alone = named.clone().filter(|(_, key)| key.name == within);
    if let (Some((section, key)), None) = (alone.next(), alone.next()) {
        return Ok(Entry::Key(section, key));
    }
    let sections = SECTIONS.iter().map(|section| section.path.to_owned());
    let known: Vec<String> = sections.chain(named.by_ref().map(|(section, key)| path(section, key))).collect();
    Err(nearest(within, known.iter().map(String::as_str)).to_owned())
}

/// Returns the JSON Schema of the rig file, draft 2020-12, for editors.
pub fn schema() -> Value {
    let tables = |sections: &mut dyn Iterator<Item = &Section>| -> Map<String, Value> {
        sections.map(|section| (section.path.to_owned(), section.schema())).collect()
    };
    let view = json!({
        "type": "object", "additionalProperties": false,
        "properties": tables(&mut SECTIONS.iter().filter(|section| VIEW_TABLES.contains(&section.path))),
    });
    let mut properties = tables(&mut SECTIONS.iter());
    properties.insert(
        "view".into(),
        json!({ "type": "object", "description": "Further cameras, by name.", "additionalProperties": view }),
    );
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Rig file of ricochet",
        "type": "object", "properties": properties, "additionalProperties": false,
    })
}

/// Returns the reference as a page of Markdown.
pub fn to_markdown() -> String {
    let mut page = String::from(
        "# Configuration\n\nA rig file is TOML. Every key is optional unless its default says \"required\". \
         `ricochet config explain KEY` prints one\nentry, `ricochet config schema` prints a JSON Schema for editors, and \
         `ricochet init` writes a first file.\n\nFurther cameras have tables of their own, `[view.NAME.camera]` and so on, \
         with the same keys as the tables of the first:\n",
    );
    let views: Vec<String> = VIEW_TABLES.iter().map(|table| format!("`{table}`")).collect();
    let _ = writeln!(page, "{}.", views.join(", "));
    for section in SECTIONS {
        let _ = writeln!(page, "\n## `{}`\n\n{}\n", section.header(), section.about());
        let _ = writeln!(page, "| Key | Value | Default | Meaning |\n| --- | --- | --- | --- |");
        for key in section.keys {
            let (name, allowed) = (key.name, key.allowed);
            let _ = writeln!(page, "| `{name}` | {}: {allowed} | {} | {} |", key.value, key.default, key.meaning());
        }
    }
    page
}
