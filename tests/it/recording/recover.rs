//! Recovery of damaged files.

use super::samples;
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{Compression, Recording, RecordingError, RecordingWriter, WriterOptions, part_path, recover};
use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};

const SIZE: [u32; 2] = [300, 300];

/// Random numbers below a bound, from a seed.
pub fn xorshift(seed: u64) -> impl FnMut(usize) -> usize {
    let mut state = seed;
    move |below| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below.max(1) as u64) as usize
    }
}

fn frames(recording: &Recording) -> Vec<u64> {
    let frame = |frame: Result<_, _>| {
        let (meta, bytes): (ricochet::image::FrameMeta, Vec<u8>) = frame.unwrap();
        assert_eq!((meta, bytes), samples::frame(meta.sequence, PixelFormat::Mono8, SIZE, 0));
        meta.sequence
    };
    recording.frames().unwrap().map(frame).collect()
}

#[test]
fn a_killed_recording_is_recovered_with_every_frame_and_attachment() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &WriterOptions::default()).unwrap();
    for sequence in 0..60 {
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, SIZE, 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        writer.write_velocity(&samples::velocity(sequence, 0)).unwrap();
        if sequence == 40 {
            writer.sync().unwrap();
        }
    }
    writer.write_buffered().unwrap();
    std::mem::forget(writer);
    let before = fs::read(part_path(&path)).unwrap();

    let recovered = recover(&part_path(&path), &path).unwrap();
    assert_eq!((recovered.frames, recovered.skipped.len()), (60, 1), "{:?}", recovered.skipped);
    let recording = Recording::open(&path).unwrap();
    assert_eq!((recording.truncated(), recording.verify().unwrap()), (None, Vec::new()));
    assert_eq!(frames(&recording), (0..60).collect::<Vec<_>>());
    assert_eq!(recording.velocities().unwrap().count(), 41, "those written before the kill");
    assert_eq!(recording.config_toml(), Some(samples::info().config_toml.as_str()));
    assert_eq!(recording.bodies(), samples::info().bodies);
    assert_eq!(fs::read(part_path(&path)).unwrap(), before, "the old file is untouched");
    assert!(mcap::Summary::read(&fs::read(&path).unwrap()).unwrap().unwrap().stats.is_some());
}

#[test]
fn every_complete_frame_of_a_file_cut_at_random_is_recovered() {
    for compression in [Compression::None, Compression::Zstd1] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shot.mcap");
        let options = WriterOptions { compression, chunk_bytes: 300_000, split_bytes: None };
        samples::write(&path, &options, 20, SIZE).finish().unwrap();
        let whole = fs::read(&path).unwrap();
        for cut in (1..12).map(|k| whole.len() * k / 12 + 12_345 * k % 1000) {
            let (cut_path, to) = (folder.path().join("cut.mcap"), folder.path().join(format!("whole-{cut}.mcap")));
            fs::write(&cut_path, &whole[..cut]).unwrap();
            let before = Recording::open(&cut_path).unwrap().frames().map_or(0, |f| f.filter(Result::is_ok).count());
            let recovered = recover(&cut_path, &to).unwrap();
            assert_eq!(recovered.frames, before as u64, "cut at {cut}");
            // 4 frames per chunk, so an open compressed chunk loses at most that many.
            let complete = (cut.saturating_sub(20_000) / (whole.len() / 20)).saturating_sub(5);
            assert!(recovered.frames >= complete as u64, "cut at {cut}: {} frames", recovered.frames);
            let recording = Recording::open(&to).unwrap();
            assert_eq!((recording.truncated(), recording.verify().unwrap()), (None, Vec::new()));
            if before > 0 {
                assert_eq!(frames(&recording), (0..before as u64).collect::<Vec<_>>());
            }
        }
    }
}

#[test]
fn of_a_damaged_chunk_the_intact_frames_are_saved_and_the_rest_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    let options = WriterOptions { chunk_bytes: 100_000, ..WriterOptions::default() };
    samples::write(&path, &options, 12, SIZE).finish().unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let (_, pixels) = samples::frame(6, PixelFormat::Mono8, SIZE, 0);
    let at = bytes.windows(64).position(|window| window == &pixels[..64]).unwrap();
    bytes[at + 1000] ^= 0x10;
    fs::write(&path, &bytes).unwrap();
    let to = folder.path().join("whole.mcap");
    let recovered = recover(&path, &to).unwrap();
    let skipped = recovered.skipped.join(", ");
    assert!(
        skipped.contains("CRC") && skipped.contains("1 messages are incomplete or fail their checksum"),
        "{skipped}"
    );
    assert_eq!(frames(&Recording::open(&to).unwrap()), (0..12).filter(|frame| *frame != 6).collect::<Vec<_>>());
}

#[test]
fn recovering_never_overwrites() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &WriterOptions::default(), 2, [8, 8]).finish().unwrap();
    assert!(matches!(recover(&path, &path), Err(RecordingError::Refused { .. })));
}

/// Writes frames until killed, and prints the number of each written one. Runs in its own process.
#[test]
#[ignore = "the victim of the next test"]
fn victim_that_writes_frames() {
    let Some(path) = std::env::var_os("RICOCHET_VICTIM") else { return };
    let options = WriterOptions { chunk_bytes: 1 << 20, ..WriterOptions::default() };
    let mut writer = RecordingWriter::create(Path::new(&path), &samples::info(), &options).unwrap();
    let mut out = std::io::stdout().lock();
    for sequence in 0..2000 {
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, SIZE, 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        writer.write_track(&samples::track(sequence)).unwrap();
        writer.write_buffered().unwrap();
        writeln!(out, "taken {sequence}").unwrap();
    }
}

#[test]
fn every_frame_taken_before_a_kill_9_is_recovered() {
    let folder = tempfile::tempdir().unwrap();
    for round in 0..20_usize {
        let path = folder.path().join(format!("shot-{round}.mcap"));
        let mut victim = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "recording::recover::victim_that_writes_frames", "--ignored", "--nocapture"])
            .env("RICOCHET_VICTIM", &path)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        // Killed while it writes, at a different point each time.
        let lines = BufReader::new(victim.stdout.take().unwrap()).lines().map(Result::unwrap);
        let mut taken = lines.filter_map(|line| line.split("taken ").nth(1).and_then(|n| n.parse::<u64>().ok()));
        let seen = taken.nth(3 + round * 37 % 90).unwrap();
        victim.kill().unwrap();
        victim.wait().unwrap();
        let last = taken.last().unwrap_or(seen);

        let recovered = recover(&part_path(&path), &path).unwrap();
        assert!(recovered.frames > last, "{} frames of at least {}", recovered.frames, last + 1);
        let recording = Recording::open(&path).unwrap();
        assert_eq!((recording.truncated(), recording.verify().unwrap()), (None, Vec::new()));
        assert_eq!(frames(&recording), (0..recovered.frames).collect::<Vec<_>>());
        fs::remove_file(&path).unwrap();
        fs::remove_file(part_path(&path)).unwrap();
    }
}
