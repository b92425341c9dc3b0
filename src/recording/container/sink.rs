//! The file with the bytes that are buffered for the next write.

use crate::recording::part_file::PartFile;
use std::io;

/// The maximum alignment of writes, bytes.
///
/// The system caches an aligned write in pages as large as its alignment allows. Large pages take three quarters of the
/// time.
const MAX_UNIT_BYTES: usize = 256 << 10;
/// The minimum alignment of writes, bytes.
const MIN_UNIT_BYTES: usize = 4 << 10;
/// Maximum number of buffered bytes: the end of a body, and small records after it.
const PENDING_BYTES: usize = MAX_UNIT_BYTES + (64 << 10);

/// The part file and the bytes buffered for its next write.
pub(super) struct Sink {
    file: PartFile,
    pending: Vec<u8>,
    /// Bytes appended so far, buffered ones included.
    position: u64,
}

impl Sink {
    /// Starts at the beginning of an empty file.
    pub(super) fn new(file: PartFile) -> Self {
        Self { file, pending: Vec::with_capacity(PENDING_BYTES), position: 0 }
    }

    /// Returns the offset of the next byte in the file.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// Returns the number of buffered bytes.
    pub(super) fn buffered_bytes(&self) -> usize {
        self.pending.len()
    }

    /// Appends a few bytes, which are buffered, or written with the buffer if that has no room for them.
    pub(super) fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.pending.len() + bytes.len() > PENDING_BYTES {
            return self.write(bytes);
        }
        self.buffer(bytes);
        Ok(())
    }

    /// Appends many bytes without a copy. Only those after the last aligned offset are buffered. The alignment is the
    /// largest power of two that `bytes` fill, from [`MIN_UNIT_BYTES`] to [`MAX_UNIT_BYTES`].
    pub(super) fn put_through(&mut self, bytes: &[u8]) -> io::Result<()> {
        let unit = 1 << bytes.len().max(1).ilog2();
        let unit = u64::clamp(unit, MIN_UNIT_BYTES as u64, MAX_UNIT_BYTES as u64);
        let cut = (self.position + bytes.len() as u64) / unit * unit;
        let Some(now) = cut.checked_sub(self.position) else { return self.put(bytes) };
        let (now, later) = bytes.split_at(now as usize);
        self.write(now)?;
        self.put(later)
    }

    /// Overwrites bytes that were appended before, from offset `at` of the file on.
    pub(super) fn replace(&mut self, bytes: &[u8], at: u64) -> io::Result<()> {
        let written = self.position - self.pending.len() as u64;
        if let Some(from) = at.checked_sub(written) {
            self.pending[from as usize..][..bytes.len()].copy_from_slice(bytes);
            return Ok(());
        }
        if at + bytes.len() as u64 > written {
            self.flush()?;
        }
        self.file.replace(bytes, at)
    }

    /// Writes everything that is buffered.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.write(&[])
    }

    /// Appends bytes to the buffer alone. The caller has checked that there is room for them.
    fn buffer(&mut self, bytes: &[u8]) {
        self.position += bytes.len() as u64;
        self.pending.extend_from_slice(bytes);
    }

    /// Appends bytes and writes them with everything buffered before them.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.append(&self.pending, bytes)?;
        self.position += bytes.len() as u64;
        self.pending.clear();
        Ok(())
    }
}
