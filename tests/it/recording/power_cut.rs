//! Power cuts: of the writes since the last completed sync, each 512-byte sector may or may not have reached the disk.
//!
//! `strace` records the writes and syncs of a process that makes a recording. `RICOCHET_SEED` selects the first cut.

use super::recover::xorshift;
use super::samples;
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{Recording, RecordingWriter, WriterOptions, recover};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

const SIZE: [u32; 2] = [64, 48];
const FRAMES: u64 = 200;
/// Recorded time between two frames. The writer syncs once per second of it.
const PERIOD_NS: u64 = 50_000_000;
const SECTOR: usize = 512;
/// `.part` as strace prints it with `-xx`.
const PART: &str = r"\x2e\x70\x61\x72\x74";

/// An action of a process on its file.
#[derive(Debug)]
enum Step {
    Write {
        at: usize,
        data: Vec<u8>,
    },
    /// A sync that begins, by its number.
    SyncBegins(usize),
    SyncEnds(usize),
}

/// Writes a recording. Runs in its own process.
#[test]
#[ignore = "the victim of the next test"]
fn victim_that_records() {
    let Some(path) = std::env::var_os("RICOCHET_VICTIM") else { return };
    let options = WriterOptions { chunk_bytes: 60_000, ..WriterOptions::default() };
    let mut writer = RecordingWriter::create(Path::new(&path), &samples::info(), &options).unwrap();
    for sequence in 0..FRAMES {
        let (mut meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, SIZE, 0);
        meta.stamp_ns = samples::START_NS + sequence * PERIOD_NS;
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        writer.write_track(&samples::track(sequence)).unwrap();
        writer.write_buffered().unwrap();
    }
    writer.finish().unwrap();
}

/// Records what the victim does; `None` where it cannot be traced.
fn trace(folder: &Path) -> Option<Vec<Step>> {
    let log = folder.join("trace");
    let traced = Command::new("strace")
        .args(["-f", "-qq", "-y", "-xx", "-s", "1000000", "-e", "trace=write,writev,pwrite64,fdatasync,fsync", "-o"])
        .arg(&log)
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", "recording::power_cut::victim_that_records", "--ignored", "--nocapture"])
        .env("RICOCHET_VICTIM", folder.join("shot.mcap"))
        .output();
    match traced {
        Ok(output) if output.status.success() => {}
        Ok(output) => {
            eprintln!("left out: {}", String::from_utf8_lossy(&output.stderr));
            return None;
        }
        Err(error) => {
            eprintln!("left out: strace: {error}");
            return None;
        }
    }
    Some(steps(&fs::read_to_string(log).unwrap()))
}

fn steps(log: &str) -> Vec<Step> {
    let (mut steps, mut length, mut syncs) = (Vec::new(), 0, 0);
    let mut running: BTreeMap<&str, usize> = BTreeMap::new();
    for line in log.lines() {
        let Some((process, call)) = line.split_once(' ').map(|(process, call)| (process, call.trim_start())) else {
            continue;
        };
        if call.starts_with("<... f") {
            steps.extend(running.remove(process).map(Step::SyncEnds));
            continue;
        }
        let is_file = call.split_once('>').is_some_and(|(head, _)| head.contains(PART) || head.contains(".part"));
        if !is_file {
            continue;
        }
        if call.starts_with("fdatasync") || call.starts_with("fsync") {
            steps.push(Step::SyncBegins(syncs));
            match call.contains("unfinished") {
                true => drop(running.insert(process, syncs)),
                false => steps.push(Step::SyncEnds(syncs)),
            }
            syncs += 1;
            continue;
        }
        let data = data(call);
        let at = match call.strip_prefix("pwrite64") {
            Some(rest) => {
                let end = rest.find(" <unfinished").or_else(|| rest.rfind(") ")).unwrap();
                rest[..end].rsplit_once(", ").unwrap().1.trim_end_matches(')').parse().unwrap()
            }
            None => {
                length += data.len();
                length - data.len()
            }
        };
        steps.push(Step::Write { at, data });
    }
    steps
}

/// The bytes in the strings of a call, after the name of the file.
fn data(call: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    for text in call.split_once('>').unwrap().1.split('"').skip(1).step_by(2) {
        bytes.extend(text.split("\\x").skip(1).map(|byte| u8::from_str_radix(byte, 16).unwrap()));
    }
    bytes
}

