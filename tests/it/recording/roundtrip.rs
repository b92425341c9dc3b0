//! Values written and read, equal to the last bit.

use super::samples;
use crate::support::run;
use ricochet::image::{Frame, FrameMeta, PixelFormat};
use ricochet::recording::{
    Compression, Recording, RecordingError, RecordingInfo, RecordingWriter, WriterOptions, part_path,
};
use std::collections::BTreeSet;
use std::fmt::Debug;
use std::path::Path;

/// Compares by `{:?}`, which shows every bit of a float and the sign of zero. `==` does not.
fn assert_same<T: Debug>(read: impl Iterator<Item = Result<T, RecordingError>>, written: impl Iterator<Item = T>) {
    let (read, written): (Vec<_>, Vec<_>) = (read.map(Result::unwrap).collect(), written.collect());
    assert_eq!(format!("{read:?}"), format!("{written:?}"));
}

#[test]
fn every_row_is_read_to_the_last_bit_plain_and_compressed() {
    for compression in [Compression::None, Compression::Zstd1] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shot.mcap");
        let options = WriterOptions { compression, ..WriterOptions::default() };
        let finished = samples::write(&path, &options, 30, [40, 30]).finish().unwrap();
        assert_eq!((finished.frames, finished.bytes), (30, path.metadata().unwrap().len()));
        assert!(!part_path(&path).exists());

        let recording = Recording::open(&path).unwrap();
        assert_eq!(recording.truncated(), None);
        assert_eq!(recording.verify().unwrap(), Vec::<String>::new());
        assert_same(recording.velocities().unwrap(), (0..30).map(|k| samples::velocity(k, 0)));
        assert_same(recording.truth().unwrap(), (0..30).map(|k| samples::velocity(k, 1)));
        assert_same(recording.tracks().unwrap(), (0..30).map(samples::track));
        assert_same(recording.fields().unwrap(), (0..30).map(samples::field));
        assert_same(recording.impacts().unwrap(), [samples::impact(0, 0)].into_iter());
        assert_same(recording.truth_impacts().unwrap(), [samples::impact(0, 1)].into_iter());
        assert_same(recording.events().unwrap(), [samples::event(0)].into_iter());
        assert_same(recording.statuses().unwrap(), [samples::status(0)].into_iter());
        let info = samples::info();
        assert_eq!(recording.config_toml(), Some(info.config_toml.as_str()));
        assert_eq!(recording.bodies(), info.bodies);
        assert_eq!(recording.metadata()["camera"], "simulated");
        assert_eq!(recording.attachment("calibration.json").unwrap(), b"{}");
    }
}

#[test]
fn frames_of_every_format_are_read_with_header_and_padding() {
    for format in PixelFormat::ALL {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shot.mcap");
        let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default()).unwrap();
        // Beyond 32 bits, which the message's own counter cannot hold.
        let sequences = [7, 8, 11, (1 << 40) + 5];
        for sequence in sequences {
            let (meta, bytes) = samples::frame(sequence, format, [33, 21], 6);
            writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        }
        writer.finish().unwrap();
        let recording = Recording::open(&path).unwrap();
        assert_eq!(recording.frame_count(), 4);
        let read: Vec<_> = recording.frames().unwrap().map(Result::unwrap).collect();
        let written = sequences.map(|sequence| samples::frame(sequence, format, [33, 21], 6));
        assert_eq!(read, written);
    }
}

#[test]
fn a_frame_that_contradicts_its_header_is_refused_and_the_recording_continues() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default()).unwrap();
    let (meta, bytes) = samples::frame(0, PixelFormat::Mono8, [8, 8], 0);
    let error = writer.write_frame(&Frame { meta, bytes: &bytes[1..] }).unwrap_err().to_string();
    assert!(error.contains("63 bytes") && error.contains("8x8 Mono8"), "{error}");
    writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    assert_eq!(writer.finish().unwrap().frames, 1);
}

#[test]
fn neither_a_recording_nor_an_unfinished_one_is_ever_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let create = || RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default());
    let first = create().unwrap();
    assert!(matches!(create(), Err(RecordingError::Refused { .. })), "the part file exists");
    std::fs::write(&path, "someone else's").unwrap();
    assert!(matches!(first.finish(), Err(RecordingError::Refused { .. })), "the name was taken meanwhile");
    assert_eq!(std::fs::read(&path).unwrap(), b"someone else's");
    assert!(Recording::open(&part_path(&path)).unwrap().truncated().is_none(), "nothing is lost");
    std::fs::remove_file(part_path(&path)).unwrap();
    assert!(matches!(create(), Err(RecordingError::Refused { .. })), "the file exists");
}

#[test]
fn a_dropped_writer_leaves_everything_in_the_part_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    drop(samples::write(&path, &WriterOptions::default(), 5, [16, 16]));
    assert!(!path.exists());
    let recording = Recording::open(&part_path(&path)).unwrap();
    assert_eq!(recording.frames().unwrap().count(), 5);
    assert_eq!(recording.velocities().unwrap().count(), 5);
    assert_eq!(recording.statuses().unwrap().count(), 1);
}

#[test]
fn frames_fields_and_rows_never_share_a_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &WriterOptions::default(), 3000, [24, 24]).finish().unwrap();
    let chunks = chunk_topics(&path);
    assert!(chunks.len() > 6, "3 x 100 ms make several batches: {chunks:?}");
    let kinds: [&[&str]; 3] = [
        &["/camera/image", "/camera/frame_info"],
        &["/field", "/camera/annotations"],
        &["/velocity", "/truth", "/track", "/impact", "/truth_impact", "/events", "/status"],
    ];
    for chunk in chunks {
        let fits = |kind: &&[&str]| chunk.iter().all(|topic| kind.contains(&topic.as_str()));
        assert!(!chunk.is_empty() && kinds.iter().any(fits), "{chunk:?}");
    }
}

/// The topics of each chunk, read with another reader.
fn chunk_topics(path: &Path) -> Vec<BTreeSet<String>> {
    let summary = mcap::Summary::read(&std::fs::read(path).unwrap()).unwrap().unwrap();
    let topics = |index: &mcap::records::ChunkIndex| {
        index.message_index_offsets.keys().map(|id| summary.channels[id].topic.clone()).collect()
    };
    summary.chunk_indexes.iter().map(topics).collect()
}

#[test]
fn frames_that_are_left_are_counted_without_their_information() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &WriterOptions::default(), 12, [8, 6]).finish().unwrap();
    let mut frames = Recording::open(&path).unwrap().frames().unwrap();
    for left in (0..12).rev() {
        frames.next().unwrap().unwrap();
        assert_eq!(frames.left(), left);
    }
}

#[test]
fn the_rate_of_a_camera_that_was_opened_again_is_that_of_the_time_between() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
    for (epoch, sequence) in [(3, 0), (3, 1), (3, 4), (4, 40), (4, 41), (5, 90)] {
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, [8, 6], 0);
        // Nobody knows how long it was closed.
        let meta = FrameMeta { epoch, stamp_ns: meta.stamp_ns + 777 * u64::from(epoch), ..meta };
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    }
    writer.finish().unwrap();
    let output = run(["info".as_ref(), path.as_os_str()]);
    let words = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(6), "frames are missing: {words}");
    assert!(words.contains("6 of 8x6 Mono8, 10000.000 frames/s"), "{words}");
}
