//! The encoding of records.

use super::Payload;
use crate::recording::record::{Channel, MESSAGE_HEADER_BYTES, MessageHeader, Schema, op};
use std::collections::BTreeMap;
use std::io;

/// Appends a record: opcode, length, body.
pub(super) fn record(
    out: &mut Vec<u8>,
    opcode: u8,
    fill: impl FnOnce(&mut Vec<u8>) -> io::Result<()>,
) -> io::Result<()> {
    out.push(opcode);
    out.extend([0; 8]);
    let body = out.len();
    fill(out)?;
    let length = (out.len() - body) as u64;
    out[body - 8..body].copy_from_slice(&length.to_le_bytes());
    Ok(())
}

pub(super) fn schema(out: &mut Vec<u8>, id: u16, schema: &Schema) -> io::Result<()> {
    out.extend(id.to_le_bytes());
    text(out, &schema.name)?;
    text(out, &schema.encoding)?;
    block(out, &schema.data)
}

pub(super) fn channel(out: &mut Vec<u8>, id: u16, channel: &Channel) -> io::Result<()> {
    out.extend(id.to_le_bytes());
    out.extend(channel.schema.to_le_bytes());
    text(out, &channel.topic)?;
    text(out, &channel.encoding)?;
    map(out, &channel.metadata)
}

/// Appends the record of a message up to its body.
pub(super) fn message(out: &mut Vec<u8>, header: &MessageHeader, payload: &Payload<'_>) {
    out.push(op::MESSAGE);
    out.extend((MESSAGE_HEADER_BYTES + payload.len() as u64).to_le_bytes());
    out.extend(header.channel.to_le_bytes());
    out.extend(header.sequence.to_le_bytes());
    out.extend(header.log_time_ns.to_le_bytes());
    out.extend(header.publish_time_ns.to_le_bytes());
    out.extend_from_slice(payload.head);
}

pub(super) fn text(out: &mut Vec<u8>, text: &str) -> io::Result<()> {
    block(out, text.as_bytes())
}

/// Appends bytes preceded by a 32-bit length.
pub(super) fn block(out: &mut Vec<u8>, bytes: &[u8]) -> io::Result<()> {
    out.extend(number::<u32>(bytes.len())?.to_le_bytes());
    out.extend_from_slice(bytes);
    Ok(())
}

pub(super) fn map(out: &mut Vec<u8>, entries: &BTreeMap<String, String>) -> io::Result<()> {
    let mut bytes = Vec::new();
    for (key, value) in entries {
        text(&mut bytes, key)?;
        text(&mut bytes, value)?;
    }
    block(out, &bytes)
}

/// Appends a map from channels to numbers.
pub(super) fn numbers(out: &mut Vec<u8>, entries: &BTreeMap<u16, u64>) -> io::Result<()> {
    let pair = |(channel, value): (&u16, &u64)| [&channel.to_le_bytes()[..], &value.to_le_bytes()].concat();
    block(out, &entries.iter().flat_map(pair).collect::<Vec<u8>>())
}

/// Converts a number to the width of its field.
///
/// # Errors
///
/// When the number is too large for the field.
pub(super) fn number<T: TryFrom<usize>>(value: usize) -> io::Result<T> {
    T::try_from(value).map_err(|_| io::Error::other(format!("{value} exceeds a field of an MCAP record")))
}
