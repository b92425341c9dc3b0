//! The rig check on simulated rigs whose faults are known.

use crate::support::{Background, Rig, ricochet, run, succeed, wait_until};
use ricochet::camera::simulated::{meta, stream_format};
use ricochet::config::Config;
use ricochet::image::Frame;
use ricochet::measure::{Measurer, Share};
use ricochet::process::analysis_params;
use ricochet::synth::{CameraSetup, MotionSetup, Scenario, World};
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
    let told = String::from_utf8_lossy(&output.stderr);
    (output.status.code(), serde_json::from_str(&printed).unwrap_or_else(|error| panic!("{error}: {printed}{told}")))
}

fn finding<'a>(told: &'a Value, name: &str) -> &'a Value {
    told["findings"].as_array().unwrap().iter().find(|finding| finding["name"] == name).unwrap()
}

fn value(told: &Value, name: &str) -> f64 {
    finding(told, name)["value"].as_f64().unwrap_or_else(|| panic!("{name}: {told:#}"))
}

fn verdict<'a>(told: &'a Value, name: &str) -> &'a str {
    finding(told, name)["verdict"].as_str().unwrap()
}

/// Scatter of a subset's displacement between pictures whose noise has nothing in common with the check's, px.
fn true_floor(scenario: &Scenario) -> f64 {
    let first = World::new(scenario).unwrap();
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
        // The truth is no motion at all, so no mean is taken off.
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
        // The noise told is that of half of full scale; without shot noise it is the same everywhere.
        let (code, told) = check(&scenario);
        let truth = true_floor(&scenario);
        let (floor, noise) = (value(&told, "noise-floor"), value(&told, "noise"));
        println!(
            "noise {noise_dn} DN: found {noise:.3} DN; floor {floor:.5} px, true {truth:.5} px; {:#}",
            finding(&told, "noise-floor")
        );
        assert_eq!((code, told["ready"].as_bool()), (Some(0), Some(true)), "{told:#}");
        assert!((floor / truth - 1.0).abs() <= 0.2, "{floor} px, true {truth} px");
        // Rounding to whole levels adds a twelfth to the variance.
        let expected = noise_dn.hypot((1.0_f64 / 12.0).sqrt());
        assert!((noise / expected - 1.0).abs() <= 0.05, "{noise} DN of {expected}");
    }
}

#[test]
fn a_sound_rig_is_good_throughout() {
    let (code, told) = check(&still());
    assert_eq!(code, Some(0), "{told:#}");
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
        assert_eq!(verdict(&told, name), "good", "{:#}", finding(&told, name));
    }
    assert_eq!(told["frames"], 200);
    println!("{told:#}");
}

/// A check that is held up while it films, as by a machine that has other things to do.
#[test]
fn frames_that_a_busy_machine_loses_are_counted_at_the_rate_that_was_wanted() {
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
    let role = format!("@ricochet/check-{}/check", check.0.id());
    wait_until("it films", || std::fs::read_to_string("/proc/net/unix").unwrap().contains(&role).then_some(()));
    std::thread::sleep(std::time::Duration::from_millis(200));
    check.signal(19);
    // The camera has 64 slots, of an eighth of a second.
    std::thread::sleep(std::time::Duration::from_millis(800));
    check.signal(18);
    let (code, printed, complaints) = check.end();
    let told: Value = serde_json::from_str(&printed).unwrap_or_else(|error| panic!("{error}: {printed}{complaints}"));
    let lost = value(&told, "lost-frames");
    println!("{lost} of {} lost; {complaints}", told["frames"]);
    assert_eq!((code, verdict(&told, "lost-frames")), (Some(6), "bad"), "{told:#}");
    assert!(complaints.contains(&format!("data were lost: {lost}")), "{complaints}");
    assert!((200.0..=400.0).contains(&lost), "{lost} frames of 0.8 s less the slots");
    // Those that came and those that were lost make the rate that was wanted: none was counted twice or not at all.
    let rate_hz = value(&told, "frame-rate");
    assert!((rate_hz - 500.0).abs() < 1e-3, "{rate_hz} Hz");
}

#[test]
fn a_saturated_rig_is_not_ready() {
    let mut scenario = still();
    scenario.shade.ball = 1.0;
    let (code, told) = check(&scenario);
    assert_eq!((code, told["ready"].as_bool(), verdict(&told, "saturated")), (Some(3), Some(false), "bad"), "{told:#}");
    assert!(value(&told, "saturated") > 0.05, "what lies between the speckles is at the end of the scale");
}

#[test]
fn a_blurred_rig_is_told_by_how_much() {
    for blur_px in [0.7, 1.2, 2.0, 3.5] {
        let mut scenario = still();
        scenario.camera.blur_px = blur_px;
        // Speckles so large that blur does not drown them.
        (scenario.body.pattern.area_min_px2, scenario.body.pattern.area_max_px2) = (80.0, 200.0);
        scenario.body.pattern.coverage = 0.3;
        let (_, told) = check(&scenario);
        let found = value(&told, "blur");
        println!("blur {blur_px} px: found {found:.2} px");
        assert!((found / blur_px - 1.0).abs() <= 0.3, "{found} px of {blur_px} px");
        assert_eq!(verdict(&told, "blur") == "good", blur_px < 1.5, "{told:#}");
    }
}

