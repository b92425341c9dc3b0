//! The file while it is being written: a name of its own until it is whole.

use super::RecordingError;
use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};

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
