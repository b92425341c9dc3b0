//! The summary at the end of a file: its content with offsets.

use super::layout::{self, Body};
use crate::recording::record::{Channel, MessageHeader, Schema, op};
use std::collections::BTreeMap;

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
    pub(super) schemas: Vec<Schema>,
    pub(super) channels: Vec<Channel>,
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

    /// Encodes the summary, which begins at byte `start` of the file, its offsets and the footer with their CRC-32.
    /// Empty groups of records are left out.
    pub(super) fn encode(&self, start: u64) -> Vec<u8> {
        let groups: [(u8, Vec<u8>); 6] = [
            (op::SCHEMA, (1..).zip(&self.schemas).flat_map(|(id, schema)| layout::encode_schema(id, schema)).collect()),
            (
                op::CHANNEL,
                (1..).zip(&self.channels).flat_map(|(id, channel)| layout::encode_channel(id, channel)).collect(),
            ),
            (op::STATISTICS, self.statistics()),
            (op::CHUNK_INDEX, self.chunks.iter().flat_map(ChunkIndex::record).collect()),
            (op::ATTACHMENT_INDEX, self.attachments.iter().flat_map(AttachmentIndex::record).collect()),
            (op::METADATA_INDEX, self.metadata.iter().flat_map(MetadataIndex::record).collect()),
        ];
        let (mut out, mut offsets) = (Vec::new(), Vec::new());
        for (opcode, records) in groups.into_iter().filter(|(_, records)| !records.is_empty()) {
            let group = [start + out.len() as u64, records.len() as u64];
            offsets.extend(Body::default().bytes(&[opcode]).u64s(group).record(op::SUMMARY_OFFSET));
            out.extend(records);
        }
        let offsets_start = start + out.len() as u64;
        out.extend(offsets);
        // The CRC of the footer covers the summary and the footer before it.
        out.extend(layout::prefix(op::FOOTER, 20));
        Body::default().bytes(&out).u64(start).u64(offsets_start).crc(0).into_bytes()
    }

    /// Encodes the record with the counts of messages, schemas, channels and the other records.
    fn statistics(&self) -> Vec<u8> {
        let (first, last) = self.times.unwrap_or((0, 0));
        let counts = [self.channels.len(), self.attachments.len(), self.metadata.len(), self.chunks.len()];
        let body = Body::default().u64(self.counts.values().sum()).u16(self.schemas.len() as u16);
        let body = counts.into_iter().fold(body, |body, count| body.u32(count as u32));
        body.u64(first).u64(last).numbers(&self.counts).record(op::STATISTICS)
    }
}

impl ChunkIndex {
    /// Encodes the index record of a chunk.
    fn record(&self) -> Vec<u8> {
        let body = Body::default().u64s(self.times).u64(self.start).u64(self.length).numbers(&self.index_offsets);
        let body = body.u64(self.index_bytes).text(self.compression).u64(self.stored_bytes).u64(self.plain_bytes);
        body.record(op::CHUNK_INDEX)
    }
}

impl AttachmentIndex {
    /// Encodes the index record of an attachment.
    fn record(&self) -> Vec<u8> {
        // Log time and creation time are 0, as in the attachment itself.
        let body = Body::default().u64s([self.offset, self.length, 0, 0, self.content_bytes]);
        body.text(&self.name).text(&self.media_type).record(op::ATTACHMENT_INDEX)
    }
}

impl MetadataIndex {
    /// Encodes the index record of a metadata record.
    fn record(&self) -> Vec<u8> {
        Body::default().u64(self.offset).u64(self.length).text(&self.name).record(op::METADATA_INDEX)
    }
}