fn put(image: &mut Vec<u8>, at: usize, data: &[u8]) {
    if image.len() < at + data.len() {
        image.resize(at + data.len(), 0);
    }
    image[at..at + data.len()].copy_from_slice(data);
}

/// Returns the bytes that are certainly on the disk after a cut behind `cut` steps, and those that may be.
fn cut_off(steps: &[Step], cut: usize, random: &mut impl FnMut(usize) -> usize) -> [Vec<u8>; 2] {
    let done = steps[..cut].iter().filter_map(|step| if let Step::SyncEnds(sync) = step { Some(*sync) } else { None });
    let last = done.max();
    let begins = steps.iter().position(|step| matches!(step, Step::SyncBegins(sync) if Some(*sync) == last));
    let (mut sure, mut image) = (Vec::new(), Vec::new());
    for (index, step) in steps[..cut].iter().enumerate() {
        let Step::Write { at, data } = step else { continue };
        if begins.is_some_and(|begins| index < begins) {
            put(&mut sure, *at, data);
            put(&mut image, *at, data);
            continue;
        }
        // A write reaches the disk whole, not at all, or in some of its sectors.
        let fate = random(3);
        let mut from = 0;
        while from < data.len() {
            let to = data.len().min(from + SECTOR - (at + from) % SECTOR);
            if fate == 0 || (fate == 1 && random(2) == 0) {
                put(&mut image, at + from, &data[from..to]);
            }
            from = to;
        }
    }
    [sure, image]
}

/// The numbers of the frames of a file, which are all right, if it can be opened.
fn numbers(path: &Path) -> Vec<u64> {
    let Ok(recording) = Recording::open(path) else { return Vec::new() };
    let Ok(frames) = recording.frames() else { return Vec::new() };
    let read = frames.map_while(Result::ok).map(|(meta, bytes)| {
        assert!(bytes == samples::frame(meta.sequence, PixelFormat::Mono8, SIZE, 0).1, "frame {}", meta.sequence);
        meta.sequence
    });
    read.collect()
}

fn cuts(count: u64) {
    let folder = tempfile::tempdir().unwrap();
    let Some(steps) = trace(folder.path()) else { return };
    let mut whole = Vec::new();
    for step in &steps {
        if let Step::Write { at, data } = step {
            put(&mut whole, *at, data);
        }
    }
    assert!(whole == fs::read(folder.path().join("shot.mcap")).unwrap(), "the trace has every write");
    let syncs = steps.iter().filter(|step| matches!(step, Step::SyncEnds(_))).count();
    assert!(syncs > 5, "{syncs} syncs");
    let first = std::env::var("RICOCHET_SEED").map_or(1, |seed| seed.parse().unwrap());
    let (mut promised, mut saved) = (0, 0);
    for seed in first..first + count {
        let mut random = xorshift(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        let cut = random(steps.len());
        let [sure, image] = cut_off(&steps, cut, &mut random);
        let (sure_path, path) = (folder.path().join("sure.mcap"), folder.path().join("cut.mcap"));
        fs::write(&sure_path, &sure).unwrap();
        fs::write(&path, &image).unwrap();
        let sure = numbers(&sure_path);
        let to = folder.path().join("recovered.mcap");
        let _ = fs::remove_file(&to);
        let outcome = recover(&path, &to);
        let read = numbers(&to);
        assert!(sure.is_empty() || outcome.is_ok(), "seed {seed}, cut {cut}: {outcome:?}");
        let missing: Vec<&u64> = sure.iter().filter(|number| !read.contains(number)).collect();
        assert!(missing.is_empty(), "seed {seed}, cut {cut}: {missing:?} were synced, {read:?} are recovered");
        if !read.is_empty() {
            let recording = Recording::open(&to).unwrap();
            let rows = recording.tracks().unwrap().map(Result::unwrap);
            rows.for_each(|row| assert_eq!(row, samples::track(row.frame), "seed {seed}: a wrong row"));
        }
        (promised, saved) = (promised + sure.len(), saved + read.len());
    }
    println!("{count} cuts, {syncs} syncs: {promised} frames were synced, {saved} recovered");
}

#[test]
#[ignore = "traces a process"]
fn after_a_power_cut_every_synced_frame_is_recovered() {
    cuts(20);
}

#[test]
#[ignore = "200 cuts"]
fn after_two_hundred_power_cuts_every_synced_frame_is_recovered() {
    cuts(200);
}
