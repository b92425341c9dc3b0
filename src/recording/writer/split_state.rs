//! The state of a recording that continues in a next file when one is full.

use super::{RecordingInfo, RecordingWriter, WriterOptions};
use crate::recording::container::MESSAGE_OVERHEAD_BYTES;
use crate::recording::{CONTINUED_NAME, RecordingError, part_file, split};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Size of the end of a file: repeated schemas and channels, index of the chunks, bytes.
const END_BYTES: u64 = 64 << 10;

/// The state that a recording needs to continue in a next file.
pub(super) struct SplitState {
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

impl SplitState {
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

    /// Returns the description of the current file.
    pub(super) fn info(&self) -> RecordingInfo {
        let mut info = self.info.clone();
        split::insert(&mut info.metadata, self.number, &self.first);
        info
    }

    /// Returns the path of the first file.
    pub(super) fn first(&self) -> &Path {
        &self.first
    }

    /// Counts a message with `bytes` of data as written, with its share of headers and index.
    pub(super) fn add(&mut self, bytes: usize) {
        self.expected_bytes += bytes as u64 + MESSAGE_OVERHEAD_BYTES;
    }

    /// Whether the current file with another `bytes` exceeds the maximum size of a file.
    fn is_full_with(&self, bytes: u64) -> bool {
        self.expected_bytes + bytes > self.bytes
    }
}

impl RecordingWriter {
    /// Continues in a next file when the current one has messages and no room for `bytes` more. A recording that is not
    /// split has always room.
    pub(super) fn make_room(&mut self, bytes: u64) -> Result<(), RecordingError> {
        // A message that exceeds the size of a file gets a file of its own.
        let is_full = self.split.as_ref().is_some_and(|split| split.is_full_with(bytes));
        if is_full && self.has_messages { self.continue_in_next_file() } else { Ok(()) }
    }

    /// Completes the current file with a note of its successor, and starts the next one.
    fn continue_in_next_file(&mut self) -> Result<(), RecordingError> {
        let Some(number) = self.split.as_ref().map(|split| split.number + 1) else { return Ok(()) };
        let Some(next) = self.split.as_ref().map(|split| split::numbered(&split.first, number)) else { return Ok(()) };
        self.flush()?;
        self.write_metadata(CONTINUED_NAME, BTreeMap::from([("file".into(), split::file_name(&next))]))?;
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
