//! The topics of a recording and their rows.

use super::messages::Messages;
use super::{RecordedFile, Recording};
use crate::recording::record::{Channel, Schema};
use crate::recording::rows::Row;
use crate::recording::{EventRow, RecordingError, StatusRow, Topic};
use crate::results::{Impact, PairField, TrackSample, VelocitySample};
use prost::Message as _;
use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::sync::Arc;

/// The content of a topic.
///
/// # Examples
///
/// ```
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
/// let topics = recording.topics();
/// let truth = topics.iter().find(|topic| topic.topic == "/truth").unwrap();
/// assert_eq!((truth.schema.as_str(), truth.messages), ("ricochet.Velocity", 100));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicSummary {
    /// Its name.
    pub topic: String,
    /// The name of its messages' schema.
    pub schema: String,
    /// The encoding of its messages: `protobuf`, `json`, `cdr`, ...
    pub encoding: String,
    /// The number of messages.
    pub messages: u64,
}

/// Rows of one topic in the order of their time, read on demand.
///
/// # Examples
///
/// ```
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
/// let mut truth = recording.truth()?;
/// assert_eq!(truth.next().unwrap()?.frame, 0);
/// // Damage is an error of one item; the next one may be intact.
/// assert!(truth.all(|sample| sample.is_ok()));
/// // A topic that the recording does not have has no rows.
/// assert_eq!((recording.velocities()?.count(), recording.tracks()?.count()), (0, 0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Rows<T> {
    messages: Messages,
    topic: &'static str,
    row: PhantomData<T>,
}

impl<T: Row> Iterator for Rows<T> {
    type Item = Result<T, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        let message = match self.messages.next()? {
            Ok(message) => message,
            Err(error) => return Some(Err(error)),
        };
        let row = T::Message::decode(message.data).map_err(|error| error.to_string()).and_then(T::from_message);
        Some(row.map_err(|reason| {
            let at = message.header.log_time_ns;
            self.messages
                .file(message.file)
                .invalid(format!("{} message at {at} ns does not decode: {reason}", self.topic))
        }))
    }
}

impl Recording {
    /// Returns every topic with its schema and its number of messages, by name.
    pub fn topics(&self) -> Vec<TopicSummary> {
        let mut topics = BTreeMap::new();
        for inner in self.all_files() {
            for (id, channel) in &inner.structure.channels {
                let schema = inner.schema_name(channel.schema).to_owned();
                let messages = inner.counts.get(id).copied().unwrap_or(0);
                *topics.entry((channel.topic.clone(), schema, channel.encoding.clone())).or_insert(0) += messages;
            }
        }
        let summary = |((topic, schema, encoding), messages)| TopicSummary { topic, schema, encoding, messages };
        topics.into_iter().map(summary).collect()
    }

    /// Reads the velocities. The errors here and below are those of [`fields`](Self::fields).
    ///
    /// # Errors
    ///
    /// [`RecordingError`]; the iterator's items too.
    pub fn velocities(&self) -> Result<Rows<VelocitySample>, RecordingError> {
        self.rows(Topic::Velocity)
    }

    /// Reads the true velocities of a simulated shot.
    ///
    /// # Errors
    ///
    /// [`RecordingError`]; the iterator's items too.
    pub fn truth(&self) -> Result<Rows<VelocitySample>, RecordingError> {
        self.rows(Topic::Truth)
    }

    /// Reads the tracked positions.
    ///
    /// # Errors
    ///
    /// [`RecordingError`]; the iterator's items too.
    pub fn tracks(&self) -> Result<Rows<TrackSample>, RecordingError> {
        self.rows(Topic::Track)
    }

    /// Reads the collisions, every revision of each.
    ///
    /// # Errors
    ///
    /// [`RecordingError`]; the iterator's items too.
    ///
    /// # Examples
    ///
    /// ```no_run
    /// use ricochet::recording::Recording;
    /// use std::collections::BTreeMap;
    ///
    /// // A later revision of a collision replaces the earlier ones.
    /// let mut latest = BTreeMap::new();
    /// for impact in Recording::open("shot.mcap".as_ref())?.impacts()? {
    ///     let impact = impact?;
    ///     latest.insert((impact.body, impact.number), impact);
    /// }
    /// # Ok::<(), ricochet::recording::RecordingError>(())
    /// ```
    pub fn impacts(&self) -> Result<Rows<Impact>, RecordingError> {
        self.rows(Topic::Impact)
    }

    /// Reads the true collisions of a simulated shot.
    ///
    /// # Errors
    ///
    /// [`RecordingError`]; the iterator's items too.
    pub fn truth_impacts(&self) -> Result<Rows<Impact>, RecordingError> {
        self.rows(Topic::TruthImpact)
    }

    /// Reads the displacement fields.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Invalid`] when the topic has another schema; [`RecordingError::Io`] when the system fails. The
    /// iterator returns an error for a damaged chunk, and for a message that does not decode.
    pub fn fields(&self) -> Result<Rows<PairField>, RecordingError> {
        self.rows(Topic::Field)
    }

    /// Reads the events.
    ///
    /// # Errors
    ///
    /// [`RecordingError`]; the iterator's items too.
    pub fn events(&self) -> Result<Rows<EventRow>, RecordingError> {
        self.rows(Topic::Events)
    }

    /// Reads the status of the rig's processes.
    ///
    /// # Errors
    ///
    /// [`RecordingError`]; the iterator's items too.
    pub fn statuses(&self) -> Result<Rows<StatusRow>, RecordingError> {
        self.rows(Topic::Status)
    }

    /// Reads the rows of one of our topics in all files.
    fn rows<T>(&self, topic: Topic) -> Result<Rows<T>, RecordingError> {
        let from_file = |inner: &Arc<RecordedFile>| Ok((Arc::clone(inner), inner.channels_of(topic)?));
        let messages = Messages::new(self.all_files().map(from_file).collect::<Result<_, RecordingError>>()?)?;
        Ok(Rows { messages, topic: topic.as_str(), row: PhantomData })
    }
}

impl Recording {
    /// Returns the channels by number.
    pub(in super::super) fn channels(&self) -> &BTreeMap<u16, Channel> {
        &self.inner.structure.channels
    }

    /// Returns the schemas by number.
    pub(in super::super) fn schemas(&self) -> &BTreeMap<u16, Schema> {
        &self.inner.structure.schemas
    }
}

impl RecordedFile {
    /// Returns the name of a schema; empty for one that the file does not define.
    pub(super) fn schema_name(&self, schema: u16) -> &str {
        self.structure.schemas.get(&schema).map_or("", |schema| &schema.name)
    }

    /// Returns the channels of one of our topics.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Invalid`] when the topic has another schema or encoding.
    pub(super) fn channels_of(&self, topic: Topic) -> Result<Vec<u16>, RecordingError> {
        let mut channels = Vec::new();
        for (id, channel) in self.structure.channels.iter().filter(|(_, channel)| channel.topic == topic.as_str()) {
            let schema = self.schema_name(channel.schema);
            if schema != topic.schema_name() || channel.encoding != "protobuf" {
                return Err(self.invalid(format!(
                    "topic {} has {} messages of schema {schema:?}, not protobuf messages of {:?}",
                    topic.as_str(),
                    channel.encoding,
                    topic.schema_name()
                )));
            }
            channels.push(*id);
        }
        Ok(channels)
    }
}
