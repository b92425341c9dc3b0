//! Survival of a rig: deaths, signals and hangs of each process, a full memory, other users.

mod histories;
mod matrix;
mod memory;
mod page;
mod soak;
mod start_up;
mod users;

use crate::pipeline::drift;
use crate::pipeline_faults::{analysis, tables};
use crate::support::{Background, Rig, complaints, frames, kill, process, ricochet, run, status, succeed, wait_until};
use ricochet::recording::Recording;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::{Duration, Instant};

const ROLES: [&str; 5] = ["acquire", "correlate", "track", "record", "run"];

/// Writes the file of a rig that keeps up easily and records a shot when it is triggered.
fn armed(rig: &Rig) -> PathBuf {
    triggered(rig, 0.3, 0.4)
}

fn triggered(rig: &Rig, pre_s: f64, post_s: f64) -> PathBuf {
    let scenario = rig.file("long.toml", &drift(60_000, 100.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let trigger = format!("[trigger]\nmode = \"software\"\npre_s = {pre_s}\npost_s = {post_s}\nrearm = true");
    rig.config(&camera, &format!("[scale]\nmm_per_px = 0.5\n[workers]\ncount = 2\nblock_frames = 8\n{trigger}"))
}

fn start(config: &Path) -> Background {
    Background::start(ricochet(["run".as_ref(), config.as_os_str()]))
}

fn number(status: &Value, name: &str, key: &str) -> u64 {
    process(status, name, 0).map_or(0, |process| process[key].as_u64().unwrap())
}

fn pid(status: &Value, name: &str) -> u32 {
    u32::try_from(number(status, name, "pid")).unwrap()
}

/// The status once everything of the rig measures, at least up to this frame.
fn running(rig: &Rig, frame: u64) -> Value {
    wait_until("the rig measures", || {
        let status = status(&rig.name)?;
        let all = ROLES.iter().all(|role| process(&status, role, 0).is_some());
        (all && number(&status, "track", "sequence") > frame && is_armed(&status)).then_some(status)
    })
}

fn is_armed(status: &Value) -> bool {
    process(status, "record", 0).is_some_and(|process| process["state"].as_u64() == Some(1))
}

fn trigger(rig: &Rig) -> Output {
    run(["trigger", "--rig", rig.name.as_str()])
}

/// Triggers a drop and waits for its recording, which must equal its own analysis.
fn record_a_drop(rig: &Rig) -> PathBuf {
    let path = wait_until("the drop is recorded", || {
        // It is refused while an earlier shot is written.
        let output = run(["trigger", "--rig", rig.name.as_str(), "--wait"]);
        let printed = String::from_utf8(output.stdout).unwrap();
        output.status.success().then(|| PathBuf::from(printed.trim()))
    });
    let (_, analysed) = analysis(rig, &path, "1");
    assert!(analysed == tables(&path), "the recording differs from its analysis");
    path
}

fn is_gone(pid: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/stat")).map_or(true, |stat| stat.contains(") Z "))
}

/// The processes that this rig has started, whatever became of its supervisor.
fn children(rig: &Rig) -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let origin = rig.path("rig.toml");
    let is_child = |pid: &u32| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line);
        line.contains("--origin") && line.contains(origin.to_str().unwrap()) && !is_gone(*pid)
    };
    pids.filter(is_child).collect()
}

fn no_orphan_after_3_s(rig: &Rig) {
    let killed = Instant::now();
    wait_until("the processes of a killed supervisor end", || children(rig).is_empty().then_some(()));
    assert!(killed.elapsed() < Duration::from_secs(3), "{:?}", killed.elapsed());
}

#[test]
fn a_termination_signal_to_one_process_ends_nothing() {
    let rig = Rig::new();
    let config = armed(&rig);
    let service = start(&config);
    let before = running(&rig, 40);
    for role in &ROLES[..4] {
        kill(pid(&before, role), 15);
    }
    record_a_drop(&rig);
    let after = running(&rig, 100);
    for role in &ROLES[..4] {
        assert_eq!(pid(&after, role), pid(&before, role), "{role}");
    }
    service.signal(15);
    let (code, _, stderr) = service.end();
    assert_eq!((code, complaints(&stderr)), (Some(0), vec![]));
}

