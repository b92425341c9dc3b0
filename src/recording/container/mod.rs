//! The container of a recording: an MCAP file, written record by record.
//!
//! Layout: MCAP specification, <https://mcap.dev/spec>. Frames go from their slot in shared memory to the system without
//! a copy, and each byte is checksummed once: the CRCs of a chunk and of the file are combined from those of its frames.

mod chunk;
mod layout;
mod sink;
mod summary;

use super::part_file::PartFile;
use super::record::{Channel, MAGIC, MessageHeader, Schema, op};
use super::writer::Compression;
use chunk::Chunk;
use crc32fast::Hasher;
use layout::{map, number, record, text};
use sink::Sink;
use std::collections::BTreeMap;
use std::io;
use summary::{AttachmentIndex, MetadataIndex, Summary};

/// Options of a container.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Settings {
    /// The profile of the file: "ros2", or empty for none.
    pub(super) profile: &'static str,
    pub(super) compression: Compression,
    /// Size at which a chunk is closed, bytes.
    pub(super) chunk_bytes: u64,
}

/// The data of a message: a head that is copied, then a body that is written without a copy.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Payload<'a> {
    pub(super) head: &'a [u8],
    pub(super) body: &'a [u8],
    /// CRC-32 of the body.
    pub(super) body_crc: u32,
}

impl<'a> Payload<'a> {
    /// Takes data in one piece; large data are not copied.
    pub(super) fn of(bytes: &'a [u8]) -> Self {
        const MANY_BYTES: usize = 16 << 10;
        match bytes.len() {
            0..MANY_BYTES => Self { head: bytes, ..Self::default() },
            _ => Self { head: &[], body: bytes, body_crc: crc32fast::hash(bytes) },
        }
    }

    pub(super) fn len(&self) -> usize {
        self.head.len() + self.body.len()
    }
}

/// An MCAP file that is being written.
///
/// Without compression, messages are written as they come, in an open chunk too; only the end of the last one is
/// buffered. After an error nothing more can be written. A container that is dropped without [`finish`](Self::finish)
/// leaves a file without a footer, which readers recognize as unfinished.
pub(super) struct Container {
    sink: Sink,
    settings: Settings,
    chunk: Option<Chunk>,
    /// CRC-32 of everything before the open chunk.
    crc: Hasher,
    schemas: Vec<Schema>,
    channels: Vec<Channel>,
    summary: Summary,
    scratch: Vec<u8>,
}

impl Container {
    pub(super) fn create(file: PartFile, settings: Settings) -> io::Result<Self> {
        let mut container = Self {
            sink: Sink::new(file),
            settings,
            chunk: None,
            crc: Hasher::new(),
            schemas: Vec::new(),
            channels: Vec::new(),
            summary: Summary::default(),
            scratch: Vec::new(),
        };
        container.crc.update(MAGIC);
        container.sink.put(MAGIC)?;
        container.outside(op::HEADER, |out| {
            text(out, settings.profile)?;
            text(out, concat!("ricochet ", env!("CARGO_PKG_VERSION")))
        })?;
        Ok(container)
    }

