//! A recording that continues in a next file when one is full.

use super::writer::{RecordingInfo, RecordingWriter, WriterOptions};
use super::{CONTINUED_NAME, Recording, RecordingError, part_file};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Entries of the metadata record `ricochet`: the number of the file, and the name of the first file.
const NUMBER_KEY: &str = "part";
const NAME_KEY: &str = "part_of";
pub(super) const SPLIT_KEYS: [&str; 2] = [NUMBER_KEY, NAME_KEY];
/// Size of a message without its data: header, index entry, share of the chunk's header, bytes.
pub(super) const MESSAGE_BYTES: u64 = 160;
/// Size of the end of a file: repeated schemas and channels, index of the chunks, bytes.
const END_BYTES: u64 = 64 << 10;

/// The state that a recording needs to continue in a next file.
pub(super) struct Split {
    bytes: u64,
    info: RecordingInfo,
    options: WriterOptions,
    first: PathBuf,
    number: u32,
    /// Size and frames of the finished files.
    pub(super) finished_bytes: u64,
    pub(super) finished_frames: u64,
    /// An upper bound of the current file's size when it is finished.
    expected_bytes: u64,
}

impl Split {
    /// Prepares a recording whose files have at most `bytes` each.
    pub(super) fn new(path: &Path, bytes: u64, info: &RecordingInfo, options: &WriterOptions) -> Self {
        let first = path.to_path_buf();
        let (info, options) = (info.clone(), *options);
        Self {
            bytes,
            info,
            options,
            first,
            number: 0,
            finished_bytes: 0,
            finished_frames: 0,
            expected_bytes: END_BYTES,
        }
    }

    /// The description of the current file.
    pub(super) fn info(&self) -> RecordingInfo {
        let mut info = self.info.clone();
        info.metadata.insert(NUMBER_KEY.into(), self.number.to_string());
        info.metadata.insert(NAME_KEY.into(), name_of(&self.first));
        info
    }

    /// The first file.
    pub(super) fn first(&self) -> &Path {
        &self.first
    }

    /// Counts a message of `bytes` as written.
    pub(super) fn add(&mut self, bytes: usize) {
        self.expected_bytes += bytes as u64 + MESSAGE_BYTES;
    }

    fn is_full_with(&self, bytes: u64) -> bool {
        self.expected_bytes + bytes > self.bytes
    }
}

impl RecordingWriter {
    /// Continues in a next file when the current one has no room for `bytes` more.
    pub(super) fn make_room(&mut self, bytes: u64) -> Result<(), RecordingError> {
        // A message that exceeds the size of a file gets a file of its own.
        let is_full = self.split.as_ref().is_some_and(|split| split.is_full_with(bytes));
        if is_full && self.has_messages { self.continue_in_next_file() } else { Ok(()) }
    }

    fn continue_in_next_file(&mut self) -> Result<(), RecordingError> {
        let Some(number) = self.split.as_ref().map(|split| split.number + 1) else { return Ok(()) };
        let Some(next) = self.split.as_ref().map(|split| numbered(&split.first, number)) else { return Ok(()) };
        self.flush()?;
        self.metadata(CONTINUED_NAME, BTreeMap::from([("file".into(), name_of(&next))]))?;
        let (bytes, frames) = (self.complete()?, self.frames());
        let Some(split) = &mut self.split else { return Ok(()) };
        split.number = number;
        split.finished_bytes += bytes;
        split.finished_frames = frames;
        split.expected_bytes = END_BYTES;
        let (info, options) = (split.info(), split.options);
        self.begin_file(&next, part_file::part_path(&next), &options)?;
        self.describe(&info)
    }
}

/// Returns the name of a later file: `shot.mcap` continues in `shot_0001.mcap`.
pub(super) fn numbered(first: &Path, number: u32) -> PathBuf {
    let stem = first.file_stem().unwrap_or_default().to_string_lossy();
    let ending = first.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
    first.with_file_name(format!("{stem}_{number:04}{ending}"))
}

/// Returns the existing files of the recording that begins in `first`, in order.
pub fn files_of(first: &Path) -> Vec<PathBuf> {
    let about = |path: &Path| Recording::peek_metadata(path).ok().flatten();
    let name = about(first).and_then(|entries| first_name(&entries).map(str::to_owned));
    let Some(name) = name else { return vec![first.to_path_buf()] };
    let later = (1..).map(|number| (number, numbered(first, number)));
    let belongs = |(number, path): &(u32, PathBuf)| about(path).is_some_and(|found| is_part(&found, *number, &name));
    std::iter::once(first.to_path_buf()).chain(later.take_while(belongs).map(|(_, path)| path)).collect()
}

/// Returns the name of the first file of a split recording, when the entries belong to that first file.
pub(super) fn first_name(entries: &BTreeMap<String, String>) -> Option<&str> {
    entries.get(NAME_KEY).filter(|name| is_part(entries, 0, name)).map(String::as_str)
}

/// Whether the entries belong to file `number` of the split recording whose first file was named `name`.
pub(super) fn is_part(entries: &BTreeMap<String, String>, number: u32, name: &str) -> bool {
    let of = |key: &str| entries.get(key).map(String::as_str);
    of(NUMBER_KEY) == Some(number.to_string().as_str()) && of(NAME_KEY) == Some(name)
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
