//! Rigs that measure live: one whose camera is faster than its workers, and one set up for the shortest delay.

use crate::pipeline_faults::{analysis, drifting, tables};
use crate::support::{Background, Rig, process, ricochet, status, succeed, wait_until};
use ricochet::recording::Recording;
use ricochet::results::PointStatus;
use serde_json::Value;

/// A rig whose only worker is several times slower than its camera, with a ring of a second.
fn overloaded(rig: &Rig) -> std::path::PathBuf {
    let rest = "[correlation]\nsubset_size_px = 21\nstep_px = 1\n\
                [trigger]\nmode = \"software\"\npre_s = 0.3\npost_s = 0.1\n[workers]\ncount = 1\n";
    drifting(rig, "endless = true\nframe_rate_hz = 2000.0", rest)
}

#[test]
fn a_camera_faster_than_its_worker_is_measured_in_part_and_its_shots_completely_afterwards() {
    let rig = Rig::new();
    let config = overloaded(&rig);
    let events = Background::start(ricochet(["listen", "events", "--rig", &rig.name, "--json", "--wait", "60"]));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let worker = |key: &str| process(&status(&rig.name)?, "correlate", 0)?[key].as_u64();
    wait_until("the worker leaves out blocks", || worker("state").filter(|every| *every > 1));
    succeed(["trigger", "--rig", rig.name.as_str()]);
    let shot = wait_until("the shot is recorded", || rig.recordings().into_iter().next());
    let name = shot.file_stem().unwrap().to_str().unwrap().to_owned();
    let results = shot.with_file_name(format!("{name}.results-1.mcap"));
    wait_until("the shot is measured after it was recorded", || results.exists().then_some(()));
    // None, unless the machine was too busy to run the worker at all: other tests run beside this one.
    let [lost, filmed] = ["lost", "sequence"].map(|key| worker(key).unwrap());
    assert!(4 * lost < filmed, "its queue hardly ever overflows: {lost} of {filmed} frames");
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!(code, Some(6), "{stderr}");
    assert!(
        stderr.contains("measures 1 block of") && stderr.contains("measured after the shot: "),
        "{printed} {stderr}"
    );

    let live: Vec<_> = Recording::open(&shot).unwrap().velocities().unwrap().map(Result::unwrap).collect();
    let missing = live.iter().filter(|row| row.status == PointStatus::Lost).count();
    assert!(live.len() >= 800 && missing > 100 && missing < live.len(), "{missing} of {} rows", live.len());
    let (code, analysed) = analysis(&rig, &shot, "2");
    assert_eq!(code, Some(0));
    assert!(tables(&results) == analysed, "the rows after the shot are those of its analysis");

    let (_, printed, _) = events.end();
    let rows: Vec<Value> = printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let texts = |kind: &str| -> Vec<&str> {
        rows.iter().filter(|row| row["kind"] == kind).filter_map(|row| row["text"].as_str()).collect()
    };
    assert!(texts("behind").iter().any(|text| text.contains(" measures 1 block of ")), "{:?}", texts("behind"));
    assert_eq!(texts("remeasured"), [results.to_str().unwrap()]);
}

#[test]
fn a_rig_for_the_shortest_delay_has_the_same_results() {
    let rig = Rig::new();
    let config = drifting(&rig, "paced = false", "[workers]\ncount = 2\nmode = \"latency\"\n");
    succeed(["run".as_ref(), config.as_os_str()]);
    let recording = &rig.recordings()[0];
    let (code, analysed) = analysis(&rig, recording, "1");
    assert_eq!(code, Some(0));
    assert!(analysed == tables(recording));
}
