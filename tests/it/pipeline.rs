//! The whole pipeline in real processes: demo, live topics, replay, analysis.

use crate::figures;
use crate::support::{Background, Rig, csv, frames, ricochet, run, succeed, wait_until};
use ricochet::recording::Recording;

#[test]
fn demo_measures_the_truth_and_records_it() {
    let rig = Rig::new();
    let shots = rig.path("shots");
    let printed = succeed(["demo".as_ref(), "lacrosse".as_ref(), "--json".as_ref(), "-o".as_ref(), shots.as_os_str()]);
    let report: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let error = |name: &str| {
        let row = report["compared"].as_array().unwrap().iter().find(|row| row["name"] == name).unwrap();
        let (measured, truth) = (row["measured"].as_f64().unwrap(), row["true"].as_f64().unwrap());
        println!("{name}: {measured} +- {}, true {truth}", row["sigma"]);
        (measured - truth, truth)
    };
    for name in ["vn_before_m_s", "vn_after_m_s", "vt_before_m_s", "vt_after_m_s", "restitution"] {
        let (error, truth) = error(name);
        assert!(error.abs() <= 0.01 * truth.abs(), "{name}: error {error}");
    }
    let (error_spin, spin) = error("omega_after_rad_s");
    assert!(error_spin.abs() <= 0.05 * spin.abs(), "spin error {error_spin} rad/s");
    for name in ["start_s", "end_s"] {
        let (error, _) = error(name);
        assert!(error.abs() <= 1e-4, "{name}: error {error} s, more than a frame");
    }
    let recording = Recording::open(&rig.recordings()[0]).unwrap();
    assert_eq!(recording.frame_count(), 100);
    assert_eq!(recording.truncated(), None);
    let listed = report["figures"].as_array().unwrap();
    assert!(listed.iter().all(|path| std::path::Path::new(path.as_str().unwrap()).is_file()), "{listed:?}");
    let expected: [(&str, &[&str], usize); 4] = [
        ("fig19-position", &["normal position, mm", "tangential position, mm", "time, ms", "truth"], 2),
        ("fig20-velocity", &["normal velocity, m/s", "tangential velocity, m/s", "class=\"contact\""], 2),
        ("fig21-spin", &["spin, rad/s", "class=\"band a\""], 1),
        ("fig18-field", &["Contact starts", "Deepest", "Contact ends"], 0),
    ];
    figures::check(&shots, 100, &expected);
}

#[test]
fn demo_tennis_agrees_with_the_truth() {
    let rig = Rig::new();
    let shots = rig.path("shots");
    let printed = succeed(["demo".as_ref(), "tennis".as_ref(), "--json".as_ref(), "-o".as_ref(), shots.as_os_str()]);
    let report: serde_json::Value = serde_json::from_str(&printed).unwrap();
    for row in report["compared"].as_array().unwrap() {
        println!("{}: {} +- {}, true {}", row["name"], row["measured"], row["sigma"], row["true"]);
        assert_eq!(row["within"], true, "{row}");
    }
    assert_eq!(Recording::open(&rig.recordings()[0]).unwrap().frame_count(), 150);
    let expected: [(&str, &[&str], usize); 4] = [
        ("fig14-position", &["normal position, mm", "tangential position, mm"], 2),
        ("fig15-velocity", &["normal velocity, m/s", "tangential velocity, m/s"], 2),
        ("fig16-spin", &["spin, rad/s"], 1),
        ("fig13-field", &["Contact starts", "Deepest", "Contact ends"], 0),
    ];
    figures::check(&shots, 150, &expected);
}

