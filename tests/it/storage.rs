//! A directory that is full, missing or read-only costs recordings, never the measurement.

use crate::pipeline::drift;
use crate::support::{Background, Rig, csv, frames, process, ricochet, status, succeed, wait_until};
use ricochet::recording::Recording;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A small file system mounted on a directory, unmounted at the end of the test.
struct Mounted(PathBuf);

impl Mounted {
    /// Returns `None` and prints a line where mounting is not allowed.
    fn new(path: &Path, size: &str) -> Option<Self> {
        std::fs::create_dir_all(path).unwrap();
        let options = format!("size={size}");
        if mount(&["-t", "tmpfs", "-o", &options, "tmpfs"], path) {
            return Some(Self(path.to_path_buf()));
        }
        eprintln!("left out: this user may not mount a file system");
        None
    }

    fn remount(&self, options: &str) {
        assert!(mount(&["-o", &format!("remount,{options}")], &self.0), "remount with {options}");
    }
}

impl Drop for Mounted {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(&self.0).status();
    }
}

fn mount(arguments: &[&str], path: &Path) -> bool {
    Command::new("mount").args(arguments).arg(path).output().is_ok_and(|output| output.status.success())
}

const RATE_HZ: f64 = 120.0;

/// Starts a rig that records for longer than any test needs.
fn start(rig: &Rig, trigger: &str) -> Background {
    let scenario = rig.file("long.toml", &drift(20_000, RATE_HZ));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let config =
        rig.config(&camera, &format!("[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1\nblock_frames = 16\n{trigger}"));
    Background::start(ricochet(["run".as_ref(), config.as_os_str()]))
}

const SHOTS: &str = "[trigger]\nmode = \"software\"\npre_s = 0.5\npost_s = 0.5";

fn number(status: &Value, name: &str, key: &str) -> u64 {
    process(status, name, 0).map_or(0, |process| process[key].as_u64().unwrap())
}

fn wait_for(rig: &Rig, what: &str, condition: impl Fn(&Value) -> bool) -> Value {
    wait_until(what, || status(&rig.name).filter(|status| condition(status)))
}

/// Checks that frames are still measured and no process has died.
fn is_measuring(rig: &Rig) {
    let before = number(&wait_for(rig, "it answers", |_| true), "track", "sequence");
    let after = wait_for(rig, "the rig still measures", |status| number(status, "track", "sequence") > before + 100);
    assert_eq!(number(&after, "run", "restarts"), 0, "{after}");
    assert_eq!(number(&after, "acquire", "lost") + number(&after, "acquire", "dropped"), 0, "{after}");
}

fn is_troubled(status: &Value) -> bool {
    number(status, "record", "state") & 2 == 2
}

fn parts(rig: &Rig) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(rig.path("shots")) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "part"));
    paths.sort();
    paths
}

/// Takes a shot, which must be complete and give the same numbers in an analysis.
fn a_shot_works(rig: &Rig) {
    let before = rig.recordings().len();
    succeed(["trigger", "--rig", rig.name.as_str()]);
    wait_until("the shot is written", || (rig.recordings().len() > before).then_some(()));
    let path = rig.recordings().pop().unwrap();
    let sequences: Vec<u64> = frames(&path).iter().map(|(meta, _)| meta.sequence).collect();
    assert!(sequences.len() > 60, "half a second after the trigger: {}", sequences.len());
    assert_eq!(sequences, (sequences[0]..sequences[0] + sequences.len() as u64).collect::<Vec<_>>());
    let results = rig.path("results.mcap");
    succeed(["analyze".as_ref(), path.as_os_str(), "-o".as_ref(), results.as_os_str()]);
    assert_eq!(csv(&results, "velocity"), csv(&path, "velocity"));
}

/// Stops the rig, which must report a loss, and returns its standard error.
fn ends_with_a_loss(service: Background) -> String {
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    assert!(stderr.contains("finished, but data were lost"), "{stderr}");
    assert!(stderr.contains("record 0 lost"), "{stderr}");
    stderr
}

