//! Syncs a file to the disk while it is written, and drops it from the system's cache.

use rustix::fs::{Advice, fadvise};
use std::fs::File;
use std::io;
use std::num::NonZeroU64;
use std::thread::{Builder, JoinHandle};

/// Size of the end of a file that stays in the system's cache, bytes. A short recording stays there as a whole.
const CACHED_BYTES: u64 = 256 << 20;

/// The sync that is running in the background, so that the writer does not wait for the disk.
///
/// Only the end of a long recording stays in the system's cache, so that new data reuse the pages of old data. New
/// pages can cost several times the write itself, and they evict the pages of other programs. At most one sync runs at
/// a time, so the next one has only the data written meanwhile.
#[derive(Default)]
pub(super) struct DiskSync {
    running: Option<JoinHandle<io::Result<()>>>,
}

impl DiskSync {
    /// Waits for the previous sync, and starts one of everything written so far.
    ///
    /// # Errors
    ///
    /// The error of the previous sync, or one of starting a thread.
    pub(super) fn start(&mut self, file: &File) -> io::Result<()> {
        self.wait()?;
        let file = file.try_clone()?;
        self.running = Some(Builder::new().name("sync".into()).spawn(move || sync(&file))?);
        Ok(())
    }

    /// Waits for the running sync, if any.
    ///
    /// # Errors
    ///
    /// The error of that sync.
    pub(super) fn wait(&mut self) -> io::Result<()> {
        let outcome = self.running.take().map(JoinHandle::join);
        outcome.unwrap_or(Ok(Ok(()))).unwrap_or_else(|_| Err(io::Error::other("the sync panicked")))
    }
}

impl Drop for DiskSync {
    fn drop(&mut self) {
        let _ = self.wait();
    }
}

/// Syncs the data of a file, and drops all but its last [`CACHED_BYTES`] from the system's cache.
fn sync(file: &File) -> io::Result<()> {
    let written_bytes = file.metadata()?.len();
    file.sync_data()?;
    if let Some(front) = NonZeroU64::new(written_bytes.saturating_sub(CACHED_BYTES)) {
        // A failure costs cache, not data.
        let _ = fadvise(file, 0, Some(front), Advice::DontNeed);
    }
    Ok(())
}
