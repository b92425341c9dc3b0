//! Small messages that are gathered into chunks of their own.

use super::container::MESSAGE_OVERHEAD_BYTES;
use super::schema::Topic;

/// A message of a batch.
#[derive(Debug, Clone, Copy)]
pub(super) struct BatchedMessage<'a> {
    /// The index of the camera.
    pub(super) camera: usize,
    pub(super) topic: Topic,
    /// The log time, ns since the Unix epoch.
    pub(super) log_time_ns: u64,
    pub(super) bytes: &'a [u8],
}

/// The place of a message in a batch.
#[derive(Debug, Clone, Copy)]
struct Entry {
    camera: usize,
    topic: Topic,
    log_time_ns: u64,
    /// One past its last byte.
    end: usize,
}

/// Encoded messages of one kind, held back until they fill a chunk.
///
/// Readers can skip whole chunks only. Small messages in their own chunks allow a reader of `/velocity` to skip all
/// frames.
#[derive(Debug, Default)]
pub(super) struct Batch {
    bytes: Vec<u8>,
    messages: Vec<Entry>,
    first_ns: Option<u64>,
}

impl Batch {
    /// Encodes a row and adds it. `camera` is 0 for the first camera; `log_time_ns` is in ns since the Unix epoch.
    pub(super) fn push<M: prost::Message>(&mut self, camera: usize, topic: Topic, log_time_ns: u64, message: &M) {
        self.first_ns.get_or_insert(log_time_ns);
        self.bytes.extend_from_slice(&message.encode_to_vec());
        self.messages.push(Entry { camera, topic, log_time_ns, end: self.bytes.len() });
    }

    /// Whether the batch holds at least `limit_bytes`, or its first message is at least `limit_ns` older than `now_ns`.
    pub(super) fn is_due(&self, now_ns: u64, limit_bytes: usize, limit_ns: u64) -> bool {
        self.bytes.len() >= limit_bytes || self.first_ns.is_some_and(|first| now_ns.saturating_sub(first) >= limit_ns)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.messages.is_empty()
    }

    /// Returns an upper bound of the batch's size in a file, bytes.
    pub(super) fn expected_bytes(&self) -> u64 {
        self.bytes.len() as u64 + self.messages.len() as u64 * MESSAGE_OVERHEAD_BYTES
    }

    /// Returns every message in the order of arrival.
    pub(super) fn iter(&self) -> impl Iterator<Item = BatchedMessage<'_>> {
        let starts = std::iter::once(0).chain(self.messages.iter().map(|message| message.end));
        self.messages.iter().zip(starts).map(|(entry, start)| {
            let Entry { camera, topic, log_time_ns, end } = *entry;
            BatchedMessage { camera, topic, log_time_ns, bytes: &self.bytes[start..end] }
        })
    }

    /// Removes all messages and keeps the memory.
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.messages.clear();
        self.first_ns = None;
    }
}
