//! `ricochet bench record`: the recording rate, compared with a plain write of the same bytes.

use super::{BenchOptions, median_of};
use crate::failure::Failure;
use crate::image::{Frame, FrameMeta, PixelFormat};
use crate::interrupt::{self, Unfinished};
use crate::numeric::{GOLDEN_GAMMA, key, scramble};
use crate::recording::{RecordingInfo, RecordingWriter, WriterOptions, part_path};
use serde_json::json;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The side of a frame, px.
const SIDE_PX: u32 = 512;
/// The size of a frame, bytes.
const FRAME_BYTES: usize = (SIDE_PX * SIDE_PX) as usize;
/// Frames per turn, 134 MB.
const FRAMES: u64 = 512;
/// Number of distinct frames.
const POOL: usize = 16;
/// Sync interval of the recorder and of the plain write, frames.
const SYNC_FRAMES: u64 = 256;
/// Minimum and maximum number of turns.
const TURNS: std::ops::Range<usize> = 3..200;

/// The time of one turn.
#[derive(Debug, Clone, Copy)]
struct Timing {
    wall_s: f64,
    /// Processor time of the process, user and system.
    cpu_s: f64,
}

/// Writes frames of 512 x 512 px as plain bytes and as a recording in turns, and prints the medians.
///
/// # Errors
///
/// When the directory cannot be written, or the result cannot be printed.
pub(super) fn run(options: &BenchOptions) -> Result<(), Failure> {
    let pool: Vec<Vec<u8>> = (1..=POOL as u64).map(noise_frame).collect();
    let files = Files::new(&options.directory);
    let (mut plain, mut recorded) = (Vec::new(), Vec::new());
    let start = now();
    while plain.len() < TURNS.start || (start.elapsed() < options.duration() && plain.len() < TURNS.end) {
        // The order alternates because the previous write still fills the queue of the disk.
        if plain.len() % 2 == 0 {
            plain.push(files.write_plain(&pool)?);
            recorded.push(files.write_recording(&pool)?);
        } else {
            recorded.push(files.write_recording(&pool)?);
            plain.push(files.write_plain(&pool)?);
        }
    }
    print_medians(options, &plain, &recorded)
}

/// Prints the medians of both ways to write, and their ratio turn by turn.
fn print_medians(options: &BenchOptions, plain: &[Timing], recorded: &[Timing]) -> Result<(), Failure> {
    let rate = |timing: &Timing| FRAMES as f64 / timing.wall_s;
    let cpu_us = |timing: &Timing| timing.cpu_s * 1e6 / FRAMES as f64;
    let rates = [median_of(plain.iter().map(rate)), median_of(recorded.iter().map(rate))];
    let cpus = [median_of(plain.iter().map(cpu_us)), median_of(recorded.iter().map(cpu_us))];
    // Compared turn by turn, so that a temporary slowdown affects both.
    let ratio = median_of(plain.iter().zip(recorded).map(|(plain, recorded)| plain.wall_s / recorded.wall_s));
    let above_us = median_of(plain.iter().zip(recorded).map(|(plain, recorded)| cpu_us(recorded) - cpu_us(plain)));
    let mut out = std::io::stdout().lock();
    if options.json {
        let row = |at: usize| json!({ "frames_per_s": rates[at], "cpu_us_per_frame": cpus[at] });
        let report = json!({
            "frame_bytes": FRAME_BYTES,
            "turns": plain.len(),
            "plain_write": row(0),
            "recording": row(1),
            "rate_ratio": ratio,
            "cpu_us_per_frame_above_plain": above_us,
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&report)?)?;
        return Ok(());
    }
    let title = format!("512 x 512 px, {} turns of {FRAMES} frames", plain.len());
    writeln!(out, "{title:44} {:>10} {:>8} {:>14}", "frames/s", "MB/s", "CPU us/frame")?;
    for (at, name) in ["plain write", "recording"].into_iter().enumerate() {
        let megabytes = rates[at] * FRAME_BYTES as f64 / 1e6;
        writeln!(out, "{name:44} {:>10.0} {megabytes:>8.0} {:>14.1}", rates[at], cpus[at])?;
    }
    writeln!(out, "{:44} {ratio:>10.2} {:>8} {above_us:>14.1}", "ratio of the rates; CPU above plain", "")?;
    Ok(())
}

/// The files of the benchmark; deleted on drop.
struct Files {
    plain: PathBuf,
    recording: PathBuf,
    _unfinished: [Unfinished; 2],
}

impl Files {
    /// Names files of this process in a directory.
    fn new(directory: &Path) -> Self {
        let name = |ending: &str| directory.join(format!(".ricochet-bench-{}.{ending}", std::process::id()));
        let (plain, recording) = (name("raw"), name("mcap"));
        Self { _unfinished: [&plain, &recording].map(|path| interrupt::note(path)), plain, recording }
    }

    /// Writes the frames as plain bytes, synced as often as a recording, and removes the file.
    fn write_plain(&self, pool: &[Vec<u8>]) -> Result<Timing, Failure> {
        let timing = time_write(|| {
            // Noted again, so that a signal cannot come between: the file was removed after the round before.
            let (mut file, _unfinished) = interrupt::file(&self.plain, || File::create(&self.plain))
                .map_err(|error| Failure::internal(format!("cannot write {}: {error}", self.plain.display())))?;
            for number in 0..FRAMES {
                file.write_all(&pool[number as usize % pool.len()])?;
                if (number + 1) % SYNC_FRAMES == 0 {
                    file.sync_data()?;
                }
            }
            Ok(file.sync_all()?)
        });
        self.remove();
        timing
    }

    /// Writes the frames as a recording, and removes it.
    fn write_recording(&self, pool: &[Vec<u8>]) -> Result<Timing, Failure> {
        let timing = time_write(|| {
            let options = WriterOptions::default();
            let mut writer = RecordingWriter::create(&self.recording, &RecordingInfo::default(), &options)?;
            for sequence in 0..FRAMES {
                // 10 000 frames per second, so that rows are batched as at that rate.
                let meta = FrameMeta {
                    sequence,
                    stamp_ns: sequence * 100_000,
                    width_px: SIDE_PX,
                    height_px: SIDE_PX,
                    stride_bytes: SIDE_PX,
                    format: PixelFormat::Mono8,
                    ..FrameMeta::default()
                };
                writer.write_frame(&Frame { meta, bytes: &pool[sequence as usize % pool.len()] })?;
            }
            writer.finish()?;
            Ok(())
        });
        self.remove();
        timing
    }

    /// Removes all files that exist.
    fn remove(&self) {
        for path in [&self.plain, &self.recording, &part_path(&self.recording)] {
            // Most of them do not exist.
            let _ = std::fs::remove_file(path);
        }
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        self.remove();
    }
}

/// Runs a write and returns its duration and processor time.
fn time_write(write: impl FnOnce() -> Result<(), Failure>) -> Result<Timing, Failure> {
    let (start, before_s) = (now(), cpu_s());
    write()?;
    Ok(Timing { wall_s: start.elapsed().as_secs_f64(), cpu_s: cpu_s() - before_s })
}

/// Reads the clock.
#[expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
fn now() -> Instant {
    Instant::now()
}

/// Returns the processor time of all threads of this process, user and system, including the disk thread, s.
fn cpu_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Returns an incompressible frame of random bytes.
fn noise_frame(seed: u64) -> Vec<u8> {
    let first = key(seed, 0, 0);
    (0..FRAME_BYTES as u64 / 8)
        .flat_map(|k| scramble(first.wrapping_add(k.wrapping_mul(GOLDEN_GAMMA))).to_le_bytes())
        .collect()
}
