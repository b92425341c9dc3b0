//! The structure of a file: the records and their places, up to its end or to where it was cut off.

use super::byte_source::{Source, Unreadable, Window};
use crate::recording::record::{self, Channel, Fields, PREFIX_BYTES, Schema, op};
use std::collections::BTreeMap;
use std::fs::File;

/// Maximum size of all schemas, channels and metadata, bytes. Ours take a few kB.
const MAX_DESCRIPTION_BYTES: u64 = 8 << 20;
/// Maximum number of attachments.
const MAX_ATTACHMENTS: usize = 1024;
/// The fixed part of the maximum size of all chunks after decompression, bytes.
const MAX_UNPACKED_BYTES: u64 = 512 << 20;
/// The multiple of the file's size in the maximum size of all chunks after decompression.
///
/// Pixels of a camera shrink to a third at best, drawn ones to a hundredth.
const MAX_UNPACKED_RATIO: u64 = 256;
/// Maximum length of a chunk header, bytes. Only the name of the compression has no fixed length.
const CHUNK_HEADER_BYTES: usize = 256;

/// The encoding of a section's records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coding {
    Plain,
    Zstd,
    Lz4,
}

/// The part of a chunk's index with the messages of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct IndexRef {
    pub(super) channel: u16,
    /// Offset of the entries in the file.
    pub(super) offset: u64,
    /// The number of entries.
    pub(super) entries: u64,
}

/// A part of the file with messages: the records of a chunk, or messages outside any chunk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Section {
    /// Offset of the stored bytes in the file.
    pub(super) offset: u64,
    /// Length of the stored bytes.
    pub(super) bytes: u64,
    pub(super) coding: Coding,
    /// Length after decompression.
    pub(super) uncompressed_bytes: u64,
    /// CRC-32 of the uncompressed records; 0 for none.
    pub(super) crc: u32,
    /// Whether the file has every byte of it.
    pub(super) whole: bool,
    /// The index by channel; empty when the file has none.
    pub(super) index: Vec<IndexRef>,
}

impl Section {
    /// Returns a section of uncompressed records without a CRC and an index.
    fn plain(offset: u64, bytes: u64) -> Self {
        let (coding, index) = (Coding::Plain, Vec::new());
        Self { offset, bytes, coding, uncompressed_bytes: bytes, crc: 0, whole: true, index }
    }

    /// Whether the section may be a run of messages outside chunks, which can grow.
    fn is_loose(&self) -> bool {
        self.coding == Coding::Plain && self.crc == 0 && self.whole && self.index.is_empty()
    }
}

/// An attachment and its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct AttachmentRef {
    pub(super) name: String,
    pub(super) media_type: String,
    /// Offset of the record's body in the file.
    pub(super) body: u64,
    /// Length of the body before the content.
    pub(super) header_bytes: u64,
    pub(super) content_bytes: u64,
}

/// The structure of a file.
#[derive(Debug, Clone, Default)]
pub(super) struct Structure {
    pub(super) library: String,
    pub(super) schemas: BTreeMap<u16, Schema>,
    pub(super) channels: BTreeMap<u16, Channel>,
    pub(super) sections: Vec<Section>,
    pub(super) metadata: Vec<(String, BTreeMap<String, String>)>,
    pub(super) attachments: Vec<AttachmentRef>,
    /// The end of the data section and the CRC-32 of everything before it; 0 for none.
    pub(super) data_end: Option<(u64, u32)>,
    /// Why and where the file ends early; `None` for a complete file.
    pub(super) truncated: Option<String>,
    description_bytes: u64,
    /// The size of all compressed chunks after decompression, and its maximum.
    unpacked_bytes: u64,
    max_unpacked_bytes: u64,
}

/// Scans the file from record to record without reading the messages.
///
/// # Errors
///
/// [`Unreadable::Io`] when the system fails; [`Unreadable::Damaged`] when the file is not MCAP.
pub(super) fn scan(file: &File, file_bytes: u64) -> Result<Structure, Unreadable> {
    scan_while(file, file_bytes, |_| true)
}

/// Reads the first metadata record with a name, searched before the messages only.
///
/// # Errors
///
/// [`Unreadable::Io`] when the system fails; [`Unreadable::Damaged`] when the file is not MCAP.
pub(super) fn leading_metadata(
    file: &File,
    file_bytes: u64,
    name: &str,
) -> Result<Option<BTreeMap<String, String>>, Unreadable> {
    let is_leading = |opcode: u8| matches!(opcode, op::HEADER | op::METADATA | op::ATTACHMENT);
    let structure = scan_while(file, file_bytes, is_leading)?;
    Ok(structure.metadata.into_iter().find(|(found, _)| found == name).map(|(_, entries)| entries))
}

