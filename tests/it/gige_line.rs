//! A real GigE Vision stream through the whole pipeline: camera in this process, UDP on loopback, every other part in
//! its own process.

use crate::fake_gige::{ADDRESS, FakeGige, Wiring};
use crate::support::{Background, Rig, csv, frames, process, ricochet, status, succeed, wait_until};
use ricochet::synth::{Scenario, SimulatedFilm};
use std::sync::Arc;

const FRAMES: u64 = 100;

/// The lacrosse drop in frames of 512x512 px.
fn film() -> Vec<Vec<u8>> {
    let mut scenario = Scenario::built_in("lacrosse").unwrap();
    scenario.camera.width_px = 512;
    scenario.camera.height_px = 512;
    let world = SimulatedFilm::new(&scenario).unwrap();
    let draw = |index| {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        bytes
    };
    (0..FRAMES).map(draw).collect()
}

#[test]
fn a_drop_received_over_the_network_is_recorded_exactly_and_analysed_to_the_same_bytes() {
    let film = Arc::new(film());
    let shown = Arc::clone(&film);
    let draw = move |index: u64, pixels: &mut [u8]| pixels.copy_from_slice(&shown[(index % FRAMES) as usize]);
    let Some(camera) = FakeGige::plug_in(Wiring::Software, FRAMES, draw) else { return };
    let rig = Rig::new();
    let source = format!(
        "source = \"genicam\"\nid = \"{ADDRESS}\"\nwidth_px = 512\nheight_px = 512\npixel_format = \"Mono8\"\n\
         frame_rate_hz = 50\nexposure_us = 20"
    );
    let config = rig.config(&source, "[scale]\nmm_per_px = 0.5142\n[workers]\ncount = 2");
    let name = rig.name.as_str();
    let listener = Background::start(ricochet(["listen", "velocity", "--rig", name, "--json", "--wait", "60"]));
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    let status = wait_until("all frames arrived", || {
        let status = status(name)?;
        let acquire = process(&status, "acquire", 0)?.clone();
        let arrived = acquire["taken"].as_u64()? + acquire["lost"].as_u64()? + acquire["dropped"].as_u64()?;
        (camera.sent() == FRAMES && arrived == FRAMES).then_some(acquire)
    });
    service.signal(15);
    let (code, _, complaints) = service.end();
    let (_, live, _) = listener.end();

    let recording = &rig.recordings()[0];
    let recorded = frames(recording);
    let lost = status["lost"].as_u64().unwrap() + status["dropped"].as_u64().unwrap();
    println!("{} of {FRAMES} frames arrived, {lost} counted as lost", recorded.len());
    assert_eq!(recorded.len() as u64 + lost, FRAMES, "every loss is counted");
    assert_eq!(code, Some(if lost == 0 { 0 } else { 6 }), "{complaints}");
    assert!(recorded.is_sorted_by(|(before, _), (after, _)| before.sequence < after.sequence), "in order");
    for (meta, bytes) in &recorded {
        assert!(*bytes == film[meta.sequence as usize], "frame {} is not what was sent", meta.sequence);
    }

    let results = rig.path("results.mcap");
    succeed_or_lossy(&["analyze".as_ref(), recording.as_os_str(), "-o".as_ref(), results.as_os_str()], lost);
    let velocity = csv(recording, "velocity");
    assert_eq!(csv(&results, "velocity"), velocity, "analysis differs from what was measured live");
    assert_eq!(csv(&results, "field"), csv(recording, "field"));
    let first = recorded[0].0.sequence;
    let column = |row: &str, index: usize| row.split(',').nth(index).unwrap().to_owned();
    let header: Vec<&str> = velocity.lines().next().unwrap().split(',').collect();
    let rows: Vec<&str> = velocity.lines().skip(1).collect();
    let live: Vec<serde_json::Value> = live.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(live.len(), rows.len());
    for (line, row) in live.iter().zip(&rows) {
        assert_eq!(line["frame"].as_u64().unwrap() - first, column(row, 0).parse::<u64>().unwrap());
        for name in ["dx_px", "dy_px", "dtheta_deg", "vn_m_s", "vt_m_s", "omega_rad_s"] {
            let cell = column(row, header.iter().position(|known| known == &name).unwrap());
            let number = line[name].as_f64().map(f64::to_bits);
            assert_eq!(number, cell.parse::<f64>().ok().map(f64::to_bits), "{name} of frame {}", line["frame"]);
        }
    }
    let valid = live.iter().filter(|line| line["vn_m_s"].is_number()).count();
    assert!(valid as u64 + lost >= FRAMES - 2, "{valid} velocities");
}

/// Runs a command that must succeed, with the exit code for lost data if the network lost frames.
fn succeed_or_lossy(arguments: &[&std::ffi::OsStr], lost: u64) {
    if lost == 0 {
        succeed(arguments);
    } else {
        assert_eq!(crate::support::run(arguments).status.code(), Some(6));
    }
}

#[test]
fn the_present_exposure_of_the_camera_is_used_and_recorded() {
    let world = {
        let mut scenario = Scenario::built_in("lacrosse").unwrap();
        (scenario.camera.width_px, scenario.camera.height_px) = (256, 192);
        SimulatedFilm::new(&scenario).unwrap()
    };
    let draw = move |index: u64, pixels: &mut [u8]| world.render(index % FRAMES, pixels);
    let Some(camera) = FakeGige::plug_in(Wiring::Software, FRAMES, draw) else { return };
    camera.write(0x120, 4000);
    let rig = Rig::new();
    let source = |more: &str| {
        format!("source = \"genicam\"\nid = \"{ADDRESS}\"\nwidth_px = 256\nheight_px = 192\nframe_rate_hz = 50{more}")
    };
    let config = rig.config(&source(""), "[scale]\nmm_per_px = 0.5142\n[workers]\ncount = 1");
    let service = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
    wait_until("all frames were sent", || (camera.sent() == FRAMES).then_some(()));
    service.signal(15);
    service.end();
    let recording = &rig.recordings()[0];
    assert_eq!(ricochet::recording::Recording::open(recording).unwrap().exposure_us(), 4000.0);
    let impacts = |config: Option<&std::path::Path>, name: &str| {
        let results = rig.path(name);
        let mut arguments = vec!["analyze".as_ref(), recording.as_os_str(), "-o".as_ref(), results.as_os_str()];
        arguments.extend(config.into_iter().flat_map(|config| ["--config".as_ref(), config.as_os_str()]));
        crate::support::run(arguments);
        csv(&results, "impact")
    };
    let live = csv(recording, "impact");
    assert_eq!(impacts(None, "again.mcap"), live, "analysis uses the exposure of the recording");
    let start_s = |table: &str| table.lines().nth(1).and_then(|row| row.split(',').nth(1)?.parse::<f64>().ok());
    let short = rig.file(
        "short.toml",
        &std::fs::read_to_string(&config).unwrap().replace("[record]", "exposure_us = 0.001\n[record]"),
    );
    let (with, without) = (start_s(&live), start_s(&impacts(Some(&short), "short.mcap")));
    let (Some(with), Some(without)) = (with, without) else { panic!("an impact: {live}") };
    assert!((with - without - 2.0e-3).abs() < 1.0e-5, "half of 4 ms later: {with} s, {without} s");
}
