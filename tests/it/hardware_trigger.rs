//! Hardware-triggered shots: the camera sends nothing until a pulse comes, and a shot ends with silence.

use crate::fake_gige::{ADDRESS, FakeGige, Wiring};
use crate::genicam::draw;
use crate::pipeline::drift;
use crate::support::{Background, Rig, csv, frames, ricochet, run, succeed, wait_until};
use ricochet::camera::genicam::sys;
use ricochet::recording::Recording;
use std::path::Path;
use std::time::Duration;

/// Starts a rig whose camera waits for Line1.
fn armed(rig: &Rig, gige: &FakeGige) -> Background {
    let source = format!(
        "source = \"genicam\"\nid = \"{ADDRESS}\"\nwidth_px = 512\nheight_px = 512\npixel_format = \"Mono8\"\n\
         frame_rate_hz = 100\nexposure_us = 100\ntrigger_source = \"Line1\"\npacket_size_bytes = 1440"
    );
    let config = rig.config(&source, "[trigger]\nmode = \"hardware\"\nsilence_s = 0.15\n[workers]\ncount = 0");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_until("the camera waits for its line", || {
        (gige.register(sys::ARV_FAKE_CAMERA_REGISTER_ACQUISITION) == 1).then_some(())
    });
    service
}

/// The sequence numbers and image indices of a recording's frames.
fn indices(path: &Path) -> Vec<(u64, u64)> {
    let index = |bytes: &[u8]| u64::from_le_bytes(bytes[..8].try_into().unwrap());
    frames(path).iter().map(|(meta, bytes)| (meta.sequence, index(bytes))).collect()
}

#[test]
fn each_of_20_pulses_makes_its_own_shot_the_first_one_included() {
    let Some(gige) = FakeGige::plug_in(Wiring::Line1, u64::MAX, draw) else { return };
    let rig = Rig::new();
    let service = armed(&rig, &gige);
    for pulse in 0..20 {
        gige.pulse();
        wait_until("the shot is written and the rig armed again", || {
            (rig.recordings().len() == pulse + 1).then_some(())
        });
    }
    let refused = run(["trigger", "--rig", rig.name.as_str()]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8(refused.stderr).unwrap().contains("shots begin on the camera's line"));
    service.signal(2);
    let (code, printed, stderr) = service.end();
    assert_eq!((code, printed.lines().count()), (Some(0), 20), "{stderr}");
    let mut shots: Vec<_> = rig.recordings().iter().map(|path| indices(path)).collect();
    shots.sort();
    assert_eq!(shots, (0..20).map(|pulse| vec![(pulse, pulse)]).collect::<Vec<_>>());
    assert_eq!(gige.sent(), 20);
    let trigger = Recording::open(&rig.recordings()[0]).unwrap().metadata()["trigger"].clone();
    assert_eq!(trigger, "line Line1 at frame 0");
}

#[test]
fn pulses_without_silence_between_are_one_shot() {
    let Some(gige) = FakeGige::plug_in(Wiring::Line1, u64::MAX, draw) else { return };
    let rig = Rig::new();
    let service = armed(&rig, &gige);
    let mut sent = 0;
    for shot in 0..5 {
        for _ in 0..=shot {
            gige.pulse();
            sent += 1;
            wait_until("the frame is sent", || (gige.sent() == sent).then_some(()));
        }
        // The shot is still being written when the next one begins.
        std::thread::sleep(Duration::from_millis(400));
    }
    wait_until("all shots are written", || (rig.recordings().len() == 5).then_some(()));
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(0), "{stderr}");
    let mut shots: Vec<_> = rig.recordings().iter().map(|path| indices(path)).collect();
    shots.sort();
    let mut numbers = 0..;
    let wanted: Vec<Vec<(u64, u64)>> =
        (1..=5).map(|frames| numbers.by_ref().take(frames).map(|n| (n, n)).collect()).collect();
    assert_eq!(shots, wanted);
}