#[test]
fn a_termination_signal_to_all_processes_during_a_shot_leaves_a_file_that_equals_its_analysis() {
    let rig = Rig::new();
    let config = triggered(&rig, 0.3, 5.0);
    let service = start(&config);
    let before = running(&rig, 60);
    assert!(trigger(&rig).status.success());
    wait_until("the shot is being written", || (number(&status(&rig.name)?, "record", "taken") > 50).then_some(()));
    let workers = before["processes"].as_array().unwrap();
    workers.iter().for_each(|process| kill(u32::try_from(process["pid"].as_u64().unwrap()).unwrap(), 15));
    let (code, _, stderr) = service.end();
    assert_eq!((code, complaints(&stderr)), (Some(0), vec![]));
    let path = &rig.recordings()[0];
    let (code, analysed) = analysis(&rig, path, "1");
    assert_eq!(code, Some(0));
    assert!(analysed == tables(path));
    let rows = analysed[0].lines().count() - 1;
    assert!(rows > 50 && rows == frames(path).len(), "{rows} rows");
}

#[test]
fn a_camera_process_killed_again_before_it_films_continues_the_numbers() {
    let rig = Rig::new();
    let scenario = rig.file("long.toml", &drift(60_000, 100.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let config = rig.config(&camera, "[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1\nblock_frames = 8");
    let service = start(&config);
    let mut last = wait_until("it films", || {
        let status = status(&rig.name)?;
        (number(&status, "record", "sequence") > 50).then_some(status)
    });
    for _ in 0..2 {
        let old = pid(&last, "acquire");
        kill(old, 9);
        // The successor is killed as soon as it exists.
        let next = wait_until("it is restarted", || children(&rig).into_iter().find(|pid| is_acquire(*pid, old)));
        kill(next, 9);
        let frame = number(&last, "record", "sequence");
        last = wait_until("it films again", || {
            let status = status(&rig.name)?;
            (number(&status, "record", "sequence") > frame + 50).then_some(status)
        });
    }
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    let film = frames(Path::new(printed.trim()));
    let rising = film.windows(2).all(|pair| {
        pair[1].0.sequence > pair[0].0.sequence
            && pair[1].0.stamp_ns > pair[0].0.stamp_ns
            && pair[1].0.epoch >= pair[0].0.epoch
    });
    let epochs = film.last().unwrap().0.epoch;
    assert!(rising && (2..=4).contains(&epochs), "epoch {epochs}");
    let missing = film.last().unwrap().0.sequence + 1 - film.len() as u64;
    let recording = Recording::open(Path::new(printed.trim())).unwrap();
    let rows = recording.velocities().unwrap().map(Result::unwrap).count() as u64;
    println!("{missing} frames missing, {rows} rows: {stderr}");
    let events = succeed(["export", printed.trim(), "--topic", "events", "--format", "csv"]);
    assert!(stderr.contains("record 0 lost") && missing > 0, "{stderr} {events}");
    let reported: u64 = stderr
        .split("record 0 lost ")
        .nth(1)
        .unwrap()
        .split(|c: char| !c.is_ascii_digit())
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!(reported >= missing && reported <= 2 * missing, "{reported} reported, {missing} missing");
}

fn is_acquire(pid: u32, not: u32) -> bool {
    let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    pid != not && String::from_utf8_lossy(&line).contains("acquire")
}

#[test]
fn a_worker_that_dies_during_a_shot_does_not_hold_the_recorder() {
    let rig = Rig::new();
    let config = triggered(&rig, 0.3, 1.0);
    let service = start(&config);
    let before = running(&rig, 60);
    assert!(trigger(&rig).status.success());
    kill(pid(&before, "correlate"), 9);
    let killed = Instant::now();
    let path = wait_until("the shot is recorded", || rig.recordings().pop());
    println!("recorded {:?} after the death", killed.elapsed());
    assert!(killed.elapsed() < Duration::from_secs(4), "{:?} for 1 s of shot", killed.elapsed());
    let rows: Vec<_> = Recording::open(&path).unwrap().velocities().unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len(), frames(&path).len(), "a row per frame, lost ones included");
    record_a_drop(&rig);
    service.signal(2);
    assert_eq!(service.end().0, Some(6));
}

#[test]
fn a_shot_cut_by_the_death_of_its_camera_has_the_rows_of_its_frames() {
    let rig = Rig::new();
    let config = triggered(&rig, 0.3, 0.4);
    let service = start(&config);
    let before = running(&rig, 60);
    assert!(trigger(&rig).status.success());
    std::thread::sleep(Duration::from_millis(200));
    // No successor films before the shot is over.
    kill(pid(&before, "acquire"), 9);
    let path = wait_until("the shot is recorded", || rig.recordings().pop());
    let (_, analysed) = analysis(&rig, &path, "1");
    assert!(analysed == tables(&path), "the recording differs from its analysis");
    let film = frames(&path);
    let (first, last) = (film[0].0.sequence, film.last().unwrap().0.sequence);
    let rows = analysed[0].lines().count() as u64 - 1;
    println!("{} frames from {first} to {last}, {rows} rows", film.len());
    assert_eq!(rows, last + 1 - first);
    record_a_drop(&rig);
    service.signal(2);
    assert_eq!(service.end().0, Some(6));
}

#[test]
fn a_hanging_recorder_is_named_killed_and_replaced() {
    let rig = Rig::new();
    let config = armed(&rig);
    let service = start(&config);
    let before = running(&rig, 40);
    let recorder = pid(&before, "record");
    kill(recorder, 19);
    let refused = trigger(&rig);
    let stderr = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(4), "{stderr}");
    assert!(stderr.contains(&format!("but its recorder (process {recorder}) does not answer")), "{stderr}");
    let shown = succeed(["status", "--rig", rig.name.as_str()]);
    assert!(shown.contains("record (no heartbeat)"), "{shown}");
    let after = wait_until("it is replaced", || {
        let status = status(&rig.name)?;
        (pid(&status, "record") != recorder && is_armed(&status)).then_some(status)
    });
    assert_eq!(number(&after, "run", "restarts"), 1);
    record_a_drop(&rig);
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    assert!(stderr.contains("record 0 shows no sign of life and is killed"), "{stderr}");
}

