//! The pre-trigger ring: it costs nothing until it is needed, and is then written out completely.

use crate::support::{Background, Rig, process, ricochet, status, succeed, wait_until};
use ricochet::image::{Frame, FrameMeta};
use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// A film with a ring of `pre` frames, triggered some time after the ring is full.
struct Setup {
    pre: u64,
    post: u64,
    side_px: u32,
    rate_hz: u64,
    /// Frames that may pass until the test has noticed the full ring and triggered.
    spare: u64,
}

impl Setup {
    fn frames(&self) -> u64 {
        // Frames before the trigger, and frames after it.
        self.pre + 2 * self.post + self.spare
    }

    fn meta(&self, sequence: u64) -> FrameMeta {
        FrameMeta {
            sequence,
            stamp_ns: 1_767_225_600_000_000_000 + sequence * 1_000_000_000 / self.rate_hz,
            width_px: self.side_px,
            height_px: self.side_px,
            stride_bytes: self.side_px,
            ..FrameMeta::default()
        }
    }

    /// Fills pixels that identify their frame.
    fn paint(sequence: u64, bytes: &mut [u8]) {
        bytes.chunks_exact_mut(8).step_by(64).for_each(|place| place.copy_from_slice(&sequence.to_le_bytes()));
    }

    fn film(&self, path: &Path) {
        let mut writer = RecordingWriter::create(path, &RecordingInfo::default(), &WriterOptions::default()).unwrap();
        let mut bytes = vec![90; (self.side_px * self.side_px) as usize];
        for sequence in 0..self.frames() {
            Self::paint(sequence, &mut bytes);
            writer.write_frame(&Frame { meta: self.meta(sequence), bytes: &bytes }).unwrap();
        }
        writer.finish().unwrap();
    }
}

/// The processor time of a process so far, s, or `None` after its end.
pub fn cpu_s(pid: u64) -> Option<f64> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).ok()?;
    Some(tasks.map(|task| task_cpu_s(&task.unwrap().path())).sum())
}

/// The processor time of this thread so far, s.
fn own_cpu_s() -> f64 {
    task_cpu_s(Path::new("/proc/thread-self"))
}

fn task_cpu_s(task: &Path) -> f64 {
    let text = std::fs::read_to_string(task.join("schedstat")).unwrap_or_default();
    text.split_whitespace().next().map_or(0.0, |ns| ns.parse::<f64>().unwrap() * 1e-9)
}

/// The cost of a write.
struct Taken {
    frames_per_s: f64,
    cpu_us_a_frame: f64,
}

/// The cost of writing frames that lie in memory, as in the ring, with a plain file and as many forced writes to disk.
#[expect(clippy::disallowed_methods, reason = "it measures time")]
fn plain(folder: &Path, setup: &Setup, frames: u64) -> Taken {
    let frame_bytes = (setup.side_px * setup.side_px) as usize;
    let mut memory = vec![90; frame_bytes * frames as usize];
    memory.chunks_exact_mut(frame_bytes).zip(0..).for_each(|(frame, sequence)| Setup::paint(sequence, frame));
    let path = folder.join("plain");
    let (start, cpu_before_s) = (Instant::now(), own_cpu_s());
    let mut file = std::fs::File::create(&path).unwrap();
    for (frame, before) in memory.chunks_exact(frame_bytes).zip((0..).step_by(frame_bytes)) {
        file.write_all(frame).unwrap();
        if (before + frame_bytes) % (64 << 20) < frame_bytes {
            file.sync_data().unwrap();
        }
    }
    file.sync_all().unwrap();
    let (taken_s, cpu_s) = (start.elapsed().as_secs_f64(), own_cpu_s() - cpu_before_s);
    std::fs::remove_file(&path).unwrap();
    Taken { frames_per_s: frames as f64 / taken_s, cpu_us_a_frame: 1e6 * cpu_s / frames as f64 }
}

