//! Syncs a file to the disk while it is written, and drops it from the system's cache.

use rustix::fs::{Advice, fadvise};
use std::fs::File;
use std::io;
use std::num::NonZeroU64;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

/// Size of the end of a file that stays in the system's cache, bytes. A short recording stays there as a whole.
const CACHED_BYTES: u64 = 256 << 20;

/// A thread that waits for the disk, so that the writer does not.
///
/// Only the end of a long recording stays in the system's cache, so that new data reuse the pages of old data. New pages
/// can cost several times the write itself, and they evict the pages of other programs. At most one sync runs at a time,
/// so the next one has only the data written meanwhile.
#[derive(Default)]
pub(super) struct Syncer {
    thread: Option<Thread>,
    /// Whether a sync is running.
    is_running: bool,
}

struct Thread {
    orders: SyncSender<()>,
    outcomes: Receiver<io::Result<()>>,
    handle: JoinHandle<()>,
}

impl Syncer {
    /// Starts a sync of everything written so far.
    ///
    /// # Errors
    ///
    /// The error of the previous sync, which it waits for.
    pub(super) fn start(&mut self, file: &File) -> io::Result<()> {
        self.wait()?;
        let thread = match self.thread.take() {
            Some(thread) => thread,
            None => Thread::start(file.try_clone()?)?,
        };
        let sent = self.thread.insert(thread).orders.send(());
        self.is_running = true;
        sent.map_err(io::Error::other)
    }

    /// Waits for the running sync, if any.
    ///
    /// # Errors
    ///
    /// The error of that sync.
    pub(super) fn wait(&mut self) -> io::Result<()> {
        match &self.thread {
            Some(thread) if std::mem::take(&mut self.is_running) => thread.outcomes.recv().map_err(io::Error::other)?,
            _ => Ok(()),
        }
    }
}

impl Drop for Syncer {
    fn drop(&mut self) {
        if let Some(Thread { orders, outcomes, handle }) = self.thread.take() {
            drop((orders, outcomes));
            let _ = handle.join();
        }
    }
}

impl Thread {
    fn start(file: File) -> io::Result<Self> {
        let (orders, ordered) = sync_channel(1);
        let (reply, outcomes) = sync_channel(1);
        let handle = Builder::new()
            .name("sync".into())
            .spawn(move || while ordered.recv().is_ok() && reply.send(sync(&file)).is_ok() {})?;
        Ok(Self { orders, outcomes, handle })
    }
}

fn sync(file: &File) -> io::Result<()> {
    let written_bytes = file.metadata()?.len();
    file.sync_data()?;
    if let Some(front) = NonZeroU64::new(written_bytes.saturating_sub(CACHED_BYTES)) {
        // A failure costs cache, not data.
        let _ = fadvise(file, 0, Some(front), Advice::DontNeed);
    }
    Ok(())
}