    /// Adds a metadata record; ends the chunk.
    pub(super) fn metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) -> io::Result<()> {
        let (offset, length) = self.outside(op::METADATA, |out| {
            text(out, name)?;
            map(out, entries)
        })?;
        self.summary.metadata.push(MetadataIndex { offset, length, name: name.into() });
        Ok(())
    }

    /// Adds an attachment; ends the chunk.
    pub(super) fn attach(&mut self, name: &str, media_type: &str, content: &[u8]) -> io::Result<()> {
        let (offset, length) = self.outside(op::ATTACHMENT, |out| {
            let start = out.len();
            // No log time and no creation time.
            out.extend([0; 16]);
            text(out, name)?;
            text(out, media_type)?;
            out.extend((content.len() as u64).to_le_bytes());
            out.extend(content);
            let crc = crc32fast::hash(&out[start..]);
            out.extend(crc.to_le_bytes());
            Ok(())
        })?;
        let content_bytes = content.len() as u64;
        let (name, media_type) = (name.into(), media_type.into());
        self.summary.attachments.push(AttachmentIndex { offset, length, content_bytes, name, media_type });
        Ok(())
    }

    /// Returns the number of a schema, which is written if it is new.
    pub(super) fn schema(&mut self, schema: &Schema) -> io::Result<u16> {
        if let Some(known) = self.schemas.iter().position(|known| known == schema) {
            return number(known + 1);
        }
        let id = number(self.schemas.len() + 1)?;
        self.inside(op::SCHEMA, |out| layout::schema(out, id, schema))?;
        self.schemas.push(schema.clone());
        Ok(id)
    }

    /// Returns the number of a channel, which is written if it is new.
    ///
    /// Its schema is a number from [`schema`](Self::schema), or 0 for none.
    pub(super) fn channel(&mut self, channel: &Channel) -> io::Result<u16> {
        if let Some(known) = self.channels.iter().position(|known| known == channel) {
            return number(known + 1);
        }
        let id = number(self.channels.len() + 1)?;
        self.inside(op::CHANNEL, |out| layout::channel(out, id, channel))?;
        self.channels.push(channel.clone());
        Ok(id)
    }

    /// Adds a message on a channel from [`channel`](Self::channel).
    pub(super) fn message(&mut self, header: &MessageHeader, payload: &Payload<'_>) -> io::Result<()> {
        self.summary.count(header);
        if self.chunk.as_ref().is_some_and(|chunk| chunk.bytes() > self.settings.chunk_bytes) {
            self.end_chunk()?;
        }
        let mut record = std::mem::take(&mut self.scratch);
        record.clear();
        layout::message(&mut record, header, payload);
        let written = self.open_chunk().and_then(|(chunk, sink)| {
            chunk.index(header);
            chunk.put(sink, &record)?;
            if payload.body.is_empty() { Ok(()) } else { chunk.put_body(sink, payload.body, payload.body_crc) }
        });
        self.scratch = record;
        written
    }

    /// The number of buffered bytes, without those of a chunk that is compressed at its end.
    pub(super) fn buffered_bytes(&self) -> usize {
        self.sink.buffered_bytes()
    }

    /// Writes the buffered bytes without ending the chunk.
    pub(super) fn write_buffered(&mut self) -> io::Result<()> {
        self.sink.flush()
    }

    /// Ends the chunk and writes everything.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.end_chunk()?;
        self.sink.flush()
    }

    /// Completes the file: end of the data, summary, footer.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.end_chunk()?;
        let crc = self.crc.finalize();
        let mut end = Vec::new();
        record(&mut end, op::DATA_END, |out| {
            out.extend(crc.to_le_bytes());
            Ok(())
        })?;
        self.sink.put(&end)?;
        let written = self.summary.write(self.sink.position(), &self.schemas, &self.channels)?;
        self.sink.put(&written)?;
        self.sink.put(MAGIC)?;
        self.sink.flush()
    }

    /// Writes a record outside any chunk; returns its offset and its length with the prefix.
    fn outside(&mut self, opcode: u8, fill: impl FnOnce(&mut Vec<u8>) -> io::Result<()>) -> io::Result<(u64, u64)> {
        self.end_chunk()?;
        let mut bytes = Vec::new();
        record(&mut bytes, opcode, fill)?;
        let offset = self.sink.position();
        self.crc.update(&bytes);
        self.sink.put(&bytes)?;
        Ok((offset, bytes.len() as u64))
    }

    /// Writes a record inside a chunk.
    fn inside(&mut self, opcode: u8, fill: impl FnOnce(&mut Vec<u8>) -> io::Result<()>) -> io::Result<()> {
        let mut bytes = Vec::new();
        record(&mut bytes, opcode, fill)?;
        let (chunk, sink) = self.open_chunk()?;
        chunk.put(sink, &bytes)
    }

    fn open_chunk(&mut self) -> io::Result<(&mut Chunk, &mut Sink)> {
        let chunk = match self.chunk.take() {
            Some(chunk) => chunk,
            None => Chunk::begin(&mut self.sink, self.settings.compression)?,
        };
        Ok((self.chunk.insert(chunk), &mut self.sink))
    }

    fn end_chunk(&mut self) -> io::Result<()> {
        if let Some(chunk) = self.chunk.take() {
            self.summary.chunks.push(chunk.end(&mut self.sink, &mut self.crc)?);
        }
        Ok(())
    }
}
