//! Files changed at random: each reader refuses or reads them, without a panic and within its memory.

use super::damage::{SMALL, read_all};
use super::recover::xorshift;
use super::{compressed, film, lies, samples};
use crate::allocation::largest_bytes;
use crate::import;
use ricochet::image::FrameMeta;
use ricochet::recording::{Compression, Recording, WriterOptions, copy_as_ros2, copy_results, recover};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// The largest allocation of a reader, in addition to twice the size of the file.
const PIECE_BYTES: usize = 64 << 20;
/// The memory of the process, kB: 64 MiB for what is read, as much for its decoder, since the files have a few kB, and
/// 16 MiB for everything else, including the memory of C libraries.
const MEMORY_KB: u32 = 144 << 10;
/// The processor time of a reader per file.
const TIME: Duration = Duration::from_secs(2);
/// The variable for the process that does the work: rounds, or seconds followed by `s`.
const BUDGET: &str = "RICOCHET_MUTATE";
/// The variable with the duration of the ignored tests, s.
const SECONDS: &str = "RICOCHET_MUTATE_SECONDS";

/// The budget of a test.
enum Budget {
    Rounds(usize),
    Time(Duration),
}

impl Budget {
    /// The budget from the environment, or `None` in the process that only starts the one that works.
    fn from_environment() -> Option<Self> {
        let text = std::env::var(BUDGET).ok()?;
        Some(match text.strip_suffix('s') {
            Some(seconds) => Self::Time(Duration::from_secs_f64(seconds.parse().unwrap())),
            None => Self::Rounds(text.parse().unwrap()),
        })
    }

    fn is_left(&self, round: usize, start: Instant) -> bool {
        match self {
            Self::Rounds(rounds) => round < *rounds,
            Self::Time(time) => start.elapsed() < *time,
        }
    }
}

/// Runs a test of this module in its own process with a limit on its memory.
fn limited(test: &str, budget: &str) {
    let status = Command::new("sh")
        .args(["-c", &format!("ulimit -d {MEMORY_KB}; exec \"$0\" \"$@\"")])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", &format!("recording::mutation::{test}"), "--test-threads=1", "--nocapture"])
        .env(BUDGET, budget)
        // With no memory left, a backtrace never ends.
        .env("RUST_BACKTRACE", "0")
        .status()
        .unwrap();
    assert!(status.success(), "{status}; the file is the newest in {}", env!("CARGO_TARGET_TMPDIR"));
}

/// The budget of the ignored tests.
fn long() -> String {
    format!("{}s", std::env::var(SECONDS).unwrap_or_else(|_| "600".into()))
}

/// The path at which the file of a failed round stays.
fn kept(test: &str, ending: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("mutated-{test}{ending}"))
}

/// The processor time of this thread.
fn processor_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// Changes seeds and reads them with `read`, which returns the number of frames. `seal` makes the checksums of every
/// other file right again.
fn mutate_and_read(
    test: &str,
    seeds: &[(&str, Vec<u8>)],
    budget: &Budget,
    seal: impl Fn(&mut [u8]),
    read: impl Fn(&Path) -> usize,
) {
    let mut random = xorshift(0x2545_f491_4f6c_dd1d);
    let (start, mut round, mut frames) = (Instant::now(), 0, 0);
    let (mut largest, mut longest) = (0, Duration::ZERO);
    while budget.is_left(round, start) {
        let (ending, seed) = &seeds[round % seeds.len()];
        let mut bytes = seed.clone();
        for _ in 0..=random(4) {
            mutate(&mut bytes, &mut random);
        }
        if random(2) == 0 {
            seal(&mut bytes);
        }
        let path = kept(test, ending);
        std::fs::write(&path, &bytes).unwrap();
        let began = processor_time();
        let (outcome, piece_bytes) = largest_bytes(|| catch_unwind(AssertUnwindSafe(|| read(&path))));
        assert!(piece_bytes <= 2 * bytes.len() + PIECE_BYTES, "round {round}, {}: {piece_bytes}", path.display());
        let time = processor_time() - began;
        assert!(time < TIME, "round {round}, {}: {time:?}", path.display());
        (largest, longest) = (largest.max(piece_bytes), longest.max(time));
        match outcome {
            Ok(count) => frames += count,
            Err(_) => panic!("round {round}: {}", path.display()),
        }
        round += 1;
    }
    for (ending, _) in seeds {
        let _ = std::fs::remove_file(kept(test, ending));
    }
    println!("{test}: {round} files, {frames} frames read, largest allocation {largest} bytes, longest {longest:?}");
    assert!(8 * frames > round, "many mutations leave frames to read: {frames} in {round} files");
}

fn mutate(bytes: &mut Vec<u8>, random: &mut impl FnMut(usize) -> usize) {
    if bytes.len() < 16 {
        return;
    }
    let at = random(bytes.len() - 8);
    match random(7) {
        0 => bytes[at] ^= 1 << random(8),
        1 => bytes[at] = [0, 1, 0x7f, 0x80, 0xff, b'0', b'9'][random(7)],
        2 => bytes[at..at + 8].copy_from_slice(&[u64::MAX, 1 << 31, 1 << 40, 9, 0][random(5)].to_le_bytes()),
        3 => bytes[at..at + 4].copy_from_slice(&[u32::MAX, 1 << 30, 16, 0][random(4)].to_le_bytes()),
        4 => bytes[at..at + 4].copy_from_slice(&[1_u32 << 28, 65_535, 256, 8][random(4)].to_be_bytes()),
        5 => bytes.truncate(at),
        _ => {
            let piece = bytes[at..(at + 1 + random(200)).min(bytes.len())].to_vec();
            let to = random(bytes.len());
            bytes.splice(to..to, piece);
        }
    }
}

