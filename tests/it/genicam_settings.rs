//! Settings of a GenICam camera: values in its registers, refusals, and the origin of the bindings.

use crate::fake_gige::{FakeGige, Wiring};
use crate::genicam::{draw, settings};
use ricochet::camera::Camera;
use ricochet::camera::FeatureKind;
use ricochet::camera::genicam::{FeatureValue, GenicamCamera, features};
use ricochet::config;
use ricochet::image::PixelFormat;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

fn text(word: &str) -> FeatureValue {
    FeatureValue::Text(word.into())
}

fn with(name: &str, value: FeatureValue) -> config::Camera {
    config::Camera { features: BTreeMap::from([(name.into(), value)]), ..settings(100.0) }
}

#[test]
fn every_setting_is_written_to_its_register() {
    let Some(gige) = FakeGige::plug_in(Wiring::Line1, 0, draw) else { return };
    let wanted = config::Camera {
        width_px: Some(256),
        height_px: Some(128),
        offset_x_px: Some(32),
        offset_y_px: Some(17),
        pixel_format: Some(PixelFormat::Mono12),
        frame_rate_hz: Some(2000.0),
        exposure_us: Some(55.0),
        trigger_source: Some("Line1".into()),
        packet_size_bytes: Some(3000),
        features: BTreeMap::from([
            ("DeviceUserID".into(), text("left")),
            ("ExposureMode".into(), text("TriggerWidth")),
            // Refused at first, until GainAuto, later in the alphabet, unlocks it.
            ("Gain".into(), FeatureValue::Integer(6)),
            ("GainAuto".into(), text("Off")),
            ("LineInverter[LineSelector=Line1]".into(), FeatureValue::Bool(true)),
            ("LineMode[LineSelector=Line2]".into(), text("Output")),
            ("PtpEnable".into(), FeatureValue::Bool(true)),
            ("TriggerActivation".into(), text("FallingEdge")),
            ("TriggerDelay".into(), FeatureValue::Float(25.5)),
        ]),
        ..settings(100.0)
    };
    let camera = GenicamCamera::open(&wanted).unwrap();
    let format = camera.format();
    assert_eq!((format.width_px, format.height_px, format.format), (256, 128, PixelFormat::Mono12));
    assert_eq!((format.slot_bytes(), format.frame_rate_hz), (256 * 128 * 2, 2000.0));
    // 50 ms of frames above the minimum number.
    assert_eq!(camera.slots(), 16 + 100);
    for (what, address, value) in [
        ("width", 0x100, 256),
        ("height", 0x104, 128),
        ("offset x", 0x130, 32),
        ("offset y", 0x134, 17),
        ("pixel format", 0x128, PixelFormat::Mono12 as u32),
        ("period, us", 0x138, 500),
        ("exposure, us", 0x120, 55),
        ("trigger mode of frame start", 0x300, 1),
        ("trigger mode of acquisition start", 0x320, 0),
        ("trigger source", 0x304, 1),
        ("trigger activation", 0x308, 1),
        ("packet size", 0xd04, 3000),
        ("exposure mode", 0x8010, 1),
        ("inverter of line 1", 0x802c, 1),
        ("inverter of line 2", 0x8034, 0),
        ("mode of line 1", 0x8028, 0),
        ("mode of line 2", 0x8030, 1),
        ("PTP", 0x8060, 1),
        ("gain mode", 0x8070, 1),
        ("user id", 0x8100, u32::from_be_bytes(*b"left")),
    ] {
        assert_eq!(gige.register(address), value, "{what}");
    }
    let double =
        |address| f64::from_bits(u64::from(gige.register(address)) << 32 | u64::from(gige.register(address + 4)));
    assert_eq!((double(0x8008), double(0x8078)), (25.5, 6.0));
    assert_eq!(camera.device().text("PtpStatus").unwrap(), "Initializing");
}

#[test]
fn without_a_trigger_source_an_armed_trigger_is_switched_off() {
    let Some(gige) = FakeGige::plug_in(Wiring::Software, 0, draw) else { return };
    gige.write(0x300, 1);
    let camera = GenicamCamera::open(&config::Camera { frame_rate_hz: None, ..settings(100.0) }).unwrap();
    assert_eq!(gige.register(0x300), 0);
    drop(camera);
    GenicamCamera::open(&with("TriggerMode", text("On"))).unwrap();
    assert_eq!((gige.register(0x300), gige.register(0x320)), (1, 0));
}

#[test]
fn a_selector_among_the_features_is_set_before_the_feature_it_selects() {
    let Some(gige) = FakeGige::plug_in(Wiring::Software, 0, draw) else { return };
    let features = [
        ("LineMode", text("Output")),
        ("LineSelector", text("Line2")),
        ("LineMode[LineSelector=Line1]", text("Input")),
        ("TriggerMode", text("On")),
        ("TriggerSelector", text("AcquisitionStart")),
    ];
    let features = features.map(|(name, value)| (name.to_owned(), value)).into();
    GenicamCamera::open(&config::Camera { features, ..settings(100.0) }).unwrap();
    assert_eq!((gige.register(0x8020), gige.register(0x8028), gige.register(0x8030)), (0, 0, 1));
    assert_eq!((gige.register(0x300), gige.register(0x320)), (0, 1));
}

