//! The MCAP container against the crate `mcap`.

use super::samples;
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use ricochet::recording::{Compression, Recording, WriterOptions, copy_as_ros2, copy_results, recover};
use std::fs;
use std::io::Cursor;

/// Chunks of a few frames.
const SMALL: WriterOptions = WriterOptions { compression: Compression::None, chunk_bytes: 4000, split_bytes: None };

/// Writes the same messages with the crate `mcap`, chunk for chunk.
fn again(ours: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut options = mcap::WriteOptions::new().compression(None).chunk_size(None);
    let mut writer: Option<mcap::Writer<Cursor<&mut Vec<u8>>>> = None;
    let mut to = Some(Cursor::new(&mut bytes));
    for record in mcap::read::LinearReader::new(ours).unwrap() {
        let writer = match record.unwrap() {
            Record::Header(header) => {
                options = options.profile(header.profile).library(header.library);
                writer = Some(options.clone().create(to.take().unwrap()).unwrap());
                continue;
            }
            Record::Metadata(metadata) => writer.as_mut().unwrap().write_metadata(&metadata).map(|()| None),
            Record::Attachment { header, data, .. } => {
                let mcap::records::AttachmentHeader { log_time, create_time, name, media_type } = header;
                let attachment = mcap::Attachment { log_time, create_time, name, media_type, data };
                writer.as_mut().unwrap().attach(&attachment).map(|()| None)
            }
            Record::Chunk { header, data } => {
                let writer = writer.as_mut().unwrap();
                for inner in mcap::read::ChunkReader::new(header, &data).unwrap() {
                    match inner.unwrap() {
                        Record::Schema { header, data } => {
                            let id = writer.add_schema(&header.name, &header.encoding, &data).unwrap();
                            assert_eq!(id, header.id);
                        }
                        Record::Channel(channel) => {
                            let (topic, encoding) = (&channel.topic, &channel.message_encoding);
                            let id = writer.add_channel(channel.schema_id, topic, encoding, &channel.metadata);
                            assert_eq!(id.unwrap(), channel.id);
                        }
                        Record::Message { header, data } => writer.write_to_known_channel(&header, &data).unwrap(),
                        other => panic!("{other:?} in a chunk"),
                    }
                }
                writer.flush().map(|()| None)
            }
            Record::MessageIndex(_) => Ok(None),
            Record::DataEnd(_) => writer.as_mut().unwrap().finish().map(Some),
            other => panic!("{other:?} among the data"),
        };
        if writer.unwrap().is_some() {
            break;
        }
    }
    drop(writer);
    bytes
}

/// Reads a whole file with all checksums and returns the number of checked chunks.
fn checked_chunks(bytes: &[u8]) -> usize {
    let options = LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true);
    let chunks = mcap::read::LinearReader::new(bytes).unwrap().filter(|record| match record.as_ref().unwrap() {
        Record::Chunk { header, .. } => {
            assert_ne!(header.uncompressed_crc, 0, "0 would be: not checked");
            true
        }
        Record::DataEnd(end) => {
            assert_ne!(end.data_section_crc, 0, "0 would be: not checked");
            false
        }
        _ => false,
    });
    let chunks = chunks.count();
    let (mut reader, mut rest) = (LinearReader::new_with_options(options), bytes);
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            LinearReadEvent::ReadRequest(count) => {
                let count = count.min(rest.len());
                reader.insert(count).copy_from_slice(&rest[..count]);
                reader.notify_read(count);
                rest = &rest[count..];
            }
            LinearReadEvent::Record { .. } => {}
        }
    }
    assert!(rest.is_empty(), "{} bytes behind the end", rest.len());
    chunks
}

#[test]
fn every_file_equals_that_of_the_mcap_crate_to_the_byte() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // Large frames are written without a copy. Of small ones, several share a chunk.
    samples::write(&path("small.mcap"), &SMALL, 30, [40, 30]).finish().unwrap();
    samples::write(&path("large.mcap"), &WriterOptions::default(), 40, [400, 300]).finish().unwrap();
    samples::write(&path("none.mcap"), &WriterOptions::default(), 0, [8, 8]).finish().unwrap();
    copy_as_ros2(&Recording::open(&path("large.mcap")).unwrap(), &path("ros2.mcap")).unwrap();
    let whole = fs::read(path("large.mcap")).unwrap();
    fs::write(path("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    recover(&path("cut.mcap"), &path("recovered.mcap")).unwrap();
    for (name, least) in [("small", 10), ("large", 2), ("none", 1), ("ros2", 2), ("recovered", 1)] {
        let ours = fs::read(path(&format!("{name}.mcap"))).unwrap();
        let chunks = checked_chunks(&ours);
        assert!(chunks >= least, "{name}: {chunks} chunks");
        let theirs = again(&ours);
        let first = ours.iter().zip(&theirs).position(|(a, b)| a != b);
        assert!(ours == theirs, "{name}: {} and {} bytes, first at {first:?}", ours.len(), theirs.len());
    }
}

#[test]
fn the_checksums_of_compressed_files_are_valid() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let options = WriterOptions { compression: Compression::Zstd1, ..SMALL };
    samples::write(&path, &options, 30, [40, 30]).finish().unwrap();
    assert!(checked_chunks(&fs::read(&path).unwrap()) >= 10);
    let results = folder.path().join("results.mcap");
    copy_results(&path, &results).unwrap();
    assert!(checked_chunks(&fs::read(&results).unwrap()) >= 2);
}

#[test]
#[should_panic(expected = "BadDataCrc")]
fn a_wrong_data_checksum_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &SMALL, 3, [8, 8]).finish().unwrap();
    let mut bytes = fs::read(&path).unwrap();
    // The byte changed is in the name of the program, which no other checksum covers.
    let at = bytes.windows(8).position(|window| window == b"ricochet").unwrap();
    bytes[at] ^= 1;
    checked_chunks(&bytes);
}