#[test]
fn stopping_a_rig_whose_worker_hangs_ends_in_bounded_time_with_6() {
    let rig = Rig::new();
    let config = armed(&rig);
    let service = start(&config);
    let before = running(&rig, 40);
    kill(pid(&before, "track"), 19);
    service.signal(2);
    let stopped = Instant::now();
    let (code, _, stderr) = service.end();
    println!("stopped in {:?}: {stderr}", stopped.elapsed());
    assert_eq!(code, Some(6), "{stderr}");
    assert!(stderr.contains("track 0 did not finish in time"), "{stderr}");
    assert!(stopped.elapsed() < Duration::from_secs(30), "{:?}", stopped.elapsed());
    assert!(children(&rig).is_empty());
}

#[test]
fn a_full_or_closed_standard_error_changes_no_exit_code() {
    for redirection in ["2> /dev/full", "2>&-"] {
        for (arguments, code) in [("run missing.toml", 2), ("no-such-command", 2), ("status --rig no-such-rig", 4)] {
            let line = format!("{} {arguments} {redirection}", env!("CARGO_BIN_EXE_ricochet"));
            let status = std::process::Command::new("sh").args(["-c", &line]).status().unwrap();
            assert_eq!(status.code(), Some(code), "{line}");
        }
    }
}

#[test]
fn a_film_whose_frame_size_changes_ends_its_replay_with_an_error() {
    let rig = Rig::new();
    let config = crate::pipeline_faults::drifting(&rig, "", "[workers]\nblock_frames = 8");
    let mut film = crate::pipeline_faults::film(&rig);
    for (meta, bytes) in &mut film[20..] {
        (meta.width_px, meta.height_px, meta.stride_bytes) = (80, 72, 80);
        bytes.truncate(80 * 72);
    }
    let path = rig.path("changing.mcap");
    crate::pipeline_faults::write(&path, &config, &film);
    let shots = rig.path("shots");
    let replay = ["replay", path.to_str().unwrap(), "--rate", "max", "--rig", &rig.name, "-o", shots.to_str().unwrap()];
    let (code, _, stderr) = Background::start(ricochet(replay)).end();
    assert_eq!(code, Some(5), "{stderr}");
    assert!(stderr.contains("frame 20 is 80x72 Mono8, the first one 160x144 Mono8"), "{stderr}");
}

#[test]
fn the_unit_file_is_valid() {
    let unit =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/systemd/ricochet@.service")).unwrap();
    let rig = Rig::new();
    let path = rig.file("ricochet@.service", &unit.replace("/usr/local/bin/ricochet", "/bin/true"));
    match std::process::Command::new("systemd-analyze")
        .arg("verify")
        .arg(path.with_file_name("ricochet@.service"))
        .output()
    {
        Ok(output) => {
            assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr))
        }
        Err(error) => eprintln!("left out: systemd-analyze: {error}"),
    }
}
