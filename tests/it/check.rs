//! The rig check on simulated rigs whose faults are known.

use crate::support::{Background, Rig, ricochet, run, succeed, wait_until};
use ricochet::camera::simulated::{meta, stream_format};
use ricochet::config::Config;
use ricochet::image::Frame;
use ricochet::measure::{Measurer, Share};
use ricochet::process::analysis_params;
use ricochet::synth::{CameraSetup, MotionSetup, Scenario, SimulatedFilm};
use serde_json::Value;
use std::path::PathBuf;

/// A speckled ball at rest, 200 frames at 1000 Hz.
fn still() -> Scenario {
    let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
    scenario.camera.frames = 200;
    scenario.camera.frame_rate_hz = 1000.0;
    scenario.camera.noise_dn = 2.0;
    scenario
}

const BODY: &str = "[scale]\nmm_per_px = 0.5\n[[body]]\ndiameter_mm = 60\n[workers]\ncount = 1";

fn rig_file(rig: &Rig, scenario: &Scenario) -> PathBuf {
    let film = rig.file("film.toml", &toml::to_string(scenario).unwrap());
    rig.config(&format!("source = \"simulated\"\nscenario = \"{}\"\npaced = false", film.display()), BODY)
}

/// Exit code and findings of a check.
fn check(scenario: &Scenario) -> (Option<i32>, Value) {
    let rig = Rig::new();
    let config = rig_file(&rig, scenario);
    let output = run(["check".as_ref(), config.as_os_str(), "--json".as_ref()]);
    let printed = String::from_utf8(output.stdout).unwrap();
    let complaints = String::from_utf8_lossy(&output.stderr);
    (
        output.status.code(),
        serde_json::from_str(&printed).unwrap_or_else(|error| panic!("{error}: {printed}{complaints}")),
    )
}

fn finding<'a>(report: &'a Value, name: &str) -> &'a Value {
    report["findings"].as_array().unwrap().iter().find(|finding| finding["name"] == name).unwrap()
}

fn value(report: &Value, name: &str) -> f64 {
    finding(report, name)["value"].as_f64().unwrap_or_else(|| panic!("{name}: {report:#}"))
}

fn verdict<'a>(report: &'a Value, name: &str) -> &'a str {
    finding(report, name)["verdict"].as_str().unwrap()
}

/// The scatter of a subset's displacement between images whose noise is independent of the check's, px.
fn true_floor(scenario: &Scenario) -> f64 {
    let first = SimulatedFilm::new(scenario).unwrap();
    let config = Config::parse(&format!("[camera]\nsource = \"simulated\"\n{BODY}\n"), "rig.toml").unwrap();
    let format = stream_format(&first);
    let (params, _) = analysis_params(&config, &format);
    let (mut sum, mut count) = (0.0, 0.0);
    for take in 1..=12 {
        let world = first.retake(scenario.motion.clone(), take).unwrap();
        let mut measurer =
            Measurer::new(&params, Share::ALL, format.width_px as usize, format.height_px as usize).unwrap();
        let (mut measured, mut bytes) = (Vec::new(), vec![0; world.frame_bytes()]);
        for index in 0..2 {
            world.render(index, &mut bytes);
            measurer.push(&Frame { meta: meta(&world, index), bytes: &bytes }, &mut measured).unwrap();
        }
        measurer.finish(&mut measured);
        // The true motion is zero, so no mean is subtracted.
        for moved in
            measured.iter().filter_map(|m| m.field.as_ref()).flat_map(|f| &f.points).filter_map(|p| p.displacement)
        {
            sum += f64::from(moved.u_px).powi(2) + f64::from(moved.v_px).powi(2);
            count += 2.0;
        }
    }
    assert!(count > 500.0, "{count}");
    (sum / count).sqrt()
}

#[test]
fn the_noise_floor_is_that_of_the_camera_within_a_fifth() {
    for noise_dn in [1.0, 2.0, 5.0] {
        let mut scenario = still();
        scenario.camera.noise_dn = noise_dn;
        // The noise reported is that at half of full scale. Without shot noise it is the same at all levels.
        let (code, report) = check(&scenario);
        let truth = true_floor(&scenario);
        let (floor, noise) = (value(&report, "noise-floor"), value(&report, "noise"));
        println!(
            "noise {noise_dn} DN: found {noise:.3} DN; floor {floor:.5} px, true {truth:.5} px; {:#}",
            finding(&report, "noise-floor")
        );
        assert_eq!((code, report["ready"].as_bool()), (Some(0), Some(true)), "{report:#}");
        assert!((floor / truth - 1.0).abs() <= 0.2, "{floor} px, true {truth} px");
        // Rounding to whole grey levels adds 1/12 to the variance.
        let expected = noise_dn.hypot((1.0_f64 / 12.0).sqrt());
        assert!((noise / expected - 1.0).abs() <= 0.05, "{noise} DN of {expected}");
    }
}