/// Scans the file up to the first record whose opcode is not wanted, its end, or the place where it is cut off or
/// damaged, which the structure states.
///
/// # Errors
///
/// [`Unreadable::Io`] when the system fails; [`Unreadable::Damaged`] when the file is not MCAP.
fn scan_while(file: &File, file_bytes: u64, is_wanted: impl Fn(u8) -> bool) -> Result<Structure, Unreadable> {
    let source = Source::File { offset: 0, bytes: file_bytes };
    let mut window = Window::new(file, &source);
    if window.peek(0, record::MAGIC.len())? != record::MAGIC {
        return Err(Unreadable::Damaged("not an MCAP file: the magic bytes are missing at byte 0".into()));
    }
    let max_unpacked_bytes = MAX_UNPACKED_BYTES.saturating_add(file_bytes.saturating_mul(MAX_UNPACKED_RATIO));
    let mut structure = Structure { max_unpacked_bytes, ..Structure::default() };
    let mut at = record::MAGIC.len() as u64;
    structure.truncated = loop {
        let Some((opcode, length)) = prefix(window.peek(at, PREFIX_BYTES as usize)?) else {
            break Some(format!("cut off at byte {at}: no footer"));
        };
        if !is_wanted(opcode) {
            break None;
        }
        let body = at + PREFIX_BYTES;
        if length > file_bytes - body {
            if opcode == op::CHUNK {
                structure.store_torn_chunk(window.peek(body, CHUNK_HEADER_BYTES)?, body, file_bytes);
            }
            break Some(format!("cut off at byte {at}: the record there is longer than the rest of the file"));
        }
        if opcode == op::FOOTER {
            let end = body + length;
            let magic = window.peek(end, record::MAGIC.len())? == record::MAGIC;
            break (!magic).then(|| format!("cut off at byte {end}: the magic bytes at the end are missing"));
        }
        match structure.store_record(&mut window, opcode, body, length) {
            Err(Unreadable::Damaged(reason)) => break Some(format!("damaged at byte {at}: {reason}")),
            stored => stored?,
        }
        at = body + length;
    };
    if structure.truncated.is_some() {
        structure.drop_last_index();
    }
    Ok(structure)
}

/// Parses opcode and length of a record; `None` for opcode 0 or too few bytes.
pub(super) fn prefix(bytes: &[u8]) -> Option<(u8, u64)> {
    let (opcode, length) = bytes.split_first()?;
    let opcode = (*opcode != 0).then_some(*opcode)?;
    Some((opcode, u64::from_le_bytes(length.try_into().ok()?)))
}

impl Structure {
    /// Stores the record whose body of `length` bytes begins at byte `body` of the file. Records of other kinds are
    /// skipped.
    ///
    /// # Errors
    ///
    /// [`Unreadable::Damaged`] when the record does not parse or exceeds a limit.
    fn store_record(&mut self, window: &mut Window<'_>, opcode: u8, body: u64, length: u64) -> Result<(), Unreadable> {
        let stored = match opcode {
            op::CHUNK => self.store_chunk(window.peek(body, clamped_length(length, CHUNK_HEADER_BYTES))?, body, length),
            op::MESSAGE_INDEX => self.store_index(window.peek(body, clamped_length(length, 6))?, body, length),
            op::MESSAGE => {
                self.store_loose_message(body, length);
                Ok(())
            }
            op::ATTACHMENT => self.store_attachment(window.peek(body, clamped_length(length, 1024))?, body, length),
            op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA => {
                self.count_description(length).map_err(Unreadable::Damaged)?;
                let bytes = window.peek(body, clamped_length(length, usize::MAX))?;
                self.describe(opcode, bytes).ok_or_else(|| "the record does not parse".into())
            }
            op::DATA_END => {
                let crc = Fields(window.peek(body, clamped_length(length, 4))?).u32().unwrap_or(0);
                self.data_end = Some((body - PREFIX_BYTES, crc));
                Ok(())
            }
            // The indexes of the summary and unknown records are not needed.
            _ => Ok(()),
        };
        stored.map_err(Unreadable::Damaged)
    }

    /// Counts a descriptive record of `length` bytes against the limit.
    ///
    /// # Errors
    ///
    /// A description when the limit is exceeded.
    pub(super) fn count_description(&mut self, length: u64) -> Result<(), String> {
        self.description_bytes = self.description_bytes.saturating_add(length);
        if self.description_bytes > MAX_DESCRIPTION_BYTES {
            return Err(format!("more than {MAX_DESCRIPTION_BYTES} bytes of schemas, channels and metadata"));
        }
        Ok(())
    }

    /// Stores a header, schema, channel or metadata record; `None` when it does not parse. Of several schemas or
    /// channels with one number, the first counts.
    pub(super) fn describe(&mut self, opcode: u8, body: &[u8]) -> Option<()> {
        match opcode {
            op::HEADER => {
                let mut fields = Fields(body);
                fields.text()?;
                self.library = fields.text()?.to_owned();
            }
            op::SCHEMA => {
                let (id, schema) = record::parse_schema(body)?;
                self.schemas.entry(id).or_insert(schema);
            }
            op::CHANNEL => {
                let (id, channel) = record::parse_channel(body)?;
                self.channels.entry(id).or_insert(channel);
            }
            _ => {
                let mut fields = Fields(body);
                let name = fields.text()?.to_owned();
                self.metadata.push((name, fields.map()?));
            }
        }
        Some(())
    }