#[test]
fn shots_of_an_imitated_line_are_measured_separately_live_and_analysed() {
    let rig = Rig::new();
    let film = rig.file("drift.toml", &drift(60, 200.0));
    let source =
        format!("source = \"simulated\"\nscenario = \"{}\"\npulse_period_s = 0.6\npulse_frames = 12", film.display());
    // Blocks of 8 frames begin within shots and extend from one into the next.
    let rest = "[scale]\nmm_per_px = 0.5\n[trigger]\nmode = \"hardware\"\nsilence_s = 0.2\n[workers]\ncount = 2\nblock_frames = 8";
    let config = rig.config(&source, rest);
    let listen = |topic: &str| {
        let name = rig.name.as_str();
        Background::start(ricochet(["listen", topic, "--rig", name, "--json", "--wait", "60"]))
    };
    let (velocity, events) = (listen("velocity"), listen("events"));
    let (code, printed, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!((code, printed.lines().count()), (Some(0), 5), "{stderr}");
    let live: Vec<serde_json::Value> =
        velocity.end().1.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(live.len(), 60, "one row per frame");
    for (shot, path) in printed.lines().map(Path::new).enumerate() {
        let film = frames(path);
        let sequences: Vec<u64> = film.iter().map(|(meta, _)| meta.sequence).collect();
        assert_eq!(sequences, (12 * shot as u64..12 * (shot as u64 + 1)).collect::<Vec<_>>());
        let results = rig.path(&format!("results-{shot}.mcap"));
        succeed(["analyze".as_ref(), path.as_os_str(), "-o".as_ref(), results.as_os_str()]);
        for topic in ["velocity", "track", "field", "impact"] {
            assert!(csv(&results, topic) == csv(path, topic), "{topic} of shot {shot}");
        }
        let table = csv(path, "velocity");
        let mut reader = csv::Reader::from_reader(table.as_bytes());
        let header = reader.headers().unwrap().clone();
        let column = |name: &str| header.iter().position(|cell| cell == name).unwrap();
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        for (row, line) in rows.iter().zip(&live[12 * shot..]) {
            for name in ["dx_px", "vx_m_s", "sigma_v_m_s"] {
                let recorded = row[column(name)].parse::<f64>().ok().map(f64::to_bits);
                assert_eq!(line[name].as_f64().map(f64::to_bits), recorded, "{name} of {line}");
            }
        }
        assert_eq!(&rows[11][column("dx_px")], "", "nothing leads to the next shot");
        assert!(rows[..11].iter().all(|row| row[column("dx_px")].parse::<f64>().unwrap().abs() < 1.0));
    }
    let stamps: Vec<u64> = live.iter().map(|line| line["stamp_ns"].as_u64().unwrap()).collect();
    assert_eq!(
        (stamps[1] - stamps[0], stamps[12] - stamps[0]),
        (5_000_000, 600_000_000),
        "the camera's clock continues"
    );
    let states = states(&events.end().1);
    let written = states.iter().filter(|state| *state == "writing").count();
    assert_eq!(written, 5, "{states:?}");
    assert!(states.iter().filter(|state| *state == "done").count() >= 4, "{states:?}");
}

/// The states of a rig, from the lines of a listener to its events.
fn states(events: &str) -> Vec<String> {
    let events = events.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let states = events.filter(|event| event["kind"] == "state");
    states.map(|event| event["text"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn a_rig_that_only_records_reports_its_states() {
    let rig = Rig::new();
    let film = rig.file("drift.toml", &drift(36, 200.0));
    let source =
        format!("source = \"simulated\"\nscenario = \"{}\"\npulse_period_s = 0.6\npulse_frames = 12", film.display());
    let rest = "[scale]\nmm_per_px = 0.5\n[trigger]\nmode = \"hardware\"\nsilence_s = 0.2\n[workers]\ncount = 0";
    let config = rig.config(&source, rest);
    let events =
        Background::start(ricochet(["listen", "events", "--rig", rig.name.as_str(), "--json", "--wait", "60"]));
    let (code, printed, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!((code, printed.lines().count()), (Some(0), 3), "{stderr}");
    let states = states(&events.end().1);
    let mut order = states.iter();
    for wanted in ["preparing", "armed", "writing", "armed", "writing", "armed", "writing", "done"] {
        assert!(order.any(|state| state == wanted), "{wanted} in order among {states:?}");
    }
}

#[test]
fn two_cameras_on_one_line_share_each_shot() {
    let rig = Rig::new();
    let film = rig.file("drift.toml", &drift(36, 200.0));
    let source =
        format!("source = \"simulated\"\nscenario = \"{}\"\npulse_period_s = 0.8\npulse_frames = 12", film.display());
    let view = format!(
        "[view.side.camera]\n{source}\n[view.side.scale]\nmm_per_px = 0.5\n[[view.side.body]]\nname = \"disc\""
    );
    let trigger = "[trigger]\nmode = \"hardware\"\nsilence_s = 0.3\n[workers]\ncount = 1\nblock_frames = 8";
    let config = rig.config(&source, &format!("[scale]\nmm_per_px = 0.5\n{view}\n{trigger}"));
    let (code, printed, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!((code, printed.lines().count()), (Some(0), 3), "{stderr}");
    for (shot, path) in printed.lines().map(Path::new).enumerate() {
        let recording = Recording::open(path).unwrap();
        let wanted: Vec<u64> = (12 * shot as u64..12 * (shot as u64 + 1)).collect();
        for camera in [recording.clone(), recording.view("side").unwrap()] {
            let sequences: Vec<u64> = camera.frames().unwrap().map(|frame| frame.unwrap().0.sequence).collect();
            assert_eq!(sequences, wanted);
            let rows: Vec<_> = camera.velocities().unwrap().map(Result::unwrap).collect();
            assert!(rows.len() == 12 && rows[..11].iter().all(|row| row.motion.is_some()), "{rows:?}");
        }
        assert!(csv(path, "events").contains("side: 12 of 12 frames match one of the first camera"));
    }
}