#[test]
fn a_sound_rig_is_good_throughout() {
    let (code, report) = check(&still());
    assert_eq!(code, Some(0), "{report:#}");
    for name in [
        "lost-frames",
        "frame-rate",
        "saturated",
        "black",
        "contrast",
        "noise",
        "fixed-pattern",
        "flicker",
        "blur",
        "speckle-size",
        "speckle-coverage",
        "body-found",
        "subsets-matched",
        "noise-floor",
        "noise-floor-body",
        "noise-floor-rotation",
    ] {
        assert_eq!(verdict(&report, name), "good", "{:#}", finding(&report, name));
    }
    assert_eq!(report["frames"], 200);
    println!("{report:#}");
}

/// The check is stopped while it records, as on a busy machine.
#[test]
fn lost_frames_are_counted_and_the_frame_rate_stays_nominal() {
    let rig = Rig::new();
    let mut scenario = still();
    (scenario.camera.frames, scenario.camera.frame_rate_hz) = (2000, 500.0);
    (scenario.camera.width_px, scenario.camera.height_px, scenario.body.diameter_mm) = (160, 144, 36.0);
    let MotionSetup::Constant { start_px, .. } = &mut scenario.motion else { panic!("a ball at rest") };
    *start_px = [80.0, 72.0];
    let film = rig.file("film.toml", &toml::to_string(&scenario).unwrap());
    let config = rig.config(
        &format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display()),
        &BODY.replace("60", "36"),
    );
    let arguments = ["check".as_ref(), config.as_os_str(), "--json".as_ref(), "--seconds".as_ref(), "2.5".as_ref()];
    let check = Background::start(ricochet(arguments));
    let name = format!("check-{}", check.0.id());
    wait_until("the check records", || ricochet::bus::Bus::is_running(&name).then_some(()));
    std::thread::sleep(std::time::Duration::from_millis(200));
    check.signal(19);
    // The camera has 64 slots, which last for an eighth of a second.
    std::thread::sleep(std::time::Duration::from_millis(800));
    check.signal(18);
    let (code, printed, complaints) = check.end();
    let report: Value = serde_json::from_str(&printed).unwrap_or_else(|error| panic!("{error}: {printed}{complaints}"));
    let lost = value(&report, "lost-frames");
    println!("{lost} of {} lost; {complaints}", report["frames"]);
    assert_eq!((code, verdict(&report, "lost-frames")), (Some(6), "bad"), "{report:#}");
    // Lost frames alone do not keep the rig from working.
    let is_bad = |finding: &&Value| finding["verdict"] == "bad" && finding["name"] != "lost-frames";
    let others = report["findings"].as_array().unwrap().iter().filter(is_bad).count();
    assert_eq!(report["ready"], others == 0, "{report:#}");
    assert!(complaints.contains(&format!("data were lost: {lost}")), "{complaints}");
    assert!((200.0..=400.0).contains(&lost), "{lost} frames of 0.8 s less the slots");
    // Received and lost frames add up to the nominal rate, so that none is counted twice or not at all.
    let rate_hz = value(&report, "frame-rate");
    assert!((rate_hz - 500.0).abs() < 1e-3, "{rate_hz} Hz");
}

#[test]
fn a_saturated_rig_is_not_ready() {
    let mut scenario = still();
    scenario.shade.ball = 1.0;
    let (code, report) = check(&scenario);
    assert_eq!(
        (code, report["ready"].as_bool(), verdict(&report, "saturated")),
        (Some(3), Some(false), "bad"),
        "{report:#}"
    );
    assert!(value(&report, "saturated") > 0.05, "the background between the speckles is saturated");
}

#[test]
fn blur_is_measured() {
    for blur_px in [0.7, 1.2, 2.0, 3.5] {
        let mut scenario = still();
        scenario.camera.blur_px = blur_px;
        // Speckles that are large against the blur.
        (scenario.body.pattern.area_min_px2, scenario.body.pattern.area_max_px2) = (80.0, 200.0);
        scenario.body.pattern.coverage = 0.3;
        let (_, report) = check(&scenario);
        let found = value(&report, "blur");
        println!("blur {blur_px} px: found {found:.2} px");
        assert!((found / blur_px - 1.0).abs() <= 0.3, "{found} px of {blur_px} px");
        assert_eq!(verdict(&report, "blur") == "good", blur_px < 1.5, "{report:#}");
    }
}