    /// Stores a chunk as a section, from the first bytes of its record's body, which begins at byte `body` of the file
    /// and has `length` bytes.
    fn store_chunk(&mut self, head: &[u8], body: u64, length: u64) -> Result<(), String> {
        let header = record::parse_chunk_header(head).ok_or("the chunk header does not parse")?;
        let coding = coding(&header.compression).ok_or_else(|| {
            format!("chunk compression {:?} is not supported, only none, zstd and lz4", header.compression)
        })?;
        let room = length - header.bytes;
        if header.stored_bytes > room {
            return Err(format!("a chunk of {} bytes in a record with room for {room}", header.stored_bytes));
        }
        if coding != Coding::Plain {
            self.unpacked_bytes = self.unpacked_bytes.saturating_add(header.uncompressed_bytes);
        }
        if self.unpacked_bytes > self.max_unpacked_bytes {
            let max = self.max_unpacked_bytes;
            return Err(format!("more than {max} bytes after decompression, too many for a file of this size"));
        }
        let section = Section::plain(body + header.bytes, header.stored_bytes);
        let (uncompressed_bytes, crc) = (header.uncompressed_bytes, header.crc);
        self.sections.push(Section { coding, uncompressed_bytes, crc, ..section });
        Ok(())
    }

    /// Stores the chunk that was open when the file was cut off, as a section up to the end of the file: it has records
    /// but no sizes. A compressed one is ignored.
    fn store_torn_chunk(&mut self, head: &[u8], body: u64, file_bytes: u64) {
        let Some(header) = record::parse_chunk_header(head) else { return };
        // The rest of a compressed stream looks like damage.
        if coding(&header.compression) != Some(Coding::Plain) {
            return;
        }
        let offset = body + header.bytes;
        self.sections.push(Section { whole: false, ..Section::plain(offset, file_bytes - offset) });
    }

    /// Adds a message index to the chunk before it, from the first bytes of the record's body, which begins at byte
    /// `body` of the file and has `length` bytes.
    fn store_index(&mut self, head: &[u8], body: u64, length: u64) -> Result<(), String> {
        let mut fields = Fields(head);
        let parsed = fields.u16().zip(fields.u32());
        let (channel, bytes) = parsed.ok_or("the message index does not parse")?;
        if u64::from(bytes) > length - 6 || bytes % 16 != 0 {
            return Err(format!("a message index of {bytes} bytes in a record of {length}"));
        }
        let index = IndexRef { channel, offset: body + 6, entries: u64::from(bytes) / 16 };
        if let Some(section) = self.sections.last_mut() {
            section.index.push(index);
        }
        Ok(())
    }

    /// Adds a message outside any chunk to the section of those right before it, or to a new section. The body of its
    /// record has `length` bytes from byte `body` of the file on.
    fn store_loose_message(&mut self, body: u64, length: u64) {
        let (start, end) = (body - PREFIX_BYTES, body + length);
        match self.sections.last_mut() {
            Some(last) if last.is_loose() && last.offset + last.bytes == start => {
                last.bytes = end - last.offset;
                last.uncompressed_bytes = last.bytes;
            }
            _ => self.sections.push(Section::plain(start, end - start)),
        }
    }

    /// Stores name, type and place of an attachment, from the first bytes of the record's body, which begins at byte
    /// `body` of the file and has `length` bytes.
    fn store_attachment(&mut self, head: &[u8], body: u64, length: u64) -> Result<(), String> {
        if self.attachments.len() >= MAX_ATTACHMENTS {
            return Err(format!("more than {MAX_ATTACHMENTS} attachments"));
        }
        let mut fields = Fields(head);
        let parsed = (|| {
            fields.next_bytes(16)?;
            Some((fields.text()?.to_owned(), fields.text()?.to_owned(), fields.u64()?))
        })();
        let (name, media_type, content_bytes) = parsed.ok_or("the attachment does not parse")?;
        let header_bytes = (head.len() - fields.0.len()) as u64;
        if content_bytes.checked_add(header_bytes + 4) != Some(length) {
            return Err(format!("an attachment of {content_bytes} bytes in a record of {length}"));
        }
        self.attachments.push(AttachmentRef { name, media_type, body, header_bytes, content_bytes });
        Ok(())
    }

    /// Drops the index of the last chunk, which may be incomplete in a file that was cut off.
    fn drop_last_index(&mut self) {
        if let Some(last) = self.sections.last_mut() {
            last.index.clear();
        }
    }
}

/// Returns the encoding of a chunk by its name in the header, empty for uncompressed; `None` for an unsupported one.
fn coding(compression: &str) -> Option<Coding> {
    match compression {
        "" => Some(Coding::Plain),
        "zstd" => Some(Coding::Zstd),
        "lz4" => Some(Coding::Lz4),
        _ => None,
    }
}

/// Returns a length in a file, bytes, as one in memory, at most `limit`.
fn clamped_length(length: u64, limit: usize) -> usize {
    usize::try_from(length).unwrap_or(usize::MAX).min(limit)
}