#[expect(clippy::disallowed_methods, reason = "it measures time")]
fn fill_and_drain(setup: &Setup) {
    let rig = Rig::new();
    let film = rig.path("film.mcap");
    setup.film(&film);
    // Data that still waits for the disk would slow down the measurement.
    assert!(std::process::Command::new("sync").status().unwrap().success());
    let camera = format!("source = \"recording\"\nid = \"{}\"\npaced = true", film.display());
    let (pre_s, post_s) = (setup.pre as f64 / setup.rate_hz as f64, setup.post as f64 / setup.rate_hz as f64);
    let rest = format!(
        "[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1\n[[body]]\nroi_px = [0, 0, 32, 32]\nmin_radius_px = 8\n\
         max_radius_px = 12\n[trigger]\nmode = \"software\"\nrearm = false\npre_s = {pre_s}\npost_s = {post_s}"
    );
    let config = rig.config(&camera, &rest);
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let number = |name: &str, key: &str| {
        status(&rig.name).and_then(|report| process(&report, name, 0)?[key].as_u64()).unwrap_or(0)
    };
    wait_until("frames arrive", || (number("acquire", "sequence") > 10).then_some(()));
    // Measured next to the camera and the worker, like the shot. The film lasts no longer than the ring and this.
    let concurrent = plain(&rig.path(""), setup, setup.pre / 20);
    let pid =
        wait_until("the recorder reports its process id", || Some(number("record", "pid")).filter(|pid| *pid > 0));
    let (start, cpu_before_s) = (Instant::now(), cpu_s(pid).unwrap());
    wait_until("the ring is full", || (number("acquire", "sequence") > setup.pre + setup.post / 2).then_some(()));
    let share = (cpu_s(pid).unwrap() - cpu_before_s) / start.elapsed().as_secs_f64();
    assert_eq!(number("record", "taken"), 0, "nothing was read yet");

    let cpu_before_s = cpu_s(pid).unwrap();
    let triggered = Instant::now();
    succeed(["trigger", "--rig", rig.name.as_str()]);
    let mut cpu_drained_s = cpu_before_s;
    wait_until("the shot is written", || {
        // If the film ends meanwhile, the rig ends with the shot.
        cpu_drained_s = cpu_s(pid).unwrap_or(cpu_drained_s);
        (number("record", "taken") > setup.pre + setup.post || rig.recordings().len() == 1).then_some(())
    });
    let (taken_s, cpu_drain_s) = (triggered.elapsed().as_secs_f64(), cpu_drained_s - cpu_before_s);
    wait_until("the shot has its name", || (rig.recordings().len() == 1).then_some(()));
    assert_eq!(number("record", "lost"), 0);
    service.signal(2);
    service.end();

    let recording = Recording::open(&rig.recordings()[0]).unwrap();
    let (mut expected, mut bytes, mut count) = (None, vec![90; (setup.side_px * setup.side_px) as usize], 0);
    for frame in recording.frames().unwrap() {
        let (meta, pixels) = frame.unwrap();
        let sequence = *expected.get_or_insert(meta.sequence);
        assert_eq!(meta.sequence, sequence, "a gap");
        Setup::paint(sequence, &mut bytes);
        assert!(pixels == bytes, "frame {sequence} holds the pixels of another");
        (expected, count) = (Some(sequence + 1), count + 1);
    }
    assert!(count > setup.pre + setup.post, "{count} frames");
    println!(
        "{count} frames: {:.2} % of a processor before the trigger; written in {taken_s:.2} s, {:.0} us of processor \
         time per frame",
        100.0 * share,
        1e6 * cpu_drain_s / count as f64
    );
    assert!(share < 0.05, "{share} of a processor before the trigger");
    std::fs::remove_file(&film).unwrap();
    let (rate, alone) = (count as f64 / taken_s, plain(&rig.path(""), setup, count));
    println!(
        "{rate:.0} frames/s: {:.2} of an undisturbed plain write of as many ({:.0} frames/s, {:.0} us of \
         processor time), {:.2} of one of a few next to the camera and the worker ({:.0} frames/s)",
        rate / alone.frames_per_s,
        alone.frames_per_s,
        alone.cpu_us_a_frame,
        rate / concurrent.frames_per_s,
        concurrent.frames_per_s
    );
}

#[test]
fn a_ring_costs_nothing_before_the_trigger_and_is_drained_without_a_gap() {
    fill_and_drain(&Setup { pre: 2000, post: 400, side_px: 64, rate_hz: 1000, spare: 4000 });
}

#[test]
#[ignore = "takes 11 GB of memory and 19 GB of disk"]
fn a_ring_of_20_000_frames_of_512x512_px_costs_nothing_before_the_trigger_and_is_drained_without_a_gap() {
    fill_and_drain(&Setup { pre: 20_000, post: 2000, side_px: 512, rate_hz: 2000, spare: 2000 });
}