#[test]
fn a_shot_on_a_full_disk_keeps_what_fits_and_the_next_is_complete() {
    let rig = Rig::new();
    let Some(disk) = Mounted::new(&rig.path("shots"), "1m") else { return };
    let service = start(&rig, SHOTS);
    let before = wait_for(&rig, "it warns", |status| number(status, "track", "sequence") > 100 && is_troubled(status));
    assert_eq!(number(&before, "record", "state") & 1, 1, "still armed");
    succeed(["trigger", "--rig", rig.name.as_str()]);
    let after = wait_for(&rig, "the shot ends with a loss", |status| number(status, "record", "lost") > 0);
    is_measuring(&rig);

    let part = &parts(&rig)[0];
    let cut = Recording::open(part).unwrap();
    assert!(cut.truncated().is_some());
    let kept: Vec<u64> = cut.frames().unwrap().filter_map(Result::ok).map(|(meta, _)| meta.sequence).collect();
    let lost = number(&after, "record", "lost") as usize;
    println!("{} frames kept, {lost} reported missing", kept.len());
    assert!(kept.len() > 10, "a frame has 23 kB, so fewer than 45 fit: {}", kept.len());
    assert_eq!(kept, (kept[0]..kept[0] + kept.len() as u64).collect::<Vec<_>>(), "no hole");
    // 121 frames and up to a block before them. Frames of the open chunk count as lost even where they can be read.
    assert!(lost + kept.len() >= 121 && lost <= 137, "lost frames are neither missed nor counted twice");
    let saved = rig.path("saved.mcap");
    let _ = crate::support::run(["recover".as_ref(), part.as_os_str(), "-o".as_ref(), saved.as_os_str()]);
    assert_eq!(frames(&saved).len(), kept.len());

    disk.remount("size=64m");
    wait_for(&rig, "the free space is noticed", |status| !is_troubled(status));
    a_shot_works(&rig);
    let stderr = ends_with_a_loss(service);
    assert!(stderr.contains("a recording may need"), "the warning before: {stderr}");
    assert!(stderr.contains("No space left on device"), "{stderr}");
}

#[test]
fn a_stream_on_a_full_disk_starts_a_new_file_when_there_is_space() {
    let rig = Rig::new();
    let Some(disk) = Mounted::new(&rig.path("shots"), "5m") else { return };
    let service = start(&rig, "");
    let full = wait_for(&rig, "the disk is full", |status| number(status, "record", "lost") > 200);
    assert!(is_troubled(&full), "{full}");
    is_measuring(&rig);
    assert!(rig.recordings().is_empty());
    assert_eq!(parts(&rig).len(), 1, "no file starts without space for it");
    let kept = frames_of_part(&parts(&rig)[0]);
    assert!(kept.len() > 80 && kept == (0..kept.len() as u64).collect::<Vec<_>>(), "{kept:?}");

    disk.remount("size=256m");
    wait_until("a second file", || (parts(&rig).len() == 2).then_some(()));
    let again = number(&wait_for(&rig, "it answers", |_| true), "record", "taken");
    wait_for(&rig, "it fills", |status| number(status, "record", "taken") > again + 100);
    let stderr = ends_with_a_loss(service);
    assert!(stderr.contains("No space left on device"), "{stderr}");
    let second = &rig.recordings()[0];
    let sequences: Vec<u64> = frames(second).iter().map(|(meta, _)| meta.sequence).collect();
    assert!(sequences.len() > 90 && sequences[0].is_multiple_of(16), "{} from {}", sequences.len(), sequences[0]);
    assert_eq!(sequences, (sequences[0]..sequences[0] + sequences.len() as u64).collect::<Vec<_>>());
    let results = rig.path("results.mcap");
    succeed(["analyze".as_ref(), second.as_os_str(), "-o".as_ref(), results.as_os_str()]);
    assert_eq!(csv(&results, "velocity"), csv(second, "velocity"));
}

fn frames_of_part(path: &Path) -> Vec<u64> {
    let frames = Recording::open(path).unwrap().frames().unwrap();
    frames.filter_map(Result::ok).map(|(meta, _)| meta.sequence).collect()
}

