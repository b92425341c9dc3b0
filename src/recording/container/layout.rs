//! The encoding of records.

use super::Payload;
use crate::recording::record::{Channel, MESSAGE_HEADER_BYTES, MessageHeader, Schema, op};
use std::collections::BTreeMap;

/// The body of a record that is being encoded, field by field.
#[derive(Default)]
pub(super) struct Body(Vec<u8>);

impl Body {
    /// Appends bytes as they are.
    pub(super) fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    /// Appends a number of 16 bits, little-endian.
    pub(super) fn u16(self, value: u16) -> Self {
        self.bytes(&value.to_le_bytes())
    }

    /// Appends a number of 32 bits, little-endian.
    pub(super) fn u32(self, value: u32) -> Self {
        self.bytes(&value.to_le_bytes())
    }

    /// Appends a number of 64 bits, little-endian.
    pub(super) fn u64(self, value: u64) -> Self {
        self.bytes(&value.to_le_bytes())
    }

    /// Appends 64-bit numbers one after the other, without a length.
    pub(super) fn u64s(self, values: impl IntoIterator<Item = u64>) -> Self {
        values.into_iter().fold(self, Self::u64)
    }

    /// Appends bytes preceded by a 32-bit length.
    ///
    /// # Panics
    ///
    /// When there are 4 GiB or more.
    pub(super) fn block(self, bytes: &[u8]) -> Self {
        assert!(u32::try_from(bytes.len()).is_ok(), "{} bytes exceed a field of an MCAP record", bytes.len());
        self.u32(bytes.len() as u32).bytes(bytes)
    }

    /// Appends UTF-8 preceded by its 32-bit length, bytes. Panics as [`block`](Self::block).
    pub(super) fn text(self, text: &str) -> Self {
        self.block(text.as_bytes())
    }

    /// Appends a map of texts, preceded by its 32-bit length in bytes.
    pub(super) fn map(self, entries: &BTreeMap<String, String>) -> Self {
        let pairs = entries.iter().fold(Self::default(), |pairs, (key, value)| pairs.text(key).text(value));
        self.block(&pairs.0)
    }

    /// Appends a map from channels to numbers, preceded by its 32-bit length in bytes.
    pub(super) fn numbers(self, entries: &BTreeMap<u16, u64>) -> Self {
        let pairs = entries.iter().fold(Self::default(), |pairs, (channel, number)| pairs.u16(*channel).u64(*number));
        self.block(&pairs.0)
    }

    /// Appends the CRC-32 of everything in the body from byte `start` on, counted from 0.
    pub(super) fn crc(self, start: usize) -> Self {
        let crc = crc32fast::hash(&self.0[start..]);
        self.u32(crc)
    }

    /// Returns the record: opcode, length, body.
    pub(super) fn record(self, opcode: u8) -> Vec<u8> {
        let mut record = prefix(opcode, self.0.len() as u64).to_vec();
        record.extend(self.0);
        record
    }

    /// Returns the body alone.
    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.0
    }
}

/// Returns the bytes before the body of a record: opcode and length, bytes.
pub(super) fn prefix(opcode: u8, length: u64) -> [u8; 9] {
    let mut prefix = [opcode; 9];
    prefix[1..].copy_from_slice(&length.to_le_bytes());
    prefix
}

/// Encodes the record of a schema.
pub(super) fn encode_schema(id: u16, schema: &Schema) -> Vec<u8> {
    Body::default().u16(id).text(&schema.name).text(&schema.encoding).block(&schema.data).record(op::SCHEMA)
}

/// Encodes the record of a channel.
pub(super) fn encode_channel(id: u16, channel: &Channel) -> Vec<u8> {
    let Channel { schema, topic, encoding, metadata } = channel;
    Body::default().u16(id).u16(*schema).text(topic).text(encoding).map(metadata).record(op::CHANNEL)
}

/// Encodes the record of a message up to the body of its payload, whose size its length includes. Replaces the content
/// of `out`.
pub(super) fn encode_message_head(out: &mut Vec<u8>, header: &MessageHeader, payload: &Payload<'_>) {
    out.clear();
    out.extend(prefix(op::MESSAGE, MESSAGE_HEADER_BYTES + payload.len() as u64));
    out.extend(header.channel.to_le_bytes());
    out.extend(header.sequence.to_le_bytes());
    out.extend(header.log_time_ns.to_le_bytes());
    out.extend(header.publish_time_ns.to_le_bytes());
    out.extend_from_slice(payload.head);
}