#[test]
fn live_topic_recording_and_analysis_give_the_same_bytes() {
    let rig = Rig::new();
    let config = rig.config(
        "source = \"simulated\"\npaced = false\nexposure_us = 20",
        "[scale]\nmm_per_px = 0.5142\n[workers]\ncount = 2",
    );
    let name = rig.name.as_str();
    let listener = Background::start(ricochet(["listen", "velocity", "--rig", name, "--json", "--wait", "60"]));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(0), "{stderr}");
    let (code, printed, stderr) = listener.end();
    assert_eq!(code, Some(0), "{stderr}");

    let recording = &rig.recordings()[0];
    let recorded = csv(recording, "velocity");
    let results = rig.path("results.mcap");
    succeed(["analyze".as_ref(), recording.as_os_str(), "-o".as_ref(), results.as_os_str()]);
    assert_eq!(csv(&results, "velocity"), recorded, "analysis differs from the recording");
    assert_eq!(csv(&results, "field"), csv(recording, "field"));
    assert_eq!(csv(&results, "impact"), csv(recording, "impact"));
    assert_eq!(csv(&results, "track"), csv(recording, "track"));

    let mut reader = csv::Reader::from_reader(recorded.as_bytes());
    let header = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let lines: Vec<serde_json::Value> = printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), rows.len(), "one row per frame");
    for (line, row) in lines.iter().zip(&rows) {
        for column in ["frame", "stamp_ns", "dx_px", "dtheta_deg", "vx_m_s", "vn_m_s", "omega_rad_s", "sigma_v_m_s"] {
            let cell = &row[header.iter().position(|name| name == column).unwrap()];
            match line[column].as_f64() {
                None => assert_eq!(cell, "", "{column} of frame {}", line["frame"]),
                Some(live) => assert_eq!(cell.parse::<f64>().unwrap().to_bits(), live.to_bits(), "{column}"),
            }
        }
    }
}

