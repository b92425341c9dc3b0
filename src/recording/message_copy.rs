//! Copies of messages from one file to another, byte by byte.

use super::reader::Message;
use super::record::{Channel, MessageHeader, Schema};
use super::{Recording, RecordingError, RecordingWriter};
use std::collections::BTreeMap;

/// Copies messages with the channels and schemas they need.
pub(super) struct Copier<'a> {
    recording: &'a Recording,
    writer: &'a mut RecordingWriter,
    /// The channel in the new file for each channel of the old one.
    channels: BTreeMap<u16, u16>,
    messages: u64,
}

impl<'a> Copier<'a> {
    /// Prepares to copy from a recording into a new one.
    pub(super) fn new(recording: &'a Recording, writer: &'a mut RecordingWriter) -> Self {
        Self { recording, writer, channels: BTreeMap::new(), messages: 0 }
    }

    /// Returns the recording that is copied.
    pub(super) fn recording(&self) -> &'a Recording {
        self.recording
    }

    /// Returns the number of messages copied so far.
    pub(super) fn messages(&self) -> u64 {
        self.messages
    }

    /// Ends the chunk and writes it. One new chunk per old chunk keeps frames and rows separate.
    pub(super) fn end_chunk(&mut self) -> Result<(), RecordingError> {
        self.writer.flush()
    }

    /// Copies a message to its channel in the new file, and counts it; an image also as a frame.
    pub(super) fn write(&mut self, message: &Message) -> Result<(), RecordingError> {
        let channel = self.channel(message.header.channel)?;
        self.messages += 1;
        if self.recording.is_image(message.header.channel) {
            self.writer.count_frame();
        }
        self.writer.copy_message(&MessageHeader { channel, ..message.header }, &message.data)
    }

    /// Returns the channel of the new file for channel `old` of the old file, written with its schema if it is new.
    fn channel(&mut self, old: u16) -> Result<u16, RecordingError> {
        if let Some(new) = self.channels.get(&old) {
            return Ok(*new);
        }
        let channel = self.recording.channels().get(&old).cloned().unwrap_or_default();
        let schema: Option<&Schema> = self.recording.schemas().get(&channel.schema);
        let new = self.writer.with_container(|container| {
            let schema = schema.map_or(Ok(0), |schema| container.register_schema(schema))?;
            container.register_channel(&Channel { schema, ..channel })
        })?;
        self.channels.insert(old, new);
        Ok(new)
    }
}
