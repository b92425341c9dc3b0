//! Files whose checksums are right and whose content is not, and small files that stand for large ones.

use super::damage::SMALL;
use super::samples;
use crate::support::run;
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{Recording, RecordingWriter};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const FOOTER: u8 = 2;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const MESSAGE_INDEX: u8 = 7;
const DATA_END: u8 = 15;

/// Writes small frames with these numbers.
fn film(folder: &Path, numbers: impl IntoIterator<Item = u64>) -> PathBuf {
    film_of(folder, [20, 10], numbers)
}

fn film_of(folder: &Path, size: [u32; 2], numbers: impl IntoIterator<Item = u64>) -> PathBuf {
    let path = folder.join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &samples::info(), &SMALL).unwrap();
    for (index, number) in (0..).zip(numbers) {
        let (mut meta, bytes) = samples::frame(index, PixelFormat::Mono8, size, 0);
        meta.sequence = number;
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        writer.write_track(&samples::track(number)).unwrap();
    }
    writer.finish().unwrap();
    path
}

/// The bodies of the records of a file outside chunks, with their kinds, up to the first that is longer than the file.
fn records(bytes: &[u8]) -> Vec<(u8, Range<usize>)> {
    records_within(bytes, 8..bytes.len())
}

fn records_within(bytes: &[u8], range: Range<usize>) -> Vec<(u8, Range<usize>)> {
    let (mut at, mut found) = (range.start, Vec::new());
    while at + 9 <= range.end {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        let Some(end) = (at + 9).checked_add(length).filter(|end| *end <= range.end) else { break };
        found.push((bytes[at], at + 9..end));
        at = end;
    }
    found
}

/// The number of images in our own recording, record by record and without its index; `None` for any other recording, a
/// compressed or a damaged one.
pub fn count_images(bytes: &[u8]) -> Option<usize> {
    let outer = records(bytes);
    let (FOOTER, last) = outer.last()? else { return None };
    let is_whole = last.end + 8 == bytes.len();
    let chunks = outer.iter().filter(|(kind, _)| *kind == CHUNK);
    let mut inner = Vec::new();
    for (_, body) in chunks {
        let content = body.start + 40..body.end;
        if content.start > content.end || bytes[body.start + 28..body.start + 32] != [0; 4] {
            return None;
        }
        let found = records_within(bytes, content.clone());
        if found.last().map_or(content.start, |(_, last)| last.end) != content.end {
            return None;
        }
        inner.extend(found);
    }
    let id = |body: &Range<usize>| bytes.get(body.start..body.start + 2).filter(|_| body.len() >= 2);
    let channels = |topic: &str| -> Vec<_> {
        let is_it = |body: &Range<usize>| bytes[body.clone()].get(8..8 + topic.len()) == Some(topic.as_bytes());
        inner.iter().filter(|(kind, body)| *kind == CHANNEL && is_it(body)).map(|(_, body)| id(body)).collect()
    };
    let count = |topic: &str| {
        let ids = channels(topic);
        inner.iter().filter(|(kind, body)| *kind == MESSAGE && ids.contains(&id(body))).count()
    };
    (is_whole && count("/camera/frame_info") > 0).then(|| count("/camera/image"))
}

/// Makes the checksums of a file right again, whatever it holds. Those of compressed chunks stay as they are.
pub fn seal(bytes: &mut [u8]) {
    for (kind, body) in records(bytes) {
        match kind {
            CHUNK if body.len() >= 40 && bytes[body.start + 28..body.start + 32] == [0; 4] => {
                let crc = crc32fast::hash(&bytes[body.start + 40..body.end]);
                bytes[body.start + 24..body.start + 28].copy_from_slice(&crc.to_le_bytes());
            }
            // No checksum of the data section, nor of the summary.
            DATA_END => bytes[body].fill(0),
            FOOTER if body.len() == 20 => bytes[body.end - 4..body.end].fill(0),
            _ => {}
        }
    }
}

/// Changes the records inside each chunk of our own uncompressed files and makes all checksums right again.
fn rewrite(path: &Path, change: impl Fn(&mut [u8])) {
    let mut bytes = std::fs::read(path).unwrap();
    for (_, body) in records(&bytes).iter().filter(|(kind, _)| *kind == CHUNK) {
        change(&mut bytes[body.start + 40..body.end]);
    }
    seal(&mut bytes);
    std::fs::write(path, bytes).unwrap();
}

fn first_error(path: &Path) -> String {
    let recording = Recording::open(path).unwrap();
    let error = recording.frames().unwrap().find_map(Result::err);
    error.unwrap_or_else(|| panic!("{path:?} is believed")).to_string()
}

#[test]
fn pixels_that_contradict_their_checksum_are_refused_though_the_chunk_is_right() {
    let folder = tempfile::tempdir().unwrap();
    let path = film(folder.path(), 0..12);
    assert_eq!(count_images(&std::fs::read(&path).unwrap()), Some(12));
    let pixels = samples::frame(7, PixelFormat::Mono8, [20, 10], 0).1;
    rewrite(&path, |records| {
        if let Some(at) = records.windows(pixels.len()).position(|window| window == pixels) {
            records[at + 33] ^= 1;
        }
    });
    let error = first_error(&path);
    assert!(error.contains("frame 7: its pixels are damaged: the CRC differs"), "{error}");
    let output = run(["analyze".as_ref(), path.as_os_str()]);
    assert_ne!(output.status.code(), Some(0));
}

