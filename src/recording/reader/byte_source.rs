//! Access to parts of a file that may be cut off, damaged or hostile.

use bytes::Bytes;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;

/// Bytes read around a position. Large records are skipped, not read.
const WINDOW_BYTES: usize = 2 << 10;

/// The reason why a part of a file cannot be read.
#[derive(Debug)]
pub(super) enum Unreadable {
    /// The operating system returned an error.
    Io(io::Error),
    /// The content is damaged, with a description.
    Damaged(String),
}

impl From<io::Error> for Unreadable {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// A range of bytes: a part of the file, or a decompressed chunk.
#[derive(Debug)]
pub(super) enum Source {
    /// `bytes` of the file from `offset` on.
    File {
        /// Its offset in the file.
        offset: u64,
        /// Its length.
        bytes: u64,
    },
    /// Bytes in memory.
    Memory(Bytes),
}

impl Source {
    /// Returns the number of bytes.
    pub(super) fn len(&self) -> u64 {
        match self {
            Self::File { bytes, .. } => *bytes,
            Self::Memory(bytes) => bytes.len() as u64,
        }
    }

    /// Reads `count` bytes at `at`, which counts from the start of the range.
    ///
    /// # Errors
    ///
    /// `UnexpectedEof` when they reach beyond the end.
    pub(super) fn read(&self, file: &File, at: u64, count: u64) -> io::Result<Bytes> {
        let end = at.checked_add(count).filter(|end| *end <= self.len()).ok_or(ErrorKind::UnexpectedEof)?;
        match self {
            Self::File { offset, .. } => {
                let mut buffer = vec![0; usize::try_from(count).map_err(io::Error::other)?];
                file.read_exact_at(&mut buffer, offset + at)?;
                Ok(buffer.into())
            }
            // The cast is exact: `end` is at most the length of bytes in memory.
            Self::Memory(bytes) => Ok(bytes.slice(at as usize..end as usize)),
        }
    }
}

/// Reads few bytes at a time without a system call for each.
#[derive(Debug)]
pub(super) struct Window<'a> {
    file: &'a File,
    source: &'a Source,
    at: u64,
    buffer: Bytes,
}

impl<'a> Window<'a> {
    /// Returns a window that has read nothing yet.
    pub(super) fn new(file: &'a File, source: &'a Source) -> Self {
        Self { file, source, at: 0, buffer: Bytes::new() }
    }

    /// Returns `count` bytes at `at`, which counts from the start of the source, or fewer at its end.
    pub(super) fn peek(&mut self, at: u64, count: usize) -> io::Result<&[u8]> {
        let remaining = self.source.len().saturating_sub(at);
        let count = (count as u64).min(remaining);
        let inside = at >= self.at && at + count <= self.at + self.buffer.len() as u64;
        if !inside {
            self.buffer = self.source.read(self.file, at, remaining.min(count.max(WINDOW_BYTES as u64)))?;
            self.at = at;
        }
        let start = (at - self.at) as usize;
        Ok(&self.buffer[start..start + count as usize])
    }
}
