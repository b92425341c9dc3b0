//! The summary at the end of a file: its content with offsets.

use super::layout::{self, number, numbers, record, text};
use crate::recording::record::{Channel, MessageHeader, Schema, op};
use std::collections::BTreeMap;
use std::io;

/// The index entry of a chunk.
pub(super) struct ChunkIndex {
    /// First and last log time of its messages.
    pub(super) times: [u64; 2],
    /// Offset of its record.
    pub(super) start: u64,
    /// Length of the record with its prefix.
    pub(super) length: u64,
    /// Offset of its message index, by channel.
    pub(super) index_offsets: BTreeMap<u16, u64>,
    pub(super) index_bytes: u64,
    pub(super) compression: &'static str,
    pub(super) stored_bytes: u64,
    pub(super) plain_bytes: u64,
}

/// The index entry of an attachment.
pub(super) struct AttachmentIndex {
    pub(super) offset: u64,
    pub(super) length: u64,
    pub(super) content_bytes: u64,
    pub(super) name: String,
    pub(super) media_type: String,
}

/// The index entry of a metadata record.
pub(super) struct MetadataIndex {
    pub(super) offset: u64,
    pub(super) length: u64,
    pub(super) name: String,
}

/// The content of the summary.
#[derive(Default)]
pub(super) struct Summary {
    pub(super) chunks: Vec<ChunkIndex>,
    pub(super) attachments: Vec<AttachmentIndex>,
    pub(super) metadata: Vec<MetadataIndex>,
    /// Messages by channel.
    counts: BTreeMap<u16, u64>,
    /// First and last log time.
    times: Option<(u64, u64)>,
}

impl Summary {
    /// Counts a message.
    pub(super) fn count(&mut self, header: &MessageHeader) {
        let time = header.log_time_ns;
        let (first, last) = self.times.unwrap_or((time, time));
        self.times = Some((first.min(time), last.max(time)));
        *self.counts.entry(header.channel).or_default() += 1;
    }

    /// Encodes the summary, which begins at byte `start`, and the footer.
    pub(super) fn write(&self, start: u64, schemas: &[Schema], channels: &[Channel]) -> io::Result<Vec<u8>> {
        let mut out = Vec::new();
        let mut groups = Vec::new();
        let mut group = |out: &mut Vec<u8>, opcode: u8, from: usize| {
            if out.len() > from {
                groups.push((opcode, start + from as u64, (out.len() - from) as u64));
            }
        };
        for (id, schema) in (1..).zip(schemas) {
            record(&mut out, op::SCHEMA, |out| layout::schema(out, id, schema))?;
        }
        group(&mut out, op::SCHEMA, 0);
        let from = out.len();
        for (id, channel) in (1..).zip(channels) {
            record(&mut out, op::CHANNEL, |out| layout::channel(out, id, channel))?;
        }
        group(&mut out, op::CHANNEL, from);
        let from = out.len();
        record(&mut out, op::STATISTICS, |out| self.statistics(out, schemas.len(), channels.len()))?;
        group(&mut out, op::STATISTICS, from);
        let from = out.len();
        for index in &self.chunks {
            record(&mut out, op::CHUNK_INDEX, |out| chunk(out, index))?;
        }
        group(&mut out, op::CHUNK_INDEX, from);
        let from = out.len();
        for index in &self.attachments {
            record(&mut out, op::ATTACHMENT_INDEX, |out| attachment(out, index))?;
        }
        group(&mut out, op::ATTACHMENT_INDEX, from);
        let from = out.len();
        for index in &self.metadata {
            record(&mut out, op::METADATA_INDEX, |out| {
                out.extend(index.offset.to_le_bytes());
                out.extend(index.length.to_le_bytes());
                text(out, &index.name)
            })?;
        }
        group(&mut out, op::METADATA_INDEX, from);
        let offsets = start + out.len() as u64;
        for (opcode, from, length) in groups {
            record(&mut out, op::SUMMARY_OFFSET, |out| {
                out.push(opcode);
                out.extend(from.to_le_bytes());
                out.extend(length.to_le_bytes());
                Ok(())
            })?;
        }
        footer(&mut out, start, offsets);
        Ok(out)
    }

    fn statistics(&self, out: &mut Vec<u8>, schemas: usize, channels: usize) -> io::Result<()> {
        let (first, last) = self.times.unwrap_or((0, 0));
        out.extend(self.counts.values().sum::<u64>().to_le_bytes());
        out.extend(number::<u16>(schemas)?.to_le_bytes());
        for count in [channels, self.attachments.len(), self.metadata.len(), self.chunks.len()] {
            out.extend(number::<u32>(count)?.to_le_bytes());
        }
        out.extend(first.to_le_bytes());
        out.extend(last.to_le_bytes());
        numbers(out, &self.counts)
    }
}

fn chunk(out: &mut Vec<u8>, index: &ChunkIndex) -> io::Result<()> {
    for value in [index.times[0], index.times[1], index.start, index.length] {
        out.extend(value.to_le_bytes());
    }
    numbers(out, &index.index_offsets)?;
    out.extend(index.index_bytes.to_le_bytes());
    text(out, index.compression)?;
    out.extend(index.stored_bytes.to_le_bytes());
    out.extend(index.plain_bytes.to_le_bytes());
    Ok(())
}

fn attachment(out: &mut Vec<u8>, index: &AttachmentIndex) -> io::Result<()> {
    // Log time and creation time are 0, as in the attachment itself.
    for value in [index.offset, index.length, 0, 0, index.content_bytes] {
        out.extend(value.to_le_bytes());
    }
    text(out, &index.name)?;
    text(out, &index.media_type)
}

/// Appends the footer. Its CRC covers the summary and the footer before it.
fn footer(out: &mut Vec<u8>, start: u64, offsets: u64) {
    out.push(op::FOOTER);
    for value in [20, start, offsets] {
        out.extend(value.to_le_bytes());
    }
    let crc = crc32fast::hash(out);
    out.extend(crc.to_le_bytes());
}
