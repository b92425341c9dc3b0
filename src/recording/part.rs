//! The file while it is being written: a name of its own until it is whole.

use super::RecordingError;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The open part file. After a write that failed it takes nothing more: what lies in it has no hole.
pub(super) struct PartFile {
    file: File,
    is_broken: bool,
}

impl PartFile {
    pub(super) fn new(file: File) -> Self {
        Self { file, is_broken: false }
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

impl Write for PartFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.attempt(|file| file.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt(File::flush)
    }
}

impl Seek for PartFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.attempt(|file| file.seek(to))
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
