//! Histories: processes of a rig die, hang and starve at random moments, and every frame number is accounted for.
//!
//! `RICOCHET_SEED` selects the first history.

use super::{children, number, start};
use crate::pipeline::drift;
use crate::pipeline_faults::{analysis, tables};
use crate::recording::recover::xorshift;
use crate::support::{Listener, Rig, frames, process, run, send_signal, status, wait_until};
use ricochet::recording::Recording;
use ricochet::results::{PointStatus, VelocitySample};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Deaths in each history. More within half a minute could end the rig.
const KILLS: usize = 5;
/// The system calls at which a process may die.
const CALLS: [&str; 8] = ["write", "pwrite64", "futex", "openat", "mmap", "close", "sendto", "clock_nanosleep"];

/// A fault of a process.
#[derive(Debug)]
enum Fault {
    /// It is killed.
    Death,
    /// It is killed at its n-th system call of a kind from now on, or after a second without that many.
    DeathAtCall(&'static str, usize),
    /// It is stopped for some time, and then killed.
    DeathAfterHang(Duration),
    /// It has to share the processors with others that compute all the time, and is then killed.
    DeathAfterStarvation(Duration),
}

impl Fault {
    fn draw(random: &mut impl FnMut(usize) -> usize) -> Self {
        let time = Duration::from_millis(50 + random(700) as u64);
        match random(4) {
            0 => Self::Death,
            1 => Self::DeathAtCall(CALLS[random(CALLS.len())], 1 + random(40)),
            2 => Self::DeathAfterHang(time),
            _ => Self::DeathAfterStarvation(time),
        }
    }

    fn inflict(&self, pid: u32) {
        match self {
            Self::Death => {}
            Self::DeathAtCall(call, count) => kill_at_call(pid, call, *count),
            Self::DeathAfterHang(time) => {
                let _ = send_signal(pid, 19);
                std::thread::sleep(*time);
            }
            Self::DeathAfterStarvation(time) => starve(*time),
        }
        let _ = send_signal(pid, 9);
    }
}

/// Kills a process by strace at its n-th call of a kind; has no effect without strace.
fn kill_at_call(pid: u32, call: &str, count: usize) {
    let inject = format!("inject={call}:signal=KILL:when={count}");
    let mut command = Command::new("strace");
    command.args([
        "-f",
        "-qq",
        "-o",
        "/dev/null",
        "-p",
        &pid.to_string(),
        "-e",
        &format!("trace={call}"),
        "-e",
        &inject,
    ]);
    let Ok(mut tracer) = command.stderr(Stdio::null()).spawn() else { return };
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(1) && tracer.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(5));
    }
    // It leaves the process as it is.
    let _ = send_signal(tracer.id(), 2);
    tracer.wait().unwrap();
}

/// Computes on as many threads as would take all processors twice.
fn starve(time: Duration) {
    let end = Instant::now() + time;
    let count = 2 * std::thread::available_parallelism().map_or(2, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..count {
            scope.spawn(|| while Instant::now() < end {});
        }
    });
}
const ROLES: [(&str, u64); 5] = [("acquire", 0), ("correlate", 0), ("correlate", 1), ("track", 0), ("record", 0)];

#[test]
#[ignore = "10 histories"]
fn fifty_random_deaths_leave_no_frame_unaccounted_for() {
    histories(10);
}

#[test]
#[ignore = "200 histories"]
fn a_thousand_random_deaths_leave_no_frame_unaccounted_for() {
    histories(200);
}

fn histories(count: u64) {
    let first = std::env::var("RICOCHET_SEED").map_or(1, |seed| seed.parse().unwrap());
    let mut totals = [0; 3];
    for seed in first..first + count {
        let found = history(seed);
        totals = [0, 1, 2].map(|k| totals[k] + found[k]);
    }
    println!(
        "{} deaths: {} frames filmed, {} recorded, {} lost",
        count as usize * KILLS,
        totals[0],
        totals[1],
        totals[2]
    );
}