/// A small file of every kind.
pub fn recordings(folder: &Path) -> Vec<(&'static str, Vec<u8>)> {
    let mut seeds = Vec::new();
    for (index, compression) in [Compression::None, Compression::Zstd1].into_iter().enumerate() {
        let path = folder.join(format!("seed-{index}.mcap"));
        samples::write(&path, &WriterOptions { compression, ..SMALL }, 3, [8, 4]).finish().unwrap();
        seeds.push((".mcap", std::fs::read(&path).unwrap()));
    }
    for (compression, chunks) in [(None, false), (Some(mcap::Compression::Lz4), true)] {
        let options = mcap::WriteOptions::new().compression(compression).use_chunks(chunks);
        let images = [super::foreign::image("mono8", 4, 2, 4, 8); 2];
        seeds.push((".mcap", super::foreign::file(options, &images)));
    }
    let (shot, bag) = (folder.join("seed-0.mcap"), folder.join("seed-ros2.mcap"));
    copy_as_ros2(&Recording::open(&shot).unwrap(), &bag).unwrap();
    seeds.push((".mcap", std::fs::read(bag).unwrap()));
    seeds.extend(compressed::seeds().map(|seed| (".mcap", seed)));
    seeds
}

/// Checks a recording that is read without any error: its numbers rise, and none of its images is left out.
fn check_frames(recording: &Recording) {
    let Ok(frames) = recording.frames() else { return };
    let frames: Result<Vec<_>, _> = frames.collect();
    let (Ok(frames), None) = (frames, recording.truncated()) else { return };
    let number = |meta: &FrameMeta| (meta.epoch, meta.sequence);
    assert!(frames.windows(2).all(|pair| number(&pair[0].0) < number(&pair[1].0)), "numbers that fall are believed");
    if let Some(images) = lies::count_images(&std::fs::read(recording.path()).unwrap()) {
        assert_eq!(frames.len(), images, "images are left out");
    }
}

fn read_recordings(test: &str, budget: &Budget) {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("whole.mcap");
    let round = Cell::new(0);
    mutate_and_read(test, &recordings(folder.path()), budget, lies::seal, |path| {
        let Ok(recording) = Recording::open(path) else { return 0 };
        check_frames(&recording);
        let frames = read_all(&recording).len();
        // Each copy waits for the disk.
        round.set(round.get() + 1);
        if round.get() % 16 != 0 {
            return frames;
        }
        for copy in [
            |from: &Path, to: &Path| recover(from, to).is_ok(),
            |from: &Path, to: &Path| copy_results(from, to).is_ok(),
            |from: &Path, to: &Path| Recording::open(from).and_then(|from| copy_as_ros2(&from, to)).is_ok(),
        ] {
            let is_copied = copy(path, &to);
            assert_eq!(is_copied, to.exists());
            let _ = (std::fs::remove_file(&to), std::fs::remove_file(to.with_extension("mcap.recovering")));
        }
        frames
    });
}

fn read_imports(test: &str, budget: &Budget) {
    // The pixels of the Photron header among the seeds.
    std::fs::write(kept(test, ".mraw"), [7; 96]).unwrap();
    mutate_and_read(test, &import::seeds(), budget, |_| {}, read_footage);
    let _ = std::fs::remove_file(kept(test, ".mraw"));
}

fn read_films(test: &str, budget: &Budget) {
    mutate_and_read(test, &film::seeds(), budget, |_| {}, read_footage);
}

/// Imports the first frames of a file and returns their number.
fn read_footage(path: &Path) -> usize {
    let Ok(footage) = ricochet::import::open(&[path.to_path_buf()], Some(100.0)) else { return 0 };
    footage.take(8).filter(Result::is_ok).count()
}

#[test]
fn mutated_recordings_are_read_or_refused() {
    match Budget::from_environment() {
        Some(budget) => read_recordings("recordings", &budget),
        None => limited("mutated_recordings_are_read_or_refused", "3000"),
    }
}

#[test]
fn mutated_imports_are_read_or_refused() {
    match Budget::from_environment() {
        Some(budget) => read_imports("imports", &budget),
        None => limited("mutated_imports_are_read_or_refused", "6000"),
    }
}

#[test]
fn mutated_films_are_read_or_refused() {
    match Budget::from_environment() {
        Some(budget) => read_films("films", &budget),
        None if film::has_ffmpeg() => limited("mutated_films_are_read_or_refused", "30"),
        None => {}
    }
}

#[test]
#[ignore = "ten minutes, or RICOCHET_MUTATE_SECONDS"]
fn mutated_films_are_read_or_refused_for_long() {
    limited("mutated_films_are_read_or_refused", &long());
}

#[test]
#[ignore = "ten minutes, or RICOCHET_MUTATE_SECONDS"]
fn mutated_recordings_are_read_or_refused_for_long() {
    limited("mutated_recordings_are_read_or_refused", &long());
}

#[test]
#[ignore = "ten minutes, or RICOCHET_MUTATE_SECONDS"]
fn mutated_imports_are_read_or_refused_for_long() {
    limited("mutated_imports_are_read_or_refused", &long());
}
