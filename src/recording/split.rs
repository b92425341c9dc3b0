//! The names of a recording that is split into several files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The entry of the metadata record `ricochet` with the number of the file, from 0.
const NUMBER_KEY: &str = "part";
/// The entry of the metadata record `ricochet` with the name of the first file.
const NAME_KEY: &str = "part_of";

/// Adds the entries of file `number` of the recording whose first file is `first`.
pub(super) fn insert(entries: &mut BTreeMap<String, String>, number: u32, first: &Path) {
    entries.insert(NUMBER_KEY.into(), number.to_string());
    entries.insert(NAME_KEY.into(), file_name(first));
}

/// Removes the entries that [`insert`] adds.
pub(super) fn remove(entries: &mut BTreeMap<String, String>) {
    entries.remove(NUMBER_KEY);
    entries.remove(NAME_KEY);
}

/// Returns the path of file `number` of the recording whose first file, number 0, is `first`: `shot.mcap` continues in
/// `shot_0001.mcap`.
pub(super) fn numbered(first: &Path, number: u32) -> PathBuf {
    let stem = first.file_stem().unwrap_or_default().to_string_lossy();
    let ending = first.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
    first.with_file_name(format!("{stem}_{number:04}{ending}"))
}

/// Returns the name of the first file of a split recording, when the entries belong to that first file; else `None`.
pub(super) fn first_name(entries: &BTreeMap<String, String>) -> Option<&str> {
    entries.get(NAME_KEY).filter(|name| is_part(entries, 0, name)).map(String::as_str)
}

/// Whether the entries belong to file `number` of the split recording whose first file was named `name`.
pub(super) fn is_part(entries: &BTreeMap<String, String>, number: u32, name: &str) -> bool {
    let of = |key: &str| entries.get(key).map(String::as_str);
    of(NUMBER_KEY) == Some(number.to_string().as_str()) && of(NAME_KEY) == Some(name)
}

/// Returns the file name of a path, with bytes that are no UTF-8 replaced; empty without one.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