#[test]
fn numbers_that_repeat_or_fall_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (numbers, wanted) in [
        ([0, 1, 2, 2, 3], "frame 3: number 2 in epoch 3 comes after number 2 in epoch 3, but numbers rise"),
        ([0, 1, 5, 4, 6], "frame 3: number 4 in epoch 3 comes after number 5 in epoch 3, but numbers rise"),
        ([0, 1, 2, 3, u64::MAX - 1], "frame 4: number 18446744073709551614 is larger than 4611686018427387904"),
    ] {
        let path = film(folder.path(), numbers);
        let error = first_error(&path);
        assert!(error.contains(wanted), "{error}");
        std::fs::remove_file(path).unwrap();
    }
}

/// Shortens every index of the channel with the most bytes per message, by `keep`.
fn hide(path: &Path, keep: impl Fn(u32) -> u32) {
    let mut bytes = std::fs::read(path).unwrap();
    let found = records(&bytes);
    for pair in found.windows(2) {
        // Each chunk of frames has its index right behind it.
        let [(CHUNK, chunk), (MESSAGE_INDEX, index)] = pair else { continue };
        if chunk.len() < 800 {
            continue;
        }
        let at = index.start + 2..index.start + 6;
        let length = u32::from_le_bytes(bytes[at.clone()].try_into().unwrap());
        bytes[at].copy_from_slice(&(keep(length / 16) * 16).to_le_bytes());
    }
    std::fs::write(path, &bytes).unwrap();
    rewrite(path, |_| {});
}

#[test]
fn an_index_that_hides_messages_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for keep in [(|entries| entries - 1) as fn(u32) -> u32, |_| 0] {
        let path = film(folder.path(), 0..12);
        let before = Recording::open(&path).unwrap().frame_count();
        hide(&path, keep);
        let recording = Recording::open(&path).unwrap();
        println!("{before} frames, {} listed", recording.frame_count());
        let error = match recording.frames() {
            Ok(mut frames) => frames.find_map(Result::err).expect("it is believed").to_string(),
            Err(error) => error.to_string(),
        };
        assert!(error.contains("but its index lists") || error.contains("frame information is missing"), "{error}");
        std::fs::remove_file(path).unwrap();
    }
}

/// A chunk of zeros, compressed, without an index.
fn bomb() -> Vec<u8> {
    let zeros = vec![0; 64 << 20];
    let packed = zstd::bulk::compress(&zeros, 19).unwrap();
    let mut body = vec![0; 16];
    body.extend((zeros.len() as u64).to_le_bytes());
    body.extend(0_u32.to_le_bytes());
    body.extend(4_u32.to_le_bytes());
    body.extend(b"zstd");
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    let mut record = vec![CHUNK];
    record.extend((body.len() as u64).to_le_bytes());
    record.extend(body);
    record
}

#[test]
fn a_megabyte_of_compressed_zeros_is_refused_soon() {
    let folder = tempfile::tempdir().unwrap();
    let path = film(folder.path(), 0..12);
    let mut bytes = std::fs::read(&path).unwrap();
    let end = records(&bytes).iter().find(|(kind, _)| *kind == DATA_END).unwrap().1.start - 9;
    let chunk = bomb();
    let chunks = (1 << 20) / chunk.len();
    assert!(chunks > 100, "{} bytes", chunk.len());
    bytes.splice(end..end, std::iter::repeat_n(chunk, chunks).flatten());
    std::fs::write(&path, &bytes).unwrap();
    let began = Instant::now();
    let output = run(["info".as_ref(), path.as_os_str()]);
    println!("{} bytes, {chunks} chunks: {:?}", bytes.len(), began.elapsed());
    assert!(began.elapsed() < Duration::from_secs(8), "{:?} on a machine that does other things too", began.elapsed());
    let printed = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(6), "{printed}");
    assert!(printed.contains("after decompression, too many for a file of this size"), "{printed}");
}

#[test]
fn a_jump_of_the_numbers_is_one_row_and_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let far = 1 << 45;
    let path = film_of(folder.path(), [96, 80], (0..16).chain(far..far + 16));
    let config = folder.path().join("rig.toml");
    std::fs::write(&config, "[camera]\nsource = \"simulated\"\n[scale]\nmm_per_px = 0.5\n").unwrap();
    let results = folder.path().join("results.mcap");
    let (path, config) = (path.to_str().unwrap(), config.to_str().unwrap());
    let output = run(["analyze", path, "--config", config, "-o", results.to_str().unwrap()]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(matches!(output.status.code(), Some(6 | 7)), "{:?} {stderr}", output.status);
    assert!(stderr.contains(&(far - 16).to_string()), "{stderr}");
    let rows: Vec<_> = Recording::open(&results).unwrap().velocities().unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 33, "a row per frame, and one for the gap");
}