#[test]
fn a_flickering_lamp_is_told_with_its_swing_and_frequency() {
    let mut scenario = still();
    (scenario.light.flicker, scenario.light.flicker_hz) = (0.1, 100.0);
    let (_, told) = check(&scenario);
    assert!((value(&told, "flicker") - 0.1).abs() < 0.01, "{told:#}");
    assert_eq!(verdict(&told, "flicker"), "fair");
    let words = finding(&told, "flicker")["text"].as_str().unwrap();
    let hz: f64 = words.split(" at ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((hz - 100.0).abs() <= 2.0, "{words}");
    let noise = value(&told, "noise");
    assert!((noise / 2.02 - 1.0).abs() < 0.1, "flicker is not taken for noise: {noise} DN");
}

/// By which share steps of 0.37 px come out too short over subsets.
fn short_by(camera: &CameraSetup) -> f64 {
    let scenario = Scenario { camera: CameraSetup { frames: 40, ..camera.clone() }, ..still() };
    let slow =
        MotionSetup::Constant { start_px: [250.0, 250.0], vx_px_frame: 0.37, vy_px_frame: 0.0, omega_deg_frame: 0.0 };
    let world = World::new(&Scenario { motion: slow, ..scenario }).unwrap();
    let rig = format!("[camera]\nsource = \"simulated\"\n{BODY}\n[rotation]\nmethod = \"field\"\n");
    let (params, _) = analysis_params(&Config::parse(&rig, "rig.toml").unwrap(), &stream_format(&world));
    let size = (world.width_px() as usize, world.height_px() as usize);
    let mut measurer = Measurer::new(&params, Share::ALL, size.0, size.1).unwrap();
    let (mut measured, mut bytes) = (Vec::new(), vec![0; world.frame_bytes()]);
    for index in 0..world.frames() {
        world.render(index, &mut bytes);
        measurer.push(&Frame { meta: meta(&world, index), bytes: &bytes }, &mut measured).unwrap();
    }
    let steps: Vec<f64> = measured.iter().filter_map(|row| Some(row.step.step?.dx_px)).collect();
    1.0 - steps.iter().sum::<f64>() / steps.len() as f64 / 0.37
}

#[test]
fn pixels_that_differ_from_one_another_are_told_with_what_they_do_to_slow_steps() {
    for (offset_spread_dn, gain_spread) in [(1.0, 0.0), (2.0, 0.0), (0.0, 0.01), (0.0, 0.02)] {
        let camera = CameraSetup { offset_spread_dn, gain_spread, ..still().camera };
        let (_, told) = check(&Scenario { camera: camera.clone(), ..still() });
        let (spread, words) =
            (value(&told, "fixed-pattern"), finding(&told, "fixed-pattern")["text"].as_str().unwrap());
        let short = short_by(&camera);
        println!("offsets {offset_spread_dn}, gains {gain_spread}: {spread} DN, short by {short}: {words}");
        assert!(
            gain_spread > 0.0 || (spread / offset_spread_dn - 1.0).abs() < 0.25,
            "{spread} of {offset_spread_dn} DN"
        );
        let foretold: f64 = words.split("up to ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        // Of gains it is told for the brightest.
        assert!((0.8..2.3).contains(&(0.01 * foretold / short)), "{foretold} %, seen {short}");
    }
}

#[test]
fn speckles_are_told_by_size_and_density() {
    for (name, size_px, coverage) in [("b-II", 3.57, 0.19), ("c-II", 5.05, 0.18), ("d-I", 17.84, 0.22)] {
        let mut scenario = still();
        scenario.body.pattern = ricochet::synth::PatternSetup::paper(name).unwrap();
        let (_, told) = check(&scenario);
        let (size, dense) = (value(&told, "speckle-size"), value(&told, "speckle-coverage"));
        println!("{name}: size {size:.2} of {size_px} px, coverage {dense:.3} of {coverage}");
        assert!((size / size_px - 1.0).abs() <= 0.3, "{name}: {size} px of {size_px} px");
        assert!((dense - coverage).abs() <= 0.05, "{name}: {dense} of {coverage}");
    }
}

#[test]
fn a_body_that_moves_has_no_noise_floor_and_one_out_of_sight_no_rig_is_ready_for() {
    let mut scenario = Scenario::translation(0.4, 0.0, 0.0);
    scenario.camera.frames = 40;
    let (_, told) = check(&scenario);
    assert_eq!((finding(&told, "noise-floor")["value"].as_f64(), verdict(&told, "noise-floor")), (None, "unknown"));
    let words = finding(&told, "noise-floor")["text"].as_str().unwrap();
    assert!(words.contains("moves by 0.40"), "{words}");

    let mut scenario = still();
    (scenario.shade.ball, scenario.shade.speckle) = (0.12, 0.12);
    let (code, told) = check(&scenario);
    assert_eq!((code, verdict(&told, "body-found")), (Some(3), "bad"), "{told:#}");
}

#[test]
fn a_recording_is_checked_too_and_the_page_is_whole() {
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
    assert!(!html.contains("http://") && !html.contains("https://"), "it asks nothing of the network");
    let again = run(arguments);
    assert_eq!(again.status.code(), Some(2), "no file is overwritten");
    assert!(String::from_utf8(again.stderr).unwrap().contains("the file exists already"));
    assert!(succeed(["check", "--help"]).contains("Example: ricochet check"));
}
