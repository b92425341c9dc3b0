//! The file while it is being written: a name of its own until it is whole.

use super::RecordingError;
use rustix::fs::{FallocateFlags, fallocate};
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, IoSlice, Write};
use std::ops::RangeInclusive;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Room is asked for in steps of what a file has already, in these bounds, bytes.
const STEPS_BYTES: RangeInclusive<u64> = 1 << 20..=64 << 20;

/// The open part file. After a write that failed it takes nothing more: what lies in it has no hole.
pub(super) struct PartFile {
    file: File,
    is_broken: bool,
    /// Bytes appended.
    length: u64,
    /// Bytes that have room on the disk already; `None` where that cannot be had.
    reserved: Option<u64>,
}

impl PartFile {
    pub(super) fn new(file: File) -> Self {
        Self { file, is_broken: false, length: 0, reserved: Some(0) }
    }

    /// Has room made for what comes, which is not part of the file yet.
    ///
    /// Then a write need not look for room block by block, which takes it a quarter of its time. Where the disk has too
    /// little room, or the file system cannot do it, writes go on without.
    fn reserve(&mut self, bytes: usize) {
        let Some(reserved) = self.reserved else { return };
        let wanted = self.length + bytes as u64;
        if wanted > reserved {
            let step = reserved.clamp(*STEPS_BYTES.start(), *STEPS_BYTES.end()).max(wanted - reserved);
            let made = fallocate(&self.file, FallocateFlags::KEEP_SIZE, reserved, step);
            self.reserved = made.is_ok().then_some(reserved + step);
        }
    }

    fn attempt<T>(&mut self, action: impl FnOnce(&mut File) -> io::Result<T>) -> io::Result<T> {
        if self.is_broken {
            return Err(io::Error::other("an earlier write failed"));
        }
        let outcome = action(&mut self.file);
        self.is_broken = outcome.as_ref().is_err_and(|error| error.kind() != ErrorKind::Interrupted);
        outcome
    }
}

impl PartFile {
    /// Appends two pieces, the second from where it is, in one call of the system where it takes both.
    pub(super) fn append(&mut self, head: &[u8], body: &[u8]) -> io::Result<()> {
        self.reserve(head.len() + body.len());
        let mut pieces = [IoSlice::new(head), IoSlice::new(body)];
        let mut pieces = &mut pieces[..];
        // Empty ones go.
        IoSlice::advance_slices(&mut pieces, 0);
        while !pieces.is_empty() {
            let written = self.attempt(|file| match file.write_vectored(pieces) {
                Ok(0) => Err(ErrorKind::WriteZero.into()),
                outcome => outcome,
            });
            match written {
                Ok(count) => {
                    self.length += count as u64;
                    IoSlice::advance_slices(&mut pieces, count);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Writes over bytes that are there already.
    pub(super) fn replace(&mut self, bytes: &[u8], at: u64) -> io::Result<()> {
        self.attempt(|file| file.write_all_at(bytes, at))
    }
}

impl Drop for PartFile {
    /// Gives back the room that was not needed.
    fn drop(&mut self) {
        let _ = self.file.set_len(self.length);
    }
}

/// Whether the name still leads to the open file; a removed file goes on taking bytes that no one will see.
pub(super) fn is_in_place(part: &Path, handle: &File) -> bool {
    let same = |named: fs::Metadata, open: fs::Metadata| (named.dev(), named.ino()) == (open.dev(), open.ino());
    part.symlink_metadata().is_ok_and(|named| handle.metadata().is_ok_and(|open| same(named, open)))
}

/// The name a recording has until it is finished: `shot.mcap` is written as `shot.mcap.part`.
pub fn part_path(path: &Path) -> PathBuf {
    with_ending(path, ".part")
}

/// The name a recovered recording has until it is finished; the part file it comes from may have the other one.
pub(super) fn recovering_path(path: &Path) -> PathBuf {
    with_ending(path, ".recovering")
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

/// Creates `part`, the unfinished form of `path`; neither may exist.
pub(super) fn create(path: &Path, part: &Path) -> Result<File, RecordingError> {
    if path.symlink_metadata().is_ok() {
        return Err(RecordingError::refused(path, "the file exists, and recordings are never overwritten"));
    }
    OpenOptions::new().write(true).create_new(true).open(part).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => {
            RecordingError::refused(part, "an unfinished recording of this name exists; recover or move it first")
        }
        _ => RecordingError::io("create", part, error),
    })
}

/// Gives a written, synced part file its final name, without ever replacing another file.
pub(super) fn publish(path: &Path, part: &Path) -> Result<(), RecordingError> {
    match fs::hard_link(part, path) {
        Ok(()) => fs::remove_file(part).map_err(|error| RecordingError::io("remove", part, error))?,
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
            return Err(RecordingError::refused(
                path,
                format!("the file appeared meanwhile; the recording is whole in {}", part.display()),
            ));
        }
        // File systems without hard links (FAT, some network shares).
        Err(_) if path.symlink_metadata().is_err() => {
            fs::rename(part, path).map_err(|error| RecordingError::io("rename", part, error))?;
        }
        Err(error) => return Err(RecordingError::io("rename", part, error)),
    }
    sync_directory(path)
}

/// Makes the new name itself survive a power cut.
fn sync_directory(path: &Path) -> Result<(), RecordingError> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    File::open(directory)
        .and_then(|handle| handle.sync_all())
        .map_err(|error| RecordingError::io("sync directory", directory, error))
}
