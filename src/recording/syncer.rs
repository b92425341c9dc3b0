//! Forces a file to the disk while it is being written, and has the system forget it there.

use rustix::fs::{Advice, fadvise};
use std::fs::File;
use std::io;
use std::num::NonZeroU64;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

/// What stays in the system's cache for those who read it next, bytes: a short recording as a whole.
const CACHED_BYTES: u64 = 256 << 20;

/// A thread that waits for the disk, so that the writing does not.
///
/// Of a long recording only the end stays in the system's cache: what comes takes the pages of what left it. Otherwise
/// each would need new memory, which can cost several times what the write itself does, and push out what others keep.
/// One order at a time is under way, so no more than what is written during it waits for the next.
#[derive(Default)]
pub(super) struct Syncer {
    thread: Option<Thread>,
    /// Whether an order is under way.
    is_asked: bool,
}

struct Thread {
    orders: SyncSender<()>,
    outcomes: Receiver<io::Result<()>>,
    handle: JoinHandle<()>,
}

impl Syncer {
    /// Has everything that the system was handed of this file forced to the disk.
    ///
    /// Fails for the order before, whose end it waits for.
    pub(super) fn ask(&mut self, file: &File) -> io::Result<()> {
        self.wait()?;
        let thread = match self.thread.take() {
            Some(thread) => thread,
            None => Thread::start(file.try_clone()?)?,
        };
        let sent = self.thread.insert(thread).orders.send(());
        self.is_asked = true;
        sent.map_err(io::Error::other)
    }

    /// Waits for the end of the order under way, if there is one.
    pub(super) fn wait(&mut self) -> io::Result<()> {
        match &self.thread {
            Some(thread) if std::mem::take(&mut self.is_asked) => thread.outcomes.recv().map_err(io::Error::other)?,
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
        let (told, outcomes) = sync_channel(1);
        let handle = Builder::new()
            .name("sync".into())
            .spawn(move || while ordered.recv().is_ok() && told.send(sync(&file)).is_ok() {})?;
        Ok(Self { orders, outcomes, handle })
    }
}

fn sync(file: &File) -> io::Result<()> {
    let handed_over = file.metadata()?.len();
    file.sync_data()?;
    if let Some(front) = NonZeroU64::new(handed_over.saturating_sub(CACHED_BYTES)) {
        // What cannot leave stays.
        let _ = fadvise(file, 0, Some(front), Advice::DontNeed);
    }
    Ok(())
}
