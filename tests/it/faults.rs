//! Dead processes are restarted, losses are counted, and the other processes keep running.

use crate::pipeline::drift;
use crate::support::{Background, Rig, frames, kill, process, ricochet, status, wait_until};
use ricochet::recording::Recording;
use serde_json::Value;
use std::time::{Duration, Instant};

fn number(status: &Value, name: &str, key: &str) -> u64 {
    process(status, name, 0).map_or(0, |process| process[key].as_u64().unwrap())
}

/// Kills one process of a running rig and returns its exit code, its standard error, and the rig.
fn kill_during_a_run(victim: &str) -> (Option<i32>, String, Rig) {
    let rig = Rig::new();
    let scenario = rig.file("drift.toml", &drift(3000, 300.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let config = rig.config(&camera, "[scale]\nmm_per_px = 0.5\n[workers]\ncount = 2");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let before = wait_until("the rig measures", || {
        let status = status(&rig.name)?;
        (number(&status, "track", "given") > 100).then_some(status)
    });
    let pid = u32::try_from(number(&before, victim, "pid")).unwrap();
    kill(pid, 9);
    let killed = Instant::now();
    let after = wait_until("it is back", || {
        let status = status(&rig.name)?;
        let back = number(&status, victim, "pid");
        (back != u64::from(pid) && back != 0).then_some(status)
    });
    let back = killed.elapsed();
    println!("{victim} was back after {back:?}");
    assert!(back < Duration::from_secs(2), "{victim} took {back:?} to come back");
    assert_eq!(number(&after, "run", "restarts"), 1);
    let frame = number(&after, "acquire", "sequence");
    let later = wait_until("the rig measures again", || {
        let status = status(&rig.name)?;
        let resumed = number(&status, victim, "given").max(number(&status, victim, "taken")) > 50;
        (resumed && number(&status, "track", "sequence") > frame + 100).then_some(status)
    });
    assert_eq!(number(&later, "run", "lost"), 0, "no process takes its counts with it: {later}");
    assert_eq!(
        number(&later, "acquire", "lost") + number(&later, "acquire", "dropped"),
        0,
        "acquisition never noticed"
    );
    service.signal(2);
    let (code, _, stderr) = service.end();
    (code, stderr, rig)
}

#[test]
fn a_killed_worker_is_restarted_and_its_frames_are_counted() {
    let (code, stderr, rig) = kill_during_a_run("correlate");
    assert_eq!(code, Some(6), "{stderr}");
    let recording = Recording::open(&rig.recordings()[0]).unwrap();
    let frames = recording.frame_count();
    let rows: Vec<_> = recording.velocities().unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len() as u64, frames, "one row per frame, lost ones included");
    let lost = rows.iter().filter(|row| row.status == ricochet::results::PointStatus::Lost).count();
    println!("{lost} of {frames} rows lost");
    assert!(lost > 0 && lost < rows.len() / 4, "{lost} of {frames}");
}

#[test]
fn a_killed_tracker_is_restarted_and_the_recording_is_complete() {
    let (code, stderr, rig) = kill_during_a_run("track");
    assert_eq!(code, Some(6), "{stderr}");
    let recording = Recording::open(&rig.recordings()[0]).unwrap();
    let rows: Vec<_> = recording.velocities().unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len() as u64, recording.frame_count());
    assert!(rows.iter().all(|row| row.status != ricochet::results::PointStatus::Lost));
}

#[test]
fn a_killed_recorder_leaves_a_readable_file_and_starts_another() {
    let (code, stderr, rig) = kill_during_a_run("record");
    assert_eq!(code, Some(6), "{stderr}");
    let finished = rig.recordings();
    assert_eq!(finished.len(), 1, "{stderr}");
    let entries = std::fs::read_dir(rig.path("shots")).unwrap().map(|entry| entry.unwrap().path());
    let part = entries.into_iter().find(|path| path.extension().is_some_and(|name| name == "part")).unwrap();
    let cut = Recording::open(&part).unwrap();
    println!("{}: {:?}", cut.frame_count(), cut.truncated());
    assert!(cut.truncated().is_some());
    let before: Vec<u64> = frames_until_the_cut(&part);
    assert!(before.len() > 50, "{} frames before the cut", before.len());
    assert_eq!(before, (0..before.len() as u64).collect::<Vec<_>>());
    let after: Vec<u64> = frames(&finished[0]).iter().map(|(meta, _)| meta.sequence).collect();
    assert!(after[0] > *before.last().unwrap() && after[0].is_multiple_of(16));
    assert_eq!(after, (after[0]..after[0] + after.len() as u64).collect::<Vec<_>>());
}

fn frames_until_the_cut(path: &std::path::Path) -> Vec<u64> {
    let frames = Recording::open(path).unwrap().frames().unwrap();
    frames.filter_map(Result::ok).map(|(meta, _)| meta.sequence).collect()
}

#[test]
fn a_killed_supervisor_takes_its_processes_with_it() {
    let rig = Rig::new();
    let scenario = rig.file("drift.toml", &drift(6000, 300.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let config = rig.config(&camera, "");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let pids: Vec<u32> = wait_until("all run", || {
        let status = status(&rig.name)?;
        let processes = status["processes"].as_array().unwrap();
        let pids = processes.iter().filter(|process| process["process"] != "run");
        let pids: Vec<u32> = pids.map(|process| u32::try_from(process["pid"].as_u64().unwrap()).unwrap()).collect();
        (pids.len() >= 4 && number(&status, "track", "given") > 10).then_some(pids)
    });
    service.signal(9);
    let gone =
        |pid: &u32| std::fs::read_to_string(format!("/proc/{pid}/stat")).map_or(true, |stat| stat.contains(") Z "));
    wait_until("they end", || pids.iter().all(gone).then_some(()));
}

#[test]
fn a_stopped_camera_process_counts_the_frames_without_a_slot() {
    let rig = Rig::new();
    let scenario = rig.file("drift.toml", &drift(3000, 300.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let config = rig.config(&camera, "[workers]\ncount = 0");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let before = wait_until("frames are recorded", || {
        let status = status(&rig.name)?;
        (number(&status, "record", "sequence") > 60).then_some(status)
    });
    let pid = u32::try_from(number(&before, "acquire", "pid")).unwrap();
    kill(pid, 19);
    // Twice the time that its 64 slots last.
    std::thread::sleep(Duration::from_millis(430));
    kill(pid, 18);
    let after = wait_until("frames are recorded again", || {
        let status = status(&rig.name)?;
        (number(&status, "acquire", "lost") > 0 && number(&status, "record", "sequence") > 300).then_some(status)
    });
    assert_eq!(number(&after, "acquire", "pid"), u64::from(pid));
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    let film = frames(std::path::Path::new(printed.trim()));
    let missing = film.last().unwrap().0.sequence + 1 - film.len() as u64;
    println!("{missing} frames found no slot: {stderr}");
    assert!(missing >= 30 && film.iter().all(|(meta, _)| meta.epoch == 0), "{missing} missing");
    assert!(stderr.contains(&format!("acquire 0 lost {missing}")), "{stderr}");
    let kinds = format!("lost: {missing} frames by the camera, {missing} frames not recorded;");
    assert!(stderr.contains(&kinds), "{stderr}");
}
