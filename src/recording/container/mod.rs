//! The container of a recording: an MCAP file, written record by record.
//!
//! Layout: MCAP specification, <https://mcap.dev/spec>. Frames go from their slot in shared memory to the system
//! without a copy, and each byte is checksummed once: the CRCs of a chunk and of the file are combined from those of
//! its frames.

mod chunk;
mod layout;
mod sink;
mod summary;

use super::part_file::PartFile;
use super::record::{Channel, MAGIC, MessageHeader, Schema, op};
use chunk::Chunk;
use crc32fast::Hasher;
use layout::Body;
use sink::Sink;
use std::collections::BTreeMap;
use std::io;
use summary::{AttachmentIndex, MetadataIndex, Summary};

/// The compression of chunks.
///
/// # Examples
///
/// ```
/// use ricochet::image::{Frame, FrameMeta};
/// use ricochet::recording::{Compression, RecordingInfo, RecordingWriter, WriterOptions};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("shot.mcap");
///
/// let options = WriterOptions { compression: Compression::Zstd1, ..WriterOptions::default() };
/// let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &options)?;
/// let meta = FrameMeta { width_px: 256, height_px: 256, stride_bytes: 256, ..FrameMeta::default() };
/// writer.write_frame(&Frame { meta, bytes: &[50; 256 * 256] })?;
/// // An even picture compresses to a part of its 65 536 bytes.
/// assert!(writer.finish()?.bytes < 30_000);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// None, the only way to keep up with a camera.
    #[default]
    None,
    /// Zstandard level 1, on the writing thread: about a quarter smaller, several times slower.
    Zstd1,
}

/// Size of a message without its data: header, index entry and its share of the chunk's header, bytes.
pub(super) const MESSAGE_OVERHEAD_BYTES: u64 = 160;

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
    /// Creates a payload of data in one piece. From 16 KiB on they are the body, which is not copied; its CRC-32 is
    /// computed.
    pub(super) fn from_bytes(bytes: &'a [u8]) -> Self {
        const MANY_BYTES: usize = 16 << 10;
        match bytes.len() {
            0..MANY_BYTES => Self { head: bytes, ..Self::default() },
            _ => Self { head: &[], body: bytes, body_crc: crc32fast::hash(bytes) },
        }
    }

    /// Returns the size of head and body, bytes.
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
    summary: Summary,
    scratch: Vec<u8>,
}

impl Container {
    /// Starts a file: magic bytes and header.
    pub(super) fn create(file: PartFile, settings: Settings) -> io::Result<Self> {
        let mut container = Self {
            sink: Sink::new(file),
            settings,
            chunk: None,
            crc: Hasher::new(),
            summary: Summary::default(),
            scratch: Vec::new(),
        };
        container.crc.update(MAGIC);
        container.sink.put(MAGIC)?;
        let library = concat!("ricochet ", env!("CARGO_PKG_VERSION"));
        container.put_outside(&Body::default().text(settings.profile).text(library).record(op::HEADER))?;
        Ok(container)
    }