#[test]
fn an_active_tone_curve_is_noticed() {
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, 0, draw) else { return };
    let seen = |gamma: f64, is_on: bool| {
        let features = [("Gamma", FeatureValue::Float(gamma)), ("GammaEnable", FeatureValue::Bool(is_on))];
        let features = features.map(|(name, value)| (name.to_owned(), value)).into();
        GenicamCamera::open(&config::Camera { features, ..settings(100.0) }).unwrap().device().gamma()
    };
    assert_eq!(seen(0.45, true), Some(0.45));
    assert_eq!((seen(0.45, false), seen(1.0, true)), (None, None));
}

#[test]
fn settings_that_a_camera_lacks_are_refused_with_the_allowed_values() {
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, 0, draw) else { return };
    let base = || settings(100.0);
    for (wanted, line) in [
        (
            config::Camera { width_px: Some(100), ..base() },
            "cannot set camera feature Width to 100: allowed 16 to 2048 in steps of 16",
        ),
        (
            config::Camera { width_px: Some(1024), offset_x_px: Some(1040), ..base() },
            "cannot set camera feature OffsetX to 1040: allowed 0 to 1024 in steps of 16",
        ),
        (
            config::Camera { exposure_us: Some(0.5), ..base() },
            "cannot set camera feature exposure_us to 0.5: allowed 1 to 10000000",
        ),
        (
            config::Camera { frame_rate_hz: Some(20_001.0), ..base() },
            "cannot set camera feature frame_rate_hz to 20001: allowed 0.1 to 20000",
        ),
        (
            config::Camera { trigger_source: Some("Line7".into()), ..base() },
            "cannot set camera feature trigger_source to Line7: allowed Line0, Line1, Software",
        ),
        (
            config::Camera { pixel_format: None, ..with("PixelFormat", text("RGB8")) },
            "cannot set camera feature PixelFormat to RGB8: choose one of Mono8, Mono10, Mono12, Mono16",
        ),
        (with("Frobnicate", text("x")), "cannot set camera feature Frobnicate to x: the camera has no such feature"),
        (
            with("PtpEnable", FeatureValue::Integer(1)),
            "cannot set camera feature PtpEnable to 1: it is of type boolean",
        ),
        (
            with("TriggerDelay", FeatureValue::Float(-1.0)),
            "cannot set camera feature TriggerDelay to -1: allowed 0 to 1000000",
        ),
        (
            with("ExposureMode", text("Sometimes")),
            "cannot set camera feature ExposureMode to Sometimes: allowed Timed, TriggerWidth",
        ),
        (
            with("ExposureMode", FeatureValue::Integer(0)),
            "cannot set camera feature ExposureMode to 0: it is of type enumeration, allowed Timed, TriggerWidth",
        ),
        (
            with("SensorWidth", FeatureValue::Integer(5)),
            "cannot set camera feature SensorWidth to 5: it can only be read",
        ),
        (
            with("Gain", FeatureValue::Float(3.0)),
            "cannot set camera feature Gain to 3: another setting of the camera locks it",
        ),
        (
            with("LineMode[Line2]", text("Output")),
            "cannot set camera feature LineMode[Line2] to Output: write it Name or Name[Selector=Word]",
        ),
        (
            with("LineMode[LineSelector=Line9]", text("Output")),
            "cannot set camera feature LineMode[LineSelector=Line9] to Output: allowed Line0, Line1, Line2",
        ),
        (with("Width", FeatureValue::Integer(1024)), "cannot set camera feature Width to 1024: the camera keeps 512"),
    ] {
        assert_eq!(GenicamCamera::open(&wanted).unwrap_err().to_string(), line);
    }
}

#[test]
fn the_feature_tree_lists_values_ranges_and_units() {
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, 0, draw) else { return };
    let lines = features(crate::fake_gige::ADDRESS).unwrap();
    let find = |name: &str| lines.iter().find(|line| line.name == name).unwrap();
    assert_eq!((find("AcquisitionControl").depth, find("AcquisitionControl").kind), (0, FeatureKind::Category));
    let exposure = find("ExposureTime");
    assert_eq!((exposure.depth, exposure.value.as_deref(), exposure.unit.as_str()), (1, Some("10000"), "us"));
    assert_eq!((exposure.allowed.as_str(), exposure.writable), ("1 to 10000000", true));
    assert_eq!(find("TriggerSource").allowed, "Line0, Line1, Software");
    assert_eq!((find("SensorWidth").value.as_deref(), find("SensorWidth").writable), (Some("2048"), false));
    assert_eq!(find("TriggerSoftware").value, None);
}

#[test]
fn the_bindings_equal_the_output_of_bindgen() {
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/camera/genicam");
    let committed = std::fs::read_to_string(room.join("sys.rs")).unwrap();
    let bindgen = std::env::var("BINDGEN").unwrap_or_else(|_| "bindgen".into());
    let version = |program: &str, argument: &[&str]| {
        let output = Command::new(program).args(argument).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let here = version(&bindgen, &["--version"]).zip(version("pkg-config", &["--modversion", "aravis-0.8"]));
    let origin =
        here.map(|(bindgen, aravis)| format!("// Do not edit. Generated by generate.sh, {bindgen}, Aravis {aravis}."));
    if origin.as_deref() != committed.lines().next() {
        println!("left out: the bindings were made by other versions than the installed ones, {origin:?}");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let fresh = folder.path().join("sys.rs");
    assert!(Command::new(room.join("generate.sh")).arg(&fresh).status().unwrap().success());
    assert!(std::fs::read_to_string(fresh).unwrap() == committed, "sys.rs differs: run generate.sh");
}
