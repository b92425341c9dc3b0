//! A recording that goes on in a next file when one is full.

use super::writer::{RecordingInfo, RecordingWriter, WriterOptions};
use super::{CONTINUED_NAME, Recording, RecordingError, part};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Entries of the metadata record `ricochet`: which file of the recording this is, and what the first was called.
const NUMBER_KEY: &str = "part";
const NAME_KEY: &str = "part_of";
pub(super) const SPLIT_KEYS: [&str; 2] = [NUMBER_KEY, NAME_KEY];
/// What a message takes beside its bytes: header, index entry, its share of the chunk's.
pub(super) const MESSAGE_BYTES: u64 = 160;
/// What the end of a file takes: descriptions again, index of the chunks.
const END_BYTES: u64 = 64 << 10;

/// What is needed to go on in a next file.
pub(super) struct Split {
    bytes: u64,
    info: RecordingInfo,
    options: WriterOptions,
    first: PathBuf,
    number: u32,
    /// Files that are finished: bytes and frames in them.
    pub(super) finished_bytes: u64,
    pub(super) finished_frames: u64,
    /// Estimate from above of what the present file will take.
    expected_bytes: u64,
}

impl Split {
    /// Of a recording whose files may have this many bytes each.
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

    /// What the present file says of itself.
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

    /// Takes note of what is written.
    pub(super) fn add(&mut self, bytes: usize) {
        self.expected_bytes += bytes as u64 + MESSAGE_BYTES;
    }

    fn is_full_with(&self, bytes: u64) -> bool {
        self.expected_bytes + bytes > self.bytes
    }
}

impl RecordingWriter {
    /// Goes on in a next file when this one has no room for so many more bytes.
    pub(super) fn make_room(&mut self, bytes: u64) -> Result<(), RecordingError> {
        // A message that is larger than a file may be has one of its own.
        let is_full = self.split.as_ref().is_some_and(|split| split.is_full_with(bytes));
        if is_full && self.has_messages { self.go_on() } else { Ok(()) }
    }

    fn go_on(&mut self) -> Result<(), RecordingError> {
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
        self.begin(&next, part::part_path(&next), &options)?;
        self.describe(&info)
    }
}

/// The name of a later file: `shot.mcap` goes on in `shot_0001.mcap`.
pub(super) fn numbered(first: &Path, number: u32) -> PathBuf {
    let stem = first.file_stem().unwrap_or_default().to_string_lossy();
    let ending = first.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
    first.with_file_name(format!("{stem}_{number:04}{ending}"))
}

/// The files of the recording that begins in this one, as far as they are there; the first one first.
pub fn files_of(first: &Path) -> Vec<PathBuf> {
    let about = |path: &Path| Recording::peek_metadata(path).ok().flatten();
    let name = about(first).and_then(|entries| first_name(&entries).map(str::to_owned));
    let Some(name) = name else { return vec![first.to_path_buf()] };
    let later = (1..).map(|number| (number, numbered(first, number)));
    let belongs = |(number, path): &(u32, PathBuf)| about(path).is_some_and(|found| is_part(&found, *number, &name));
    std::iter::once(first.to_path_buf()).chain(later.take_while(belongs).map(|(_, path)| path)).collect()
}

/// The name that the files share, when these entries are of the first of several.
pub(super) fn first_name(entries: &BTreeMap<String, String>) -> Option<&str> {
    entries.get(NAME_KEY).filter(|name| is_part(entries, 0, name)).map(String::as_str)
}

/// Whether these entries are of file `number` of the recording whose first was called `name`.
pub(super) fn is_part(entries: &BTreeMap<String, String>, number: u32, name: &str) -> bool {
    let of = |key: &str| entries.get(key).map(String::as_str);
    of(NUMBER_KEY) == Some(number.to_string().as_str()) && of(NAME_KEY) == Some(name)
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
