//! A chunk: messages that are indexed, checked and compressed together.

use super::Compression;
use super::layout::{Body, prefix};
use super::sink::Sink;
use super::summary::ChunkIndex;
use crate::recording::record::{MessageHeader, op};
use crc32fast::Hasher;
use std::collections::BTreeMap;
use std::io;

/// The level of [`Compression::Zstd1`].
const ZSTD_LEVEL: i32 = 1;

/// An open chunk.
pub(super) struct Chunk {
    /// Offset of its record in the file.
    start: u64,
    /// CRC-32 of the records in it.
    crc: Hasher,
    /// Log time and offset of the messages, by channel.
    places: BTreeMap<u16, Vec<(u64, u64)>>,
    /// First and last log time.
    times: Option<(u64, u64)>,
    /// The records of a chunk that is compressed at its end.
    plain: Option<Vec<u8>>,
}

impl Chunk {
    /// Opens a chunk at the end of the sink. Without compression its preliminary header is written, a compressed chunk
    /// is written as a whole at its end.
    pub(super) fn begin(sink: &mut Sink, compression: Compression) -> io::Result<Self> {
        let start = sink.position();
        let plain = match compression {
            Compression::Zstd1 => Some(Vec::new()),
            // The records are written as they come. The sizes follow at the end.
            Compression::None => {
                sink.put(&Header::UNKNOWN.encode())?;
                None
            }
        };
        Ok(Self { start, crc: Hasher::new(), places: BTreeMap::new(), times: None, plain })
    }

    /// Returns the size of the records in it before compression, bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.crc.total_len()
    }

    /// Adds the message whose record is appended next to the index.
    pub(super) fn index(&mut self, header: &MessageHeader) {
        let time = header.log_time_ns;
        let (first, last) = self.times.unwrap_or((time, time));
        self.times = Some((first.min(time), last.max(time)));
        let place = (time, self.bytes());
        self.places.entry(header.channel).or_default().push(place);
    }

    /// Appends a record, or the part of it before its body.
    pub(super) fn put(&mut self, sink: &mut Sink, bytes: &[u8]) -> io::Result<()> {
        self.crc.update(bytes);
        match &mut self.plain {
            Some(plain) => plain.extend_from_slice(bytes),
            None => sink.put(bytes)?,
        }
        Ok(())
    }

    /// Appends the body of a record, whose CRC-32 is `crc`, without computing it again.
    pub(super) fn put_body(&mut self, sink: &mut Sink, bytes: &[u8], crc: u32) -> io::Result<()> {
        self.crc.combine(&Hasher::new_with_initial_len(crc, bytes.len() as u64));
        match &mut self.plain {
            Some(plain) => plain.extend_from_slice(bytes),
            None => sink.put_through(bytes)?,
        }
        Ok(())
    }

    /// Completes the chunk, writes its index after it, and returns its entry for the summary. `file_crc` is extended
    /// over chunk and index.
    pub(super) fn end(self, sink: &mut Sink, file_crc: &mut Hasher) -> io::Result<ChunkIndex> {
        let (first, last) = self.times.unwrap_or((0, 0));
        let plain_bytes = self.bytes();
        let stored = self.plain.map(|plain| zstd::bulk::compress(&plain, ZSTD_LEVEL)).transpose()?;
        let header = Header {
            times: [first, last],
            plain_bytes,
            crc: self.crc.clone().finalize(),
            compression: if stored.is_some() { "zstd" } else { "" },
            stored_bytes: stored.as_ref().map_or(plain_bytes, |stored| stored.len() as u64),
        };
        let head = header.encode();
        file_crc.update(&head);
        match &stored {
            Some(stored) => {
                file_crc.update(stored);
                sink.put(&head)?;
                sink.put_through(stored)?;
            }
            None => {
                file_crc.combine(&self.crc);
                sink.replace(&head, self.start)?;
            }
        }
        let end = sink.position();
        let mut indexes = Vec::new();
        let mut index_offsets = BTreeMap::new();
        for (channel, places) in &self.places {
            index_offsets.insert(*channel, end + indexes.len() as u64);
            let entries = Body::default().u64s(places.iter().flat_map(|(time, offset)| [*time, *offset]));
            indexes.extend(Body::default().u16(*channel).block(&entries.into_bytes()).record(op::MESSAGE_INDEX));
        }
        file_crc.update(&indexes);
        sink.put(&indexes)?;
        Ok(ChunkIndex {
            times: header.times,
            start: self.start,
            length: end - self.start,
            index_offsets,
            index_bytes: indexes.len() as u64,
            compression: header.compression,
            stored_bytes: header.stored_bytes,
            plain_bytes,
        })
    }
}

/// The header of a chunk.
struct Header {
    times: [u64; 2],
    plain_bytes: u64,
    crc: u32,
    compression: &'static str,
    stored_bytes: u64,
}

impl Header {
    /// The header of an open chunk. No reader accepts its lengths.
    const UNKNOWN: Self =
        Self { times: [0; 2], plain_bytes: u64::MAX, crc: u32::MAX, compression: "", stored_bytes: u64::MAX };

    /// Encodes the opcode, the length and the header of a chunk's record. The length includes the stored records.
    fn encode(&self) -> Vec<u8> {
        let header = Body::default().u64s(self.times).u64(self.plain_bytes).u32(self.crc).text(self.compression);
        let header = header.u64(self.stored_bytes).into_bytes();
        // The length includes the records that follow.
        let length = (header.len() as u64).saturating_add(self.stored_bytes);
        [&prefix(op::CHUNK, length)[..], &header].concat()
    }
}
