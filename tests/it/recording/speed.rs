//! The cost of writing and reading. Run with `--ignored --nocapture`.

use super::samples;
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{Compression, Recording, RecordingInfo, RecordingWriter, WriterOptions};
use std::io::Write as _;
use std::time::Instant;

/// A file of 1 GB.
const FRAMES: u64 = 4096;

/// The processor time of this thread, s.
fn cpu_s() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-9
}

/// The bytes that this thread has read.
pub fn bytes_read() -> u64 {
    let text = std::fs::read_to_string("/proc/thread-self/io").unwrap();
    text.lines().find_map(|line| line.strip_prefix("rchar: ")).unwrap().parse().unwrap()
}

#[test]
#[ignore = "prints figures, asserts none; writes 1 GB at a time"]
#[expect(clippy::disallowed_methods, reason = "it measures time")]
fn figures_of_512x512_frames() {
    let folder = tempfile::tempdir_in(".").unwrap();
    let pool: Vec<_> = (0..16).map(|k| samples::frame(k, PixelFormat::Mono8, [512, 512], 0)).collect();
    let report = |name: &str, start: Instant, cpu: f64| {
        let (wall_s, cpu_us) = (start.elapsed().as_secs_f64(), (cpu_s() - cpu) * 1e6 / FRAMES as f64);
        println!("{name}: {:.0} frames/s, {cpu_us:.1} us of this thread per frame", FRAMES as f64 / wall_s);
    };
    for round in 0..1 {
        let (start, cpu) = (Instant::now(), cpu_s());
        let mut file = std::fs::File::create(folder.path().join(format!("plain-{round}"))).unwrap();
        for k in 0..FRAMES {
            file.write_all(&pool[k as usize % pool.len()].1).unwrap();
            if k % 256 == 255 {
                file.sync_data().unwrap();
            }
        }
        report("plain write", start, cpu);
        for compression in [Compression::None, Compression::Zstd1] {
            let path = folder.path().join(format!("shot-{round}-{compression:?}.mcap"));
            let (start, cpu) = (Instant::now(), cpu_s());
            let options = WriterOptions { compression, ..WriterOptions::default() };
            let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &options).unwrap();
            for k in 0..FRAMES {
                let (mut meta, bytes) = (pool[k as usize % pool.len()].0, &pool[k as usize % pool.len()].1);
                (meta.sequence, meta.stamp_ns) = (k, samples::START_NS + k * 100_000);
                writer.write_frame(&Frame { meta, bytes }).unwrap();
                writer.write_velocity(&samples::velocity(k, 0)).unwrap();
            }
            writer.finish().unwrap();
            report(&format!("recording {compression:?}"), start, cpu);
            let (start, cpu) = (Instant::now(), cpu_s());
            let recording = Recording::open(&path).unwrap();
            let opened = start.elapsed();
            assert_eq!(recording.frames().unwrap().map(Result::unwrap).count() as u64, FRAMES);
            report(&format!("reading, opened in {opened:?}"), start, cpu);
            let (start, before) = (Instant::now(), bytes_read());
            let recording = Recording::open(&path).unwrap();
            assert_eq!(recording.velocities().unwrap().count() as u64, FRAMES);
            let share = (bytes_read() - before) as f64 / recording.bytes() as f64 * 100.0;
            println!("/velocity alone, opening included: {:?}, {share:.2} % of the file", start.elapsed());
            let mut seeks: Vec<_> = (0..64)
                .map(|k| {
                    let mut frames = recording.frames().unwrap();
                    let start = Instant::now();
                    frames.skip_frames(k * 397 % FRAMES);
                    assert_eq!(frames.next().unwrap().unwrap().0.sequence, k * 397 % FRAMES);
                    start.elapsed()
                })
                .collect();
            seeks.sort();
            println!("any frame: median {:?}, max {:?}", seeks[32], seeks[63]);
            std::fs::remove_file(&path).unwrap();
        }
    }
}
