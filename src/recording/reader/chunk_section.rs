//! The records of a section.

use super::byte_source::{Source, Unreadable, Window};
use super::scan::{Coding, Section, prefix};
use crate::recording::record::{self, MessageHeader, PREFIX_BYTES, op};
use bytes::Bytes;
use std::fs::File;
use std::io::{self, Read};

/// Maximum size of a chunk that is kept in memory, bytes. Larger ones are checked and read piece by piece.
const MAX_MEMORY_BYTES: u64 = 64 << 20;

/// Checks the CRC of a section's records and returns them decompressed: in memory, or in the file if they are
/// uncompressed and large or have no CRC.
///
/// Takes at most the file's size plus 64 MiB of memory.
pub(super) fn load_records(file: &File, file_bytes: u64, section: &Section) -> Result<Source, Unreadable> {
    let stored = Source::File { offset: section.offset, bytes: section.bytes };
    let records = match section.coding {
        Coding::Plain if section.crc == 0 => return Ok(stored),
        Coding::Plain if section.bytes > MAX_MEMORY_BYTES => {
            check_crc(section, streamed_crc(file, &stored)?)?;
            return Ok(stored);
        }
        Coding::Plain => stored.read(file, 0, section.bytes)?,
        Coding::Zstd | Coding::Lz4 => decompress(file, file_bytes, section)?,
    };
    if section.crc != 0 {
        check_crc(section, crc32fast::hash(&records))?;
    }
    Ok(Source::Memory(records))
}

/// Checks the CRC-32 `crc` of the records against that of the chunk.
///
/// # Errors
///
/// [`Unreadable::Damaged`] if they differ.
fn check_crc(section: &Section, crc: u32) -> Result<(), Unreadable> {
    if crc == section.crc {
        return Ok(());
    }
    Err(Unreadable::Damaged(format!(
        "the chunk with records from byte {} is damaged: CRC {:08x} expected, got {crc:08x}",
        section.offset, section.crc
    )))
}

/// Computes the CRC-32 of all bytes of a source, in pieces of 1 MiB.
pub(super) fn streamed_crc(file: &File, source: &Source) -> io::Result<u32> {
    let mut hasher = crc32fast::Hasher::new();
    let mut at = 0;
    while at < source.len() {
        let count = (source.len() - at).min(1 << 20);
        hasher.update(&source.read(file, at, count)?);
        at += count;
    }
    Ok(hasher.finalize())
}

/// Decompresses the records of a section.
///
/// # Errors
///
/// [`Unreadable::Damaged`] if the size after decompression exceeds that of the file by more than [`MAX_MEMORY_BYTES`]
/// or differs from the header's, or the data do not decompress.
fn decompress(file: &File, file_bytes: u64, section: &Section) -> Result<Bytes, Unreadable> {
    let damaged =
        |reason: String| Unreadable::Damaged(format!("the chunk with records from byte {}: {reason}", section.offset));
    let expected = section.uncompressed_bytes;
    if expected > MAX_MEMORY_BYTES + file_bytes {
        return Err(damaged(format!(
            "{expected} bytes after decompression are more than a file of this size may have"
        )));
    }
    let capacity = usize::try_from(expected).map_err(io::Error::other)?;
    let stored = Source::File { offset: section.offset, bytes: section.bytes }.read(file, 0, section.bytes)?;
    let records = match section.coding {
        Coding::Zstd => zstd::bulk::decompress(&stored, capacity),
        _ => lz4::Decoder::new(&stored[..]).and_then(|decoder| {
            let mut records = Vec::new();
            decoder.take(expected + 1).read_to_end(&mut records).map(|_| records)
        }),
    };
    let records = records.map_err(|error| damaged(format!("it does not decompress: {error}")))?;
    if records.len() != capacity {
        return Err(damaged(format!("{expected} bytes expected after decompression, got {}", records.len())));
    }
    Ok(records.into())
}

/// One record inside a section.
#[derive(Debug)]
pub(super) enum Found<'a> {
    /// A message: the offset of its record in the section, and its header.
    Message { at: u64, header: MessageHeader },
    /// A schema or a channel.
    Description { opcode: u8, body: &'a [u8] },
}

/// Visits the messages, schemas and channels of a section in order, up to its end or to the first record that does not
/// parse.
///
/// Returns the number of parsed bytes, other records included.
///
/// # Errors
///
/// The reason returned by `visit`, or an error of the system.
pub(super) fn scan_records(
    file: &File,
    records: &Source,
    mut visit: impl FnMut(Found<'_>) -> Result<(), String>,
) -> Result<u64, Unreadable> {
    let mut window = Window::new(file, records);
    let mut at = 0;
    loop {
        let Some((opcode, length)) = prefix(window.peek(at, PREFIX_BYTES as usize)?) else { return Ok(at) };
        let body = at + PREFIX_BYTES;
        if length > records.len() - body {
            return Ok(at);
        }
        match opcode {
            op::MESSAGE => {
                let head = window.peek(body, length.min(record::MESSAGE_HEADER_BYTES) as usize)?;
                let Some(header) = record::parse_message_header(head) else { return Ok(at) };
                visit(Found::Message { at, header }).map_err(Unreadable::Damaged)?;
            }
            op::SCHEMA | op::CHANNEL => {
                let bytes = records.read(file, body, length)?;
                visit(Found::Description { opcode, body: &bytes }).map_err(Unreadable::Damaged)?;
            }
            _ => {}
        }
        at = body + length;
    }
}

/// Reads the message whose record begins at byte `at` of the section: its header and its data.
///
/// `None` when there is no complete message.
pub(super) fn read_message(file: &File, records: &Source, at: u64) -> io::Result<Option<(MessageHeader, Bytes)>> {
    if at.checked_add(PREFIX_BYTES).is_none_or(|body| body > records.len()) {
        return Ok(None);
    }
    let Some((op::MESSAGE, length)) = prefix(&records.read(file, at, PREFIX_BYTES)?) else { return Ok(None) };
    let body = at + PREFIX_BYTES;
    if length > records.len() - body {
        return Ok(None);
    }
    let bytes = records.read(file, body, length)?;
    let Some(header) = record::parse_message_header(&bytes) else { return Ok(None) };
    Ok(Some((header, bytes.slice(record::MESSAGE_HEADER_BYTES as usize..))))
}