#[test]
fn flicker_is_reported_with_its_amplitude_and_frequency() {
    let mut scenario = still();
    (scenario.light.flicker, scenario.light.flicker_hz) = (0.1, 100.0);
    let (_, report) = check(&scenario);
    assert!((value(&report, "flicker") - 0.1).abs() < 0.01, "{report:#}");
    assert_eq!(verdict(&report, "flicker"), "fair");
    let words = finding(&report, "flicker")["text"].as_str().unwrap();
    let hz: f64 = words.split(" at ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((hz - 100.0).abs() <= 2.0, "{words}");
    let noise = value(&report, "noise");
    assert!((noise / 2.02 - 1.0).abs() < 0.1, "flicker must not count as noise: {noise} DN");
}

/// The relative amount by which subset displacements of 0.37 px are measured too short.
fn relative_shortfall(camera: &CameraSetup) -> f64 {
    let scenario = Scenario { camera: CameraSetup { frames: 40, ..camera.clone() }, ..still() };
    let slow =
        MotionSetup::Constant { start_px: [250.0, 250.0], vx_px_frame: 0.37, vy_px_frame: 0.0, omega_deg_frame: 0.0 };
    let world = SimulatedFilm::new(&Scenario { motion: slow, ..scenario }).unwrap();
    let rig = format!("[camera]\nsource = \"simulated\"\n{BODY}\n[rotation]\nmethod = \"field\"\n");
    let (params, _) = analysis_params(&Config::parse(&rig, "rig.toml").unwrap(), &stream_format(&world));
    let size = (world.width_px() as usize, world.height_px() as usize);
    let mut measurer = Measurer::new(&params, Share::ALL, size.0, size.1).unwrap();
    let (mut measured, mut bytes) = (Vec::new(), vec![0; world.frame_bytes()]);
    for index in 0..world.frames() {
        world.render(index, &mut bytes);
        measurer.push(&Frame { meta: meta(&world, index), bytes: &bytes }, &mut measured).unwrap();
    }
    let steps: Vec<f64> = measured.iter().filter_map(|row| Some(row.step.motion?.dx_px)).collect();
    1.0 - steps.iter().sum::<f64>() / steps.len() as f64 / 0.37
}

#[test]
fn a_fixed_pattern_is_reported_with_its_effect_on_slow_motion() {
    for (offset_spread_dn, gain_spread) in [(1.0, 0.0), (2.0, 0.0), (0.0, 0.01), (0.0, 0.02)] {
        let camera = CameraSetup { offset_spread_dn, gain_spread, ..still().camera };
        let (_, report) = check(&Scenario { camera: camera.clone(), ..still() });
        let (spread, words) =
            (value(&report, "fixed-pattern"), finding(&report, "fixed-pattern")["text"].as_str().unwrap());
        let short = relative_shortfall(&camera);
        println!("offsets {offset_spread_dn}, gains {gain_spread}: {spread} DN, short by {short}: {words}");
        assert!(
            gain_spread > 0.0 || (spread / offset_spread_dn - 1.0).abs() < 0.25,
            "{spread} of {offset_spread_dn} DN"
        );
        let predicted: f64 = words.split("up to ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        // For gains, the report names the value at the brightest pixels.
        assert!((0.8..2.3).contains(&(0.01 * predicted / short)), "{predicted} %, measured {short}");
    }
}

#[test]
fn speckle_size_and_density_are_reported() {
    for (name, size_px, coverage) in [("b-II", 3.57, 0.19), ("c-II", 5.05, 0.18), ("d-I", 17.84, 0.22)] {
        let mut scenario = still();
        scenario.body.pattern = ricochet::synth::PatternSetup::paper(name).unwrap();
        let (_, report) = check(&scenario);
        let (size, dense) = (value(&report, "speckle-size"), value(&report, "speckle-coverage"));
        println!("{name}: size {size:.2} of {size_px} px, coverage {dense:.3} of {coverage}");
        assert!((size / size_px - 1.0).abs() <= 0.3, "{name}: {size} px of {size_px} px");
        assert!((dense - coverage).abs() <= 0.05, "{name}: {dense} of {coverage}");
    }
}

#[test]
fn a_moving_body_has_no_noise_floor_and_a_rig_without_its_body_is_not_ready() {
    let mut scenario = Scenario::translation(0.4, 0.0, 0.0);
    scenario.camera.frames = 40;
    let (_, report) = check(&scenario);
    assert_eq!((finding(&report, "noise-floor")["value"].as_f64(), verdict(&report, "noise-floor")), (None, "unknown"));
    let words = finding(&report, "noise-floor")["text"].as_str().unwrap();
    assert!(words.contains("moves by 0.40"), "{words}");

    let mut scenario = still();
    (scenario.shade.ball, scenario.shade.speckle) = (0.12, 0.12);
    let (code, report) = check(&scenario);
    assert_eq!((code, verdict(&report, "body-found")), (Some(3), "bad"), "{report:#}");
}

#[test]
fn a_recording_can_be_checked_and_its_page_is_complete() {
    let rig = Rig::new();
    let recording = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/lacrosse.mcap");
    let config = rig.config(&format!("source = \"recording\"\nid = \"{}\"\npaced = false", recording.display()), BODY);
    let page = rig.path("check.html");
    let arguments = ["check".as_ref(), config.as_os_str(), "-o".as_ref(), page.as_os_str()];
    let output = run(arguments);
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(printed.contains("noise-floor") && printed.contains("moves by"), "{printed}");
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.matches("data:image/png;base64,").count() == 2 && html.ends_with("</html>\n"));
    assert!(!html.contains("http://") && !html.contains("https://"), "the page loads nothing from the network");
    let again = run(arguments);
    assert_eq!(again.status.code(), Some(2), "no file is overwritten");
    assert!(String::from_utf8(again.stderr).unwrap().contains("the file already exists"));
    assert!(succeed(["check", "--help"]).contains("Example: ricochet check"));
}
