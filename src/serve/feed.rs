//! The hand-over of a topic from the thread that reads the bus to the clients that follow it.
//!
//! Rows travel in batches, so that a client is woken once for all rows of a millisecond. A client that is too slow
//! loses the oldest rows and learns their number. It never slows the reader of the bus or another client.

use axum::body::Bytes;
use axum::extract::ws::Utf8Bytes;
use serde_json::{Map, Value};
use std::fmt::Write;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::broadcast::error::{RecvError, TryRecvError};
use tokio::sync::broadcast::{self, Receiver, Sender};

/// The number of batches that wait for a slow client: two seconds of a topic that comes every millisecond.
const MAX_WAITING_BATCHES: usize = 2048;
/// The maximum number of rows of a batch, so that a burst does not fill the memory.
pub(super) const MAX_BATCH_ROWS: usize = 16;

/// Rows that became available together.
#[derive(Debug)]
pub(super) struct Batch {
    /// The number of the first row, counted from the start of the server.
    first: u64,
    /// Each row as a JSON object.
    pub(super) rows: Vec<Utf8Bytes>,
    /// The same rows as server-sent events.
    pub(super) events: Bytes,
}

impl Batch {
    /// Writes the rows in both formats; `first` is the number of the first one.
    fn new(first: u64, rows: &[Map<String, Value>]) -> Self {
        // The names and values of a row are valid JSON.
        let texts: Vec<String> = rows.iter().map(|row| serde_json::to_string(row).unwrap_or_default()).collect();
        let mut events = String::new();
        for (number, text) in (first..).zip(&texts) {
            // Writing to a string cannot fail.
            let _ = write!(events, "id: {number}\ndata: {text}\n\n");
        }
        Self { first, rows: texts.into_iter().map(Utf8Bytes::from).collect(), events: events.into() }
    }
}

/// The sending side of a topic.
#[derive(Debug, Clone)]
pub(super) struct Feed {
    sender: Sender<Arc<Batch>>,
    /// The number of rows sent since the start of the server. It is locked while a client begins to follow, so that each
    /// client knows the number of its first row.
    sent: Arc<Mutex<u64>>,
}

impl Default for Feed {
    fn default() -> Self {
        Self { sender: broadcast::channel(MAX_WAITING_BATCHES).0, sent: Arc::default() }
    }
}

impl Feed {
    /// Whether any client follows the topic.
    pub(super) fn is_followed(&self) -> bool {
        self.sender.receiver_count() > 0
    }

    /// Counts rows and sends them to all clients as one batch. The caller passes at most [`MAX_BATCH_ROWS`].
    pub(super) fn send(&self, rows: &[Map<String, Value>]) {
        let mut sent = self.lock_sent();
        let first = *sent;
        *sent += rows.len() as u64;
        // Without a client there is nobody to send to.
        let _ = self.sender.send(Arc::new(Batch::new(first, rows)));
    }

    /// Returns the receiving side for a client that follows the topic from now on.
    pub(super) fn follow(&self) -> Follower {
        let sent = self.lock_sent();
        Follower { receiver: self.sender.subscribe(), next: *sent }
    }

    /// Locks the number of rows sent.
    fn lock_sent(&self) -> MutexGuard<'_, u64> {
        self.sent.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The receiving side of one client.
#[derive(Debug)]
pub(super) struct Follower {
    receiver: Receiver<Arc<Batch>>,
    /// The number of the next row.
    next: u64,
}

/// The rows that a client receives next.
#[derive(Debug)]
pub(super) struct Delivery {
    /// The number of rows that it has lost before them.
    pub(super) lost: u64,
    /// The rows.
    pub(super) batch: Arc<Batch>,
}

impl Follower {
    /// Waits for the next rows, with the number of rows lost since the ones before; `None` when the topic has ended.
    pub(super) async fn next(&mut self) -> Option<Delivery> {
        loop {
            match self.receiver.recv().await {
                Ok(batch) => return Some(self.delivery(batch)),
                Err(RecvError::Lagged(_)) => {}
                Err(RecvError::Closed) => return None,
            }
        }
    }

    /// Returns the next rows if they are there already, as [`next`](Self::next) does.
    pub(super) fn try_next(&mut self) -> Option<Delivery> {
        loop {
            match self.receiver.try_recv() {
                Ok(batch) => return Some(self.delivery(batch)),
                Err(TryRecvError::Lagged(_)) => {}
                Err(TryRecvError::Empty | TryRecvError::Closed) => return None,
            }
        }
    }

    /// Returns a batch as a delivery, with the number of rows that were lost before it.
    fn delivery(&mut self, batch: Arc<Batch>) -> Delivery {
        let lost = batch.first.saturating_sub(self.next);
        self.next = batch.first + batch.rows.len() as u64;
        Delivery { lost, batch }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(number: usize) -> Map<String, Value> {
        [("frame".to_owned(), json!(number))].into_iter().collect()
    }

    fn next(follower: &mut Follower) -> Delivery {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(follower.next()).unwrap()
    }

    #[test]
    fn a_slow_client_loses_the_oldest_rows_and_learns_how_many() {
        let feed = Feed::default();
        feed.send(&[row(0)]);
        let mut follower = feed.follow();
        feed.send(&[row(1), row(2)]);
        let first = next(&mut follower);
        assert_eq!((first.lost, first.batch.rows.len()), (0, 2));
        for number in 3..3 + MAX_WAITING_BATCHES + 5 {
            feed.send(&[row(number)]);
        }
        let later = next(&mut follower);
        assert_eq!((later.lost, later.batch.rows[0].as_str()), (5, "{\"frame\":8}"));
        assert_eq!(&later.batch.events[..], b"id: 8\ndata: {\"frame\":8}\n\n");
        assert_eq!(next(&mut follower).lost, 0);
        assert_eq!(follower.try_next().unwrap().batch.rows[0].as_str(), "{\"frame\":10}");
    }

    #[test]
    fn rows_that_a_client_loses_before_its_first_one_are_counted() {
        let feed = Feed::default();
        feed.send(&[row(0)]);
        let mut follower = feed.follow();
        (1..=MAX_WAITING_BATCHES + 3).for_each(|number| feed.send(&[row(number)]));
        let first = next(&mut follower);
        assert_eq!((first.lost, first.batch.rows[0].as_str()), (3, "{\"frame\":4}"));
    }
}
