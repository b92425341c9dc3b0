//! The file, with what waits for the next write.

use crate::recording::part_file::PartFile;
use std::io;

/// Pages of this size are the largest that a write is cut at; the system keeps what it writes in pages as large as the
/// place of a write allows, and large ones take it a quarter less time.
const UNIT_BYTES: usize = 256 << 10;
const LEAST_UNIT_BYTES: usize = 4 << 10;
/// Most bytes that wait: what a body leaves behind, and small records after it.
const PENDING_BYTES: usize = UNIT_BYTES + (64 << 10);

pub(super) struct Sink {
    file: PartFile,
    pending: Vec<u8>,
    /// Bytes put so far.
    position: u64,
}

impl Sink {
    pub(super) fn new(file: PartFile) -> Self {
        Self { file, pending: Vec::with_capacity(PENDING_BYTES), position: 0 }
    }

    /// Where the next byte comes to stand in the file.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// How many of the last bytes the system has not got yet.
    pub(super) fn buffered_bytes(&self) -> usize {
        self.pending.len()
    }

    /// Appends few bytes, which wait for those that follow.
    pub(super) fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.pending.len() + bytes.len() > PENDING_BYTES {
            return self.write(bytes);
        }
        self.keep(bytes);
        Ok(())
    }

    /// Appends many bytes from where they are; fewer than they are wait, up to where the next write should begin.
    pub(super) fn put_through(&mut self, bytes: &[u8]) -> io::Result<()> {
        let unit = 1 << bytes.len().max(1).ilog2();
        let unit = u64::clamp(unit, LEAST_UNIT_BYTES as u64, UNIT_BYTES as u64);
        let cut = (self.position + bytes.len() as u64) / unit * unit;
        let Some(now) = cut.checked_sub(self.position) else { return self.put(bytes) };
        let (now, later) = bytes.split_at(now as usize);
        self.write(now)?;
        self.put(later)
    }

    /// Puts others in the place of bytes that were appended before.
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

    /// Hands everything to the system.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.write(&[])
    }

    fn keep(&mut self, bytes: &[u8]) {
        self.position += bytes.len() as u64;
        self.pending.extend_from_slice(bytes);
    }

    /// Appends bytes and hands them to the system with everything in front of them.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.append(&self.pending, bytes)?;
        self.position += bytes.len() as u64;
        self.pending.clear();
        Ok(())
    }
}
