//! Claims, which give each role of a rig to one process at a time.

use super::{BusError, runtime};
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The time between two tries to take a role.
const PAUSE: Duration = Duration::from_millis(10);
/// The minimum number of tries. A process that only asks for the holder has the lock for a few microseconds.
const MIN_TRIES: u128 = 5;

/// A role that is taken until this is dropped or the process ends, however it ends.
///
/// It is a locked file in a private folder. The system releases the lock of a process that was killed.
#[derive(Debug)]
pub(super) struct Claim {
    _file: File,
    path: PathBuf,
}

impl Claim {
    /// Takes the role that the lock file at `path` stands for, and writes this process's id into it.
    ///
    /// Waits for the process that has the role until `timeout`, but makes at least [`MIN_TRIES`] tries, [`PAUSE`]
    /// apart. `None` if that process keeps it.
    ///
    /// # Errors
    ///
    /// [`BusError::Folder`] if the file cannot be opened or written.
    pub(super) fn take(path: &Path, timeout: Duration) -> Result<Option<Self>, BusError> {
        let fail = |error: std::io::Error| BusError::Folder { path: path.to_owned(), reason: error.to_string() };
        for attempt in 0..(timeout.as_millis() / PAUSE.as_millis()).max(MIN_TRIES) {
            if attempt > 0 {
                std::thread::sleep(PAUSE);
            }
            let mut file = runtime::open_file(path).map_err(fail)?;
            if file.try_lock().is_err() || !is_at(&file, path) {
                continue;
            }
            file.set_len(0).and_then(|()| write!(file, "{}", std::process::id())).map_err(fail)?;
            return Ok(Some(Self { _file: file, path: path.to_owned() }));
        }
        Ok(None)
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // Removed while it is still locked. Another process that has opened it already finds that it is not there.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Whether the path still leads to this open file (the same device and inode), and not to a later one of its name.
fn is_at(file: &File, path: &Path) -> bool {
    let inode = |found: std::fs::Metadata| (found.dev(), found.ino());
    file.metadata().map(inode).ok() == path.metadata().map(inode).ok()
}

/// Returns the id of the process that has taken the role of the lock file at `path`, 0 while it takes it.
///
/// `None` if no process has, or the file cannot be read.
pub(super) fn holder_pid(path: &Path) -> Option<u32> {
    let mut file = File::open(path).ok()?;
    if file.try_lock_shared().is_ok() {
        return None;
    }
    let mut text = String::new();
    file.rewind().and_then(|()| file.read_to_string(&mut text)).ok()?;
    // A process that is just taking it has not written its number yet.
    Some(text.parse().unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_is_taken_once_and_free_again_when_it_is_given_up() {
        let folder = std::env::temp_dir().join(format!("ricochet-claim-{}", std::process::id()));
        runtime::ensure_private(&folder).unwrap();
        let path = folder.join("track");
        let first = Claim::take(&path, Duration::ZERO).unwrap();
        assert!(first.is_some() && holder_pid(&path) == Some(std::process::id()));
        assert!(Claim::take(&path, Duration::from_millis(30)).unwrap().is_none());
        assert!(Claim::take(&folder.join("record"), Duration::ZERO).unwrap().is_some());
        drop(first);
        assert_eq!(holder_pid(&path), None);
        assert!(Claim::take(&path, Duration::ZERO).unwrap().is_some());
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0, "nothing is left");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
