//! The part file: a recording under a temporary name until it is complete.

use super::RecordingError;
use rustix::fs::{FallocateFlags, fallocate};
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, IoSlice, Write};
use std::ops::RangeInclusive;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Bounds of a reservation, bytes. Each reservation is as large as everything before it, within these bounds.
const STEPS_BYTES: RangeInclusive<u64> = 1 << 20..=64 << 20;

/// The open part file. After a failed write it refuses further ones, so that its content has no hole.
pub(super) struct PartFile {
    file: File,
    is_broken: bool,
    /// Bytes appended.
    length: u64,
    /// Bytes reserved on the disk; `None` where the file system cannot reserve.
    reserved: Option<u64>,
}

impl PartFile {
    /// Creates a part file from an empty file that is open for writing.
    pub(super) fn new(file: File) -> Self {
        Self { file, is_broken: false, length: 0, reserved: Some(0) }
    }

    /// Reserves disk space for the next `bytes` and more, without growing the file.
    ///
    /// A write into reserved space takes three quarters of the time, since it allocates no blocks. Without space, or on
    /// a file system that cannot reserve, writes continue without a reservation.
    fn reserve(&mut self, bytes: usize) {
        let Some(reserved) = self.reserved else { return };
        let wanted = self.length + bytes as u64;
        if wanted > reserved {
            let step = reserved.clamp(*STEPS_BYTES.start(), *STEPS_BYTES.end()).max(wanted - reserved);
            let made = fallocate(&self.file, FallocateFlags::KEEP_SIZE, reserved, step);
            self.reserved = made.is_ok().then_some(reserved + step);
        }
    }

    /// Runs an action on the file, and refuses further ones after an error other than an interruption.
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
    /// Appends two pieces without a copy, in one system call where the system takes both.
    pub(super) fn append(&mut self, head: &[u8], body: &[u8]) -> io::Result<()> {
        self.reserve(head.len() + body.len());
        let mut pieces = [IoSlice::new(head), IoSlice::new(body)];
        let mut pieces = &mut pieces[..];
        // Drops empty pieces.
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

    /// Overwrites bytes of the file, which stays as long as it is.
    pub(super) fn replace(&mut self, bytes: &[u8], at: u64) -> io::Result<()> {
        self.attempt(|file| file.write_all_at(bytes, at))
    }
}

impl Drop for PartFile {
    /// Releases the unused part of the reservation.
    fn drop(&mut self) {
        let _ = self.file.set_len(self.length);
    }
}

/// Whether the name `part` still refers to the open file `handle`. A removed file would take bytes that nobody can
/// read.
pub(super) fn is_in_place(part: &Path, handle: &File) -> bool {
    let same = |named: fs::Metadata, open: fs::Metadata| (named.dev(), named.ino()) == (open.dev(), open.ino());
    part.symlink_metadata().is_ok_and(|named| handle.metadata().is_ok_and(|open| same(named, open)))
}

/// Returns the name of an unfinished recording: `shot.mcap` is written as `shot.mcap.part`.
pub fn part_path(path: &Path) -> PathBuf {
    with_ending(path, ".part")
}

/// Returns the name of an unfinished recovered recording. The part file it comes from may have the usual one.
pub(super) fn recovering_path(path: &Path) -> PathBuf {
    with_ending(path, ".recovering")
}

/// Appends an ending to the name of a file.
fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

/// Creates `part`, the unfinished form of `path`, and opens it for writing.
///
/// # Errors
///
/// [`RecordingError::Refused`] when either file exists; [`RecordingError::Io`] when the system fails.
pub(super) fn create(path: &Path, part: &Path) -> Result<File, RecordingError> {
    if path.symlink_metadata().is_ok() {
        return Err(RecordingError::refused(
            path,
            "the file exists, and a recording is never overwritten; choose another name",
        ));
    }
    OpenOptions::new().write(true).create_new(true).open(part).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => {
            RecordingError::refused(part, "an unfinished recording of this name exists; recover or move it first")
        }
        std::io::ErrorKind::NotFound => RecordingError::refused(path, "its folder does not exist; create it first"),
        _ => RecordingError::io("create", part, error),
    })
}

/// Renames a complete, synced part file to its final name, without replacing another file, and syncs the directory.
///
/// # Errors
///
/// [`RecordingError`] when the name is taken or the system fails; the part file stays.
pub(super) fn publish(path: &Path, part: &Path) -> Result<(), RecordingError> {
    match fs::hard_link(part, path) {
        Ok(()) => fs::remove_file(part).map_err(|error| RecordingError::io("remove", part, error))?,
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
            return Err(RecordingError::refused(
                path,
                format!("the file appeared meanwhile; the complete recording is {}", part.display()),
            ));
        }
        // Some file systems have no hard links (FAT, some network shares).
        Err(_) if path.symlink_metadata().is_err() => {
            fs::rename(part, path).map_err(|error| RecordingError::io("rename", part, error))?;
        }
        Err(error) => return Err(RecordingError::io("rename", part, error)),
    }
    sync_directory(path)
}

/// Syncs the directory of the file `path`, so that the new name survives a power cut.
fn sync_directory(path: &Path) -> Result<(), RecordingError> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    File::open(directory)
        .and_then(|handle| handle.sync_all())
        .map_err(|error| RecordingError::io("sync directory", directory, error))
}
