//! Seeking in a large file without reading all of it.

use super::samples;
use super::speed::bytes_read;
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{Compression, Recording, RecordingInfo, RecordingWriter, WriterOptions};
use std::path::Path;

const FRAMES: u64 = 480;
const SIZE: [u32; 2] = [512, 512];

/// A shot of 126 MB: frames of 512 x 512 px at 2000 per second, and a velocity for each.
fn write(path: &Path, compression: Compression) -> u64 {
    let pool: Vec<_> = (0..8).map(|k| samples::frame(k, PixelFormat::Mono8, SIZE, 0).1).collect();
    let options = WriterOptions { compression, ..WriterOptions::default() };
    let mut writer = RecordingWriter::create(path, &RecordingInfo::default(), &options).unwrap();
    for sequence in 0..FRAMES {
        let (mut meta, _) = samples::frame(0, PixelFormat::Mono8, SIZE, 0);
        (meta.sequence, meta.stamp_ns) = (sequence, samples::START_NS + sequence * 500_000);
        let mut velocity = samples::velocity(sequence, 0);
        velocity.stamp_ns = meta.stamp_ns;
        writer.write_frame(&Frame { meta, bytes: &pool[sequence as usize % 8] }).unwrap();
        writer.write_velocity(&velocity).unwrap();
    }
    writer.finish().unwrap().bytes
}

#[test]
fn the_velocities_of_a_large_file_are_read_without_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let bytes = write(&path, Compression::None);
    assert!(bytes > 120_000_000);
    let before = bytes_read();
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.velocities().unwrap().map(Result::unwrap).count() as u64, FRAMES);
    let share = (bytes_read() - before) as f64 / bytes as f64;
    println!("/velocity, opening included: {:.2} % of {bytes} bytes", 100.0 * share);
    assert!(share <= 0.01, "{share}");
}

#[test]
fn the_metadata_of_a_recording_is_read_from_its_front() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &WriterOptions::default(), 40, [300, 300]).finish().unwrap();
    let before = bytes_read();
    let metadata = Recording::peek_metadata(&path).unwrap().unwrap();
    let read = bytes_read() - before;
    assert_eq!(&metadata, Recording::open(&path).unwrap().metadata());
    assert_eq!(metadata["camera"], "simulated");
    assert!(read <= 16_384, "{read} bytes");
    std::fs::write(&path, "frame,body").unwrap();
    assert_eq!(Recording::peek_metadata(&path).unwrap(), None);
}

#[test]
fn any_frame_is_found_by_reading_one_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    write(&path, Compression::None);
    let recording = Recording::open(&path).unwrap();
    let mut frames = recording.frames().unwrap();
    let mut at = 0;
    for number in [0, 1, 17, 18, 250, 479] {
        frames.skip_frames(number - at);
        let before = bytes_read();
        let (meta, pixels) = frames.next().unwrap().unwrap();
        let read = bytes_read() - before;
        assert_eq!(meta.sequence, number);
        assert_eq!(pixels, samples::frame(number % 8, PixelFormat::Mono8, SIZE, 0).1);
        assert!(read <= WriterOptions::default().chunk_bytes + 600_000, "frame {number}: {read} bytes");
        at = number + 1;
    }
    frames.skip_frames(3);
    assert!(frames.next().is_none(), "no frames behind the end");
}