    /// Writes a metadata record; ends the chunk.
    pub(super) fn write_metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) -> io::Result<()> {
        let record = Body::default().text(name).map(entries).record(op::METADATA);
        let offset = self.put_outside(&record)?;
        self.summary.metadata.push(MetadataIndex { offset, length: record.len() as u64, name: name.into() });
        Ok(())
    }

    /// Writes an attachment without times; ends the chunk.
    pub(super) fn attach(&mut self, name: &str, media_type: &str, content: &[u8]) -> io::Result<()> {
        // No log time and no creation time.
        let body = Body::default().u64s([0, 0]).text(name).text(media_type);
        let record = body.u64(content.len() as u64).bytes(content).crc(0).record(op::ATTACHMENT);
        let (offset, length) = (self.put_outside(&record)?, record.len() as u64);
        let content_bytes = content.len() as u64;
        let (name, media_type) = (name.into(), media_type.into());
        self.summary.attachments.push(AttachmentIndex { offset, length, content_bytes, name, media_type });
        Ok(())
    }

    /// Returns the number of a schema, from 1, and writes the schema if it is new.
    ///
    /// # Errors
    ///
    /// An error of the system, or more than 65535 schemas.
    pub(super) fn register_schema(&mut self, schema: &Schema) -> io::Result<u16> {
        let schemas = &self.summary.schemas;
        let place = schemas.iter().position(|known| known == schema).unwrap_or(schemas.len());
        let id = u16::try_from(place + 1).map_err(io::Error::other)?;
        if place == schemas.len() {
            self.put_inside(&layout::encode_schema(id, schema))?;
            self.summary.schemas.push(schema.clone());
        }
        Ok(id)
    }

    /// Returns the number of a channel, from 1, and writes the channel if it is new. Errors as
    /// [`register_schema`](Self::register_schema).
    ///
    /// Its schema is a number from [`register_schema`](Self::register_schema), or 0 for none.
    pub(super) fn register_channel(&mut self, channel: &Channel) -> io::Result<u16> {
        let channels = &self.summary.channels;
        let place = channels.iter().position(|known| known == channel).unwrap_or(channels.len());
        let id = u16::try_from(place + 1).map_err(io::Error::other)?;
        if place == channels.len() {
            self.put_inside(&layout::encode_channel(id, channel))?;
            self.summary.channels.push(channel.clone());
        }
        Ok(id)
    }

    /// Writes a message on a channel from [`register_channel`](Self::register_channel), in a new chunk if the open one
    /// is full.
    pub(super) fn write_message(&mut self, header: &MessageHeader, payload: &Payload<'_>) -> io::Result<()> {
        self.summary.count(header);
        if self.chunk.as_ref().is_some_and(|chunk| chunk.bytes() > self.settings.chunk_bytes) {
            self.end_chunk()?;
        }
        let mut record = std::mem::take(&mut self.scratch);
        layout::encode_message_head(&mut record, header, payload);
        let written = self.open_chunk().and_then(|(chunk, sink)| {
            chunk.index(header);
            chunk.put(sink, &record)?;
            if payload.body.is_empty() { Ok(()) } else { chunk.put_body(sink, payload.body, payload.body_crc) }
        });
        self.scratch = record;
        written
    }

    /// Returns the number of buffered bytes, without those of a chunk that is compressed at its end.
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
        self.sink.put(&Body::default().u32(self.crc.finalize()).record(op::DATA_END))?;
        let summary = self.summary.encode(self.sink.position());
        self.sink.put(&summary)?;
        self.sink.put(MAGIC)?;
        self.sink.flush()
    }

    /// Ends the open chunk, writes a record after it and returns the record's offset in the file, bytes.
    fn put_outside(&mut self, record: &[u8]) -> io::Result<u64> {
        self.end_chunk()?;
        let offset = self.sink.position();
        self.crc.update(record);
        self.sink.put(record)?;
        Ok(offset)
    }

    /// Writes a record inside the open chunk, or a new one.
    fn put_inside(&mut self, record: &[u8]) -> io::Result<()> {
        let (chunk, sink) = self.open_chunk()?;
        chunk.put(sink, record)
    }

    /// Returns the open chunk, or a new one, with the sink that it is written to.
    fn open_chunk(&mut self) -> io::Result<(&mut Chunk, &mut Sink)> {
        let chunk = match self.chunk.take() {
            Some(chunk) => chunk,
            None => Chunk::begin(&mut self.sink, self.settings.compression)?,
        };
        Ok((self.chunk.insert(chunk), &mut self.sink))
    }

    /// Completes the open chunk, if any, and adds it to the summary.
    fn end_chunk(&mut self) -> io::Result<()> {
        if let Some(chunk) = self.chunk.take() {
            self.summary.chunks.push(chunk.end(&mut self.sink, &mut self.crc)?);
        }
        Ok(())
    }
}
