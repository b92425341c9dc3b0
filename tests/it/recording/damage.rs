//! Truncated, damaged and malicious files.

use super::samples;
use ricochet::command::info;
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{
    Compression, Recording, RecordingError, RecordingInfo, RecordingWriter, WriterOptions, part_path,
};

pub const SMALL: WriterOptions = WriterOptions { compression: Compression::None, chunk_bytes: 1500, split_bytes: None };

/// Reads a whole recording and returns the readable frames.
pub fn read_all(recording: &Recording) -> Vec<Vec<u8>> {
    let frames = recording.frames().map(|frames| frames.map_while(Result::ok).map(|(_, bytes)| bytes).collect());
    let _ = recording.velocities().map(Iterator::count);
    let _ = recording.truth().map(Iterator::count);
    let _ = recording.tracks().map(Iterator::count);
    let _ = recording.fields().map(Iterator::count);
    let _ = recording.impacts().map(Iterator::count);
    let _ = recording.events().map(Iterator::count);
    let _ = recording.statuses().map(Iterator::count);
    let _ = (recording.topics(), recording.last_frame(), info::inspect(recording));
    let _ = Recording::peek_metadata(recording.path());
    frames.unwrap_or_default()
}

#[test]
fn a_file_truncated_anywhere_gives_the_frames_before_the_cut() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &SMALL).unwrap();
    for sequence in 0..12 {
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, [20, 10], 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        writer.write_track(&samples::track(sequence)).unwrap();
    }
    writer.finish().unwrap();
    let whole = std::fs::read(&path).unwrap();
    let frames: Vec<_> = (0..12).map(|k| samples::frame(k, PixelFormat::Mono8, [20, 10], 0).1).collect();
    let cut = folder.path().join("cut.mcap");
    let mut most = 0;
    for length in 0..whole.len() {
        std::fs::write(&cut, &whole[..length]).unwrap();
        let Ok(recording) = Recording::open(&cut) else {
            assert!(length < 8, "only a file without its magic bytes is refused, not {length} bytes");
            continue;
        };
        let reason = recording.truncated().expect("a reason for the cut").to_owned();
        assert!(reason.contains("cut off at byte"), "{reason}");
        let read = read_all(&recording);
        assert_eq!(read, frames[..read.len()], "cut at {length}");
        assert!(read.len() >= most, "cut at {length}: {} frames, {most} in a shorter piece", read.len());
        most = read.len();
    }
    assert_eq!(most, 12);
}

#[test]
fn a_killed_writer_loses_no_accepted_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
    // 23 frames of 90 kB. The last chunk is open, and its header has no length yet.
    for sequence in 0..23 {
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, [300, 300], 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    }
    writer.write_buffered().unwrap();
    std::mem::forget(writer);
    let recording = Recording::open(&part_path(&path)).unwrap();
    assert!(recording.truncated().is_some());
    let read: Vec<_> = recording.frames().unwrap().map(Result::unwrap).collect();
    let written: Vec<_> = (0..23).map(|k| samples::frame(k, PixelFormat::Mono8, [300, 300], 0)).collect();
    assert_eq!(read, written);
    assert_eq!(recording.config_toml(), Some(samples::info().config_toml.as_str()));
}

#[test]
fn a_flipped_bit_in_a_frame_is_an_error_and_never_a_wrong_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &SMALL, 12, [20, 10]).finish().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let (_, pixels) = samples::frame(6, PixelFormat::Mono8, [20, 10], 0);
    let at = bytes.windows(pixels.len()).position(|window| window == pixels).unwrap();
    bytes[at + 100] ^= 4;
    std::fs::write(&path, &bytes).unwrap();
    let recording = Recording::open(&path).unwrap();
    let read: Vec<_> = recording.frames().unwrap().collect();
    let errors: Vec<_> = read.iter().filter_map(|frame| frame.as_ref().err()).map(ToString::to_string).collect();
    assert_eq!(errors.len(), 1, "one error for the damaged chunk: {errors:?}");
    assert!(errors[0].contains("CRC"), "{errors:?}");
    for (meta, bytes) in read.into_iter().flatten() {
        assert_eq!(bytes, samples::frame(meta.sequence, PixelFormat::Mono8, [20, 10], 0).1);
    }
    assert_eq!(recording.verify().unwrap().len(), 2, "the chunk and the data section");
}

#[test]
fn a_flipped_bit_behind_an_unfinished_chunk_header_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default()).unwrap();
    let (meta, pixels) = samples::frame(0, PixelFormat::Mono8, [300, 300], 0);
    writer.write_frame(&Frame { meta, bytes: &pixels }).unwrap();
    writer.write_buffered().unwrap();
    std::mem::forget(writer);
    let part = part_path(&path);
    let mut bytes = std::fs::read(&part).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&part, &bytes).unwrap();
    let error = Recording::open(&part).unwrap().frames().unwrap().next().unwrap().unwrap_err();
    assert!(error.to_string().contains("damaged"), "{error}");
}

#[test]
fn files_that_are_no_recording_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        Recording::open(&path).unwrap_err().to_string()
    };
    for (name, content, reason) in [
        ("empty.mcap", &b""[..], "the file is empty"),
        ("text.mcap", b"frame,body\n1,2\n", "not an MCAP file"),
        ("short.mcap", b"\x89MCAP0", "not an MCAP file"),
    ] {
        let line = refusal(name, content);
        assert!(line.contains(name) && line.contains(reason) && !line.contains('\n'), "{line}");
    }
    let missing = Recording::open(&folder.path().join("missing.mcap")).unwrap_err();
    assert!(matches!(missing, RecordingError::Io { action: "open", .. }), "{missing}");
    let directory = Recording::open(folder.path()).unwrap_err();
    assert!(directory.to_string().contains("it is a folder"), "{directory}");
}
