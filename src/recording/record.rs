//! Records of an MCAP file: opcodes and parsers.
//!
//! Layout: MCAP specification, <https://mcap.dev/spec>. Every length is checked when a record is parsed.

use std::collections::BTreeMap;

/// The first and the last bytes of a file.
pub(super) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Length of the opcode and the length before every record.
pub(super) const PREFIX_BYTES: u64 = 9;
/// Length of channel, sequence, log time and publish time before the data of a message.
pub(super) const MESSAGE_HEADER_BYTES: u64 = 22;

/// Opcodes of the records.
pub(super) mod op {
    pub(in super::super) const HEADER: u8 = 0x01;
    pub(in super::super) const FOOTER: u8 = 0x02;
    pub(in super::super) const SCHEMA: u8 = 0x03;
    pub(in super::super) const CHANNEL: u8 = 0x04;
    pub(in super::super) const MESSAGE: u8 = 0x05;
    pub(in super::super) const CHUNK: u8 = 0x06;
    pub(in super::super) const MESSAGE_INDEX: u8 = 0x07;
    pub(in super::super) const CHUNK_INDEX: u8 = 0x08;
    pub(in super::super) const ATTACHMENT: u8 = 0x09;
    pub(in super::super) const ATTACHMENT_INDEX: u8 = 0x0a;
    pub(in super::super) const STATISTICS: u8 = 0x0b;
    pub(in super::super) const METADATA: u8 = 0x0c;
    pub(in super::super) const METADATA_INDEX: u8 = 0x0d;
    pub(in super::super) const SUMMARY_OFFSET: u8 = 0x0e;
    pub(in super::super) const DATA_END: u8 = 0x0f;
}

/// Parses the fields of a record's body from its front; `None` when the body is too short.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    /// Reads the next `count` bytes.
    pub(super) fn next_bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(head)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.next_bytes(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.next_bytes(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.next_bytes(8)?.try_into().ok().map(u64::from_le_bytes)
    }

    /// Reads bytes preceded by a 32-bit length.
    pub(super) fn block(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.next_bytes(usize::try_from(length).ok()?)
    }

    /// Reads UTF-8 preceded by its 32-bit length.
    pub(super) fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.block()?).ok()
    }

    /// Reads a map of texts, preceded by its 32-bit length in bytes.
    pub(super) fn map(&mut self) -> Option<BTreeMap<String, String>> {
        let mut entries = Fields(self.block()?);
        let mut map = BTreeMap::new();
        while !entries.0.is_empty() {
            map.insert(entries.text()?.to_owned(), entries.text()?.to_owned());
        }
        Some(map)
    }
}

/// The description of a message type.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Schema {
    pub(crate) name: String,
    pub(crate) encoding: String,
    pub(crate) data: Vec<u8>,
}

/// A stream of messages.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Channel {
    pub(crate) schema: u16,
    pub(crate) topic: String,
    pub(crate) encoding: String,
    pub(crate) metadata: BTreeMap<String, String>,
}

/// Parses the body of a schema's record: its number and the schema.
pub(super) fn parse_schema(body: &[u8]) -> Option<(u16, Schema)> {
    let mut fields = Fields(body);
    let id = fields.u16()?;
    let (name, encoding) = (fields.text()?.to_owned(), fields.text()?.to_owned());
    Some((id, Schema { name, encoding, data: fields.block()?.to_vec() }))
}

/// Parses the body of a channel's record: its number and the channel.
pub(super) fn parse_channel(body: &[u8]) -> Option<(u16, Channel)> {
    let mut fields = Fields(body);
    let (id, schema) = (fields.u16()?, fields.u16()?);
    let (topic, encoding) = (fields.text()?.to_owned(), fields.text()?.to_owned());
    Some((id, Channel { schema, topic, encoding, metadata: fields.map()? }))
}

/// The header of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MessageHeader {
    pub(super) channel: u16,
    pub(super) sequence: u32,
    pub(super) log_time_ns: u64,
    pub(super) publish_time_ns: u64,
}

/// Parses the header from the first bytes of a message record's body.
pub(super) fn parse_message_header(body: &[u8]) -> Option<MessageHeader> {
    let mut fields = Fields(body);
    Some(MessageHeader {
        channel: fields.u16()?,
        sequence: fields.u32()?,
        log_time_ns: fields.u64()?,
        publish_time_ns: fields.u64()?,
    })
}

/// The header of a chunk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChunkHeader {
    pub(super) uncompressed_bytes: u64,
    pub(super) crc: u32,
    pub(super) compression: String,
    pub(super) stored_bytes: u64,
    /// Length of this header.
    pub(super) bytes: u64,
}

/// Parses the header from the first bytes of a chunk record's body. The times of its messages are skipped.
pub(super) fn parse_chunk_header(body: &[u8]) -> Option<ChunkHeader> {
    let mut fields = Fields(body);
    fields.next_bytes(16)?;
    let (uncompressed_bytes, crc) = (fields.u64()?, fields.u32()?);
    let compression = fields.text()?.to_owned();
    let stored_bytes = fields.u64()?;
    let bytes = (body.len() - fields.0.len()) as u64;
    Some(ChunkHeader { uncompressed_bytes, crc, compression, stored_bytes, bytes })
}