/// One history; returns the number of frames that the camera has numbered, of those recorded, and of those missing.
fn history(seed: u64) -> [u64; 3] {
    let mut random = xorshift(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let rig = Rig::new();
    let scenario = rig.file("long.toml", &drift(60_000, 100.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let config = rig.config(&camera, "[scale]\nmm_per_px = 0.5\n[workers]\ncount = 2\nblock_frames = 8");
    let listener = Listener::start("velocity", &rig.name);
    let service = start(&config);
    wait_until("it films", || (number(&status(&rig.name)?, "track", "given") > 20).then_some(()));
    for _ in 0..KILLS {
        std::thread::sleep(Duration::from_millis(100 + random(1200) as u64));
        let (role, index) = ROLES[random(ROLES.len())];
        // It may be on its way up after its last death.
        let pid = wait_until("the process reports", || process(&status(&rig.name)?, role, index)?["pid"].as_u64());
        let fault = Fault::draw(&mut random);
        println!("seed {seed}: {role}-{index}: {fault:?}");
        fault.inflict(u32::try_from(pid).unwrap());
    }
    wait_until("all processes are back", || {
        let status = status(&rig.name)?;
        ROLES.iter().all(|(role, index)| process(&status, role, *index).is_some()).then_some(())
    });
    std::thread::sleep(Duration::from_millis(500));
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(6), "seed {seed}: {stderr}");
    assert!(children(&rig).is_empty(), "seed {seed}");
    let live = live_rows(listener, seed);
    check(&rig, &live, &stderr, seed)
}

/// The motion of the body in each frame as it was published, if it was measured.
fn live_rows(listener: Listener, seed: u64) -> BTreeMap<u64, Option<[f64; 2]>> {
    let mut rows = BTreeMap::new();
    for (_, row) in listener.end() {
        let Some(frame) = row["frame"].as_u64() else { continue };
        let motion = row["dx_px"].as_f64().zip(row["dy_px"].as_f64()).map(|(x, y)| [x, y]);
        assert!(rows.insert(frame, motion).is_none(), "seed {seed}: frame {frame} is published twice");
    }
    rows
}

/// Checks the files against each other, the live rows, and the reported losses.
fn check(rig: &Rig, live: &BTreeMap<u64, Option<[f64; 2]>>, stderr: &str, seed: u64) -> [u64; 3] {
    let mut recorded = BTreeMap::new();
    let mut compared = 0;
    for path in files(rig) {
        let film = frames(&path);
        for (meta, bytes) in film {
            let twice = recorded.insert(meta.sequence, (meta.stamp_ns, crc32fast::hash(&bytes)));
            assert!(twice.is_none(), "seed {seed}: frame {} is recorded twice", meta.sequence);
        }
        let rows: Vec<VelocitySample> =
            Recording::open(&path).unwrap().velocities().unwrap().map(Result::unwrap).collect();
        let is_measured = |row: &&VelocitySample| row.status != PointStatus::Lost;
        let is_whole = !path.to_string_lossy().contains(".recovered.");
        if is_whole && rows.iter().all(|row| row.status != PointStatus::Lost) {
            let (_, analysed) = analysis(rig, &path, "1");
            assert!(analysed == tables(&path), "seed {seed}: {path:?} differs from its analysis");
        }
        for row in rows.iter().filter(is_measured) {
            // Positions are filtered over neighbours, which may be lost in one of the two.
            let motion = row.motion.map(|motion| [motion.dx_px, motion.dy_px]);
            if let (Some(file), Some(Some(live))) = (motion, live.get(&row.frame)) {
                assert_eq!(file.map(f64::to_bits), live.map(f64::to_bits), "seed {seed}: frame {}", row.frame);
                compared += 1;
            }
        }
    }
    let stamps: Vec<u64> = recorded.values().map(|(stamp_ns, _)| *stamp_ns).collect();
    assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "seed {seed}: stamps rise with the numbers");
    let (Some(first), Some(last)) = (recorded.keys().next(), recorded.keys().next_back()) else {
        panic!("seed {seed}: nothing is recorded: {stderr}")
    };
    let filmed = last.max(live.keys().next_back().unwrap_or(last)) + 1;
    let missing = filmed - recorded.len() as u64;
    let reported = reported(stderr);
    println!(
        "seed {seed}: {filmed} numbers from {first}, {missing} missing, {reported} reported, {compared} rows alike"
    );
    assert!(compared > 50, "seed {seed}: only {compared} rows to compare");
    let gaps: Vec<[u64; 2]> = std::iter::once(0)
        .chain(recorded.keys().map(|number| number + 1))
        .zip(recorded.keys().copied().chain([filmed]))
        .filter(|(from, to)| from < to)
        .map(|(from, to)| [from, to])
        .collect();
    assert!(
        missing <= reported,
        "seed {seed}: {missing} frames are missing, in {gaps:?}, and {reported} are reported: {stderr}"
    );
    [filmed, recorded.len() as u64, missing]
}

/// The recordings, and what can be recovered of those that were cut off.
fn files(rig: &Rig) -> Vec<PathBuf> {
    let parts = std::fs::read_dir(rig.path("shots")).unwrap().map(|entry| entry.unwrap().path());
    for part in parts.filter(|path| path.extension().is_some_and(|extension| extension == "part")) {
        let to = part.with_extension("").with_extension("recovered.mcap");
        let output = run(["recover".as_ref(), part.as_os_str(), "-o".as_ref(), to.as_os_str()]);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 6)) || stderr.contains("no frames"), "{stderr}");
    }
    let has_frames = |path: &PathBuf| Recording::open(path).is_ok_and(|recording| recording.frame_count() > 0);
    rig.recordings().into_iter().filter(has_frames).collect()
}

/// The sum of the losses that the rig has reported at its end.
fn reported(stderr: &str) -> u64 {
    let line = stderr.lines().find_map(|line| line.strip_prefix("ricochet: ")).unwrap_or_default();
    let after_lost = line.split("lost ").skip(1);
    let numbers = after_lost.filter_map(|text| text.split(|c: char| !c.is_ascii_digit()).next()?.parse::<u64>().ok());
    numbers.sum()
}