#[test]
fn a_source_on_demand_is_not_held_back_by_a_full_disk() {
    let rig = Rig::new();
    let Some(_disk) = Mounted::new(&rig.path("shots"), "1m") else { return };
    let scenario = rig.file("drift.toml", &drift(600, 1000.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = false", scenario.display());
    let config = rig.config(&camera, "[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1\nblock_frames = 16");
    let (code, _, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!(code, Some(6), "{stderr}");
    let kept = frames_of_part(&parts(&rig)[0]);
    let lost = stderr.split("record 0 lost ").nth(1).unwrap().trim().parse::<usize>().unwrap();
    println!("{} frames kept, {lost} reported missing", kept.len());
    assert!(kept.len() > 10 && (600..700).contains(&(lost + kept.len())), "{} and {lost}", kept.len());
}

#[test]
fn a_directory_removed_during_a_stream_is_reported_and_made_again() {
    let rig = Rig::new();
    let service = start(&rig, "");
    wait_for(&rig, "it records", |status| number(status, "record", "taken") > 60);
    std::fs::remove_dir_all(rig.path("shots")).unwrap();
    let after = wait_for(&rig, "it notices", |status| number(status, "record", "lost") > 0);
    wait_until("it begins another file", || (parts(&rig).len() == 1).then_some(()));
    is_measuring(&rig);
    let stderr = ends_with_a_loss(service);
    assert!(stderr.contains("the file was removed while it was written"), "{stderr}");
    let sequences: Vec<u64> = frames(&rig.recordings()[0]).iter().map(|(meta, _)| meta.sequence).collect();
    assert!(sequences[0] >= number(&after, "record", "lost").min(60), "the frames before are gone, and counted");
    assert_eq!(sequences, (sequences[0]..sequences[0] + sequences.len() as u64).collect::<Vec<_>>());
}

#[test]
fn a_directory_removed_before_a_shot_is_made_again() {
    let rig = Rig::new();
    let service = start(&rig, SHOTS);
    wait_for(&rig, "it measures", |status| number(status, "track", "sequence") > 100);
    std::fs::remove_dir_all(rig.path("shots")).unwrap();
    wait_for(&rig, "it notices", is_troubled);
    a_shot_works(&rig);
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(0), "nothing was lost: {stderr}");
    assert!(stderr.contains("cannot be written into: No such file or directory"), "{stderr}");
}

#[test]
fn a_read_only_directory_costs_one_shot_and_not_the_next() {
    let rig = Rig::new();
    let Some(disk) = Mounted::new(&rig.path("shots"), "64m") else { return };
    let service = start(&rig, SHOTS);
    let listener = ["listen", "events", "--rig", rig.name.as_str(), "--json", "--wait", "60"];
    let listener = Background::start(ricochet(listener));
    wait_for(&rig, "it measures", |status| number(status, "track", "sequence") > 100);
    disk.remount("ro");
    wait_for(&rig, "it notices", is_troubled);
    succeed(["trigger", "--rig", rig.name.as_str()]);
    let after = wait_for(&rig, "the shot is given up", |status| number(status, "record", "lost") > 0);
    assert!((121..=137).contains(&number(&after, "record", "lost")), "every frame of the shot: {after}");
    is_measuring(&rig);
    disk.remount("rw");
    wait_for(&rig, "it sees that it may write", |status| !is_troubled(status));
    a_shot_works(&rig);
    let stderr = ends_with_a_loss(service);
    assert!(stderr.contains("Read-only file system"), "{stderr}");
    let (_, events, _) = listener.end();
    let events: Vec<Value> = events.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let texts = |kind: &str| -> Vec<String> {
        let of_kind = events.iter().filter(|event| event["kind"] == kind);
        of_kind.map(|event| event["text"].as_str().unwrap().to_owned()).collect()
    };
    let storage = texts("storage");
    assert_eq!(storage.len(), 2, "{storage:?}");
    assert!(storage[0].contains("cannot be written into") && storage[1].ends_with("again"), "{storage:?}");
    assert_eq!(texts("lost").len(), 1, "{events:?}");
}

#[test]
fn old_recordings_are_removed_and_reported_by_name() {
    let rig = Rig::new();
    let scenario = rig.file("long.toml", &drift(20_000, RATE_HZ));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let rest = "keep_last = 2\n[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1\n\
                [trigger]\nmode = \"software\"\npre_s = 0.05\npost_s = 0.1";
    let config = rig.config(&camera, rest);
    let mine = rig.file("mine.txt", "kept");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let listener = ["listen", "events", "--rig", rig.name.as_str(), "--json", "--wait", "60"];
    let listener = Background::start(ricochet(listener));
    wait_for(&rig, "it measures", |status| number(status, "track", "sequence") > 60);
    std::fs::rename(mine, rig.path("shots").join("mine.mcap")).unwrap();
    let mut all: Vec<PathBuf> = Vec::new();
    for shot in 1..=4 {
        succeed(["trigger", "--rig", rig.name.as_str()]);
        let own = |path: &PathBuf| !all.contains(path) && !path.ends_with("mine.mcap");
        let new = wait_until("the shot is written", || rig.recordings().into_iter().find(own));
        all.push(new);
        let left = wait_until("an old one is gone", || {
            let left = rig.recordings();
            (left.len() == shot.min(2) + 1).then_some(left)
        });
        assert!(all.iter().rev().take(2).all(|path| left.contains(path)), "{left:?} of {all:?}");
        wait_for(&rig, "it is armed again", |status| number(status, "record", "state") & 1 == 1);
    }
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!(code, Some(0), "nothing was lost: {stderr}");
    let named: Vec<PathBuf> = printed.lines().map(PathBuf::from).collect();
    assert_eq!(named, all[2..], "only existing recordings");
    let (_, events, _) = listener.end();
    let events: Vec<Value> = events.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let texts: Vec<&str> =
        events.iter().filter(|e| e["kind"] == "storage").map(|e| e["text"].as_str().unwrap()).collect();
    assert_eq!(texts.len(), 2, "{texts:?}");
    for (text, path) in texts.iter().zip(&all) {
        assert!(
            text.contains(path.file_name().unwrap().to_str().unwrap()) && text.ends_with("keep_last = 2"),
            "{text}"
        );
    }
}