#[test]
fn run_prints_when_it_films_and_each_shot_with_its_result() {
    let rig = Rig::new();
    let config = rig.config(
        "source = \"simulated\"\npaced = false\nexposure_us = 20",
        "[scale]\nmm_per_px = 0.5142\n[velocity]\ngravity_angle_deg = -71\n[workers]\ncount = 2",
    );
    let (code, printed, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!(code, Some(0), "{stderr}");
    let path = rig.recordings()[0].display().to_string();
    assert_eq!(printed.trim(), path);
    let lines: Vec<&str> = stderr.lines().collect();
    assert_eq!(lines[0], format!("filming: rig {}", rig.name));
    assert!(lines[1].starts_with(&format!("shot 1: {path}, ball restitution 0.79")), "{stderr}");
}

#[test]
fn results_do_not_depend_on_workers_or_pace() {
    let rig = Rig::new();
    let film = rig.path("film.mcap");
    succeed(["simulate".as_ref(), "lacrosse".as_ref(), "-o".as_ref(), film.as_os_str()]);
    let tables = |path: &std::path::Path| ["velocity", "field", "impact"].map(|topic| csv(path, topic));
    let mut all = Vec::new();
    for workers in ["1", "2", "3"] {
        let results = rig.path(&format!("results-{workers}.mcap"));
        let arguments = ["analyze".as_ref(), film.as_os_str(), "--workers".as_ref(), workers.as_ref()];
        succeed(arguments.into_iter().chain(["-o".as_ref(), results.as_os_str()]));
        all.push((format!("analysis by {workers}"), tables(&results)));
    }
    // The third replay repeats the first: two identical runs.
    for (number, (rate, workers)) in [("max", "1"), ("1", "2"), ("max", "1"), ("max", "3")].into_iter().enumerate() {
        let shots = rig.path(&format!("replay-{number}"));
        let name = format!("{}-{number}", rig.name);
        let arguments = ["replay".as_ref(), film.as_os_str(), "--rate".as_ref(), rate.as_ref(), "--workers".as_ref()];
        let output = ["-o".as_ref(), shots.as_os_str(), "--rig".as_ref(), name.as_ref()];
        let printed = succeed(arguments.into_iter().chain([workers.as_ref()]).chain(output));
        all.push((format!("replay at {rate} by {workers}"), tables(std::path::Path::new(printed.trim()))));
    }
    assert!(all[0].1[0].lines().count() > 100, "{}", all[0].1[0]);
    for (what, tables) in &all[1..] {
        assert!(*tables == all[0].1, "{what} differs from {}", all[0].0);
    }
}

#[test]
fn a_software_trigger_records_the_time_before_it_and_analysis_agrees() {
    let rig = Rig::new();
    let scenario = rig.file("drift.toml", &drift(2000, 250.0));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let config = rig.config(
        &camera,
        "[scale]\nmm_per_px = 0.5\n[trigger]\nmode = \"software\"\npre_s = 0.2\npost_s = 0.1\n[workers]\ncount = 1",
    );
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let name = rig.name.as_str();
    wait_until("half a second is recorded", || {
        let status = crate::support::status(name)?;
        (crate::support::process(&status, "acquire", 0)?["sequence"].as_u64()? > 125).then_some(())
    });
    let listed = succeed(["status"]);
    assert!(listed.lines().any(|line| line == format!("rig {name}")), "{listed}");
    let recorded = succeed(["trigger", "--rig", name, "--wait"]);
    assert_eq!(rig.recordings(), [std::path::PathBuf::from(recorded.trim())]);
    let refused = run(["trigger", "--rig", "no-such-rig"]);
    assert_eq!(refused.status.code(), Some(4));
    service.signal(15);
    let (code, printed, stderr) = service.end();
    assert_eq!(code, Some(0), "{stderr}");
    let path = &rig.recordings()[0];
    assert_eq!(printed.trim(), path.to_str().unwrap());

    let sequences: Vec<u64> = frames(path).iter().map(|(meta, _)| meta.sequence).collect();
    let first = sequences[0];
    assert_eq!(sequences, (first..first + sequences.len() as u64).collect::<Vec<_>>(), "no gap");
    assert_eq!(first % 64, 0, "a recording begins with a block");
    assert!((75..=75 + 64).contains(&sequences.len()), "0.3 s at 250 Hz and up to a block: {}", sequences.len());
    let results = rig.path("results.mcap");
    succeed(["analyze".as_ref(), path.as_os_str(), "-o".as_ref(), results.as_os_str()]);
    assert_eq!(csv(&results, "velocity"), csv(path, "velocity"));
    assert_eq!(csv(&results, "field"), csv(path, "field"));
}

#[test]
fn motion_triggers_a_shot() {
    let rig = Rig::new();
    let scenario = rig.file("fast.toml", &moving(400, 400.0, [60.0, 80.0], [0.0, 0.0]));
    let still = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let trigger = "[trigger]\nmode = \"motion\"\nthreshold_dn = 6\npre_s = 0.05\npost_s = 0.05\n";
    let config = rig.config(&still, trigger);
    // A ball at rest does not trigger, because noise of 2 grey levels changes the mean level by 2.3.
    let (code, printed, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!((code, printed.as_str()), (Some(0), ""), "{stderr}");
    let scenario =
        rig.file("moving.toml", &moving(400, 400.0, [40.0, 80.0], [3.0, 0.0]).replace("frames = 400", "frames = 40"));
    let moving = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let config = rig.config(&moving, trigger);
    let (code, _, stderr) = Background::start(ricochet(["run".as_ref(), config.as_os_str()])).end();
    assert_eq!(code, Some(0), "{stderr}");
    assert_eq!(rig.recordings().len(), 1, "{stderr}");
}

/// A small ball that drifts slowly for this many frames.
pub fn drift(frames: u64, rate_hz: f64) -> String {
    moving(frames, rate_hz, [60.0, 64.0], [16.0 / frames as f64, 0.0])
}

fn moving(frames: u64, rate_hz: f64, start_px: [f64; 2], step_px: [f64; 2]) -> String {
    let mut scenario = ricochet::synth::Scenario::translation(step_px[0], step_px[1], 0.0);
    scenario.name = "drift".into();
    scenario.camera.width_px = 160;
    scenario.camera.height_px = 144;
    scenario.camera.frames = frames;
    scenario.camera.frame_rate_hz = rate_hz;
    scenario.camera.exposure_us = 20.0;
    scenario.scale.mm_per_px = 0.5;
    scenario.body.diameter_mm = 36.0;
    if let ricochet::synth::MotionSetup::Constant { start_px: start, .. } = &mut scenario.motion {
        *start = start_px;
    }
    toml::to_string(&scenario).unwrap()
}
