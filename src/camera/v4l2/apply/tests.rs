//! Settings and controls against a simulated driver.

use super::super::mock::{Mock, MockControl, settings};
use super::*;
use crate::camera::v4l2::auto_controls::warnings;
use crate::config::Camera;
use crate::image::PixelFormat;
use std::collections::BTreeMap;

const GAIN: u32 = 1;
const AUTO_GAIN: u32 = 2;

/// Returns a driver with six controls; the automatic ones are on and lock gain and exposure time.
fn mock() -> Mock {
    let mock = Mock::new();
    let control =
        |id, name, kind, range, value| MockControl { id, name, kind, range, words: &[], value, ruled_by: None };
    mock.state().controls = vec![
        MockControl {
            ruled_by: Some((AUTO_GAIN, 1)),
            ..control(GAIN, "Gain", sys::V4L2_CTRL_TYPE_INTEGER, (0, 60, 2), 10)
        },
        control(AUTO_GAIN, "Gain, Automatic", sys::V4L2_CTRL_TYPE_BOOLEAN, (0, 1, 1), 1),
        MockControl {
            words: &["Disabled", "50 Hz", "", "Auto"],
            ..control(3, "Power Line Frequency", sys::V4L2_CTRL_TYPE_MENU, (0, 3, 1), 0)
        },
        control(4, "Zoom", sys::V4L2_CTRL_TYPE_BUTTON, (0, 0, 0), 0),
        MockControl {
            words: &["Auto Mode", "Manual Mode"],
            ..control(sys::V4L2_CID_EXPOSURE_AUTO, "Auto Exposure", sys::V4L2_CTRL_TYPE_MENU, (0, 3, 1), 0)
        },
        MockControl {
            ruled_by: Some((sys::V4L2_CID_EXPOSURE_AUTO, 0)),
            ..control(
                sys::V4L2_CID_EXPOSURE_ABSOLUTE,
                "Exposure Time, Absolute",
                sys::V4L2_CTRL_TYPE_INTEGER,
                (1, 5000, 1),
                156,
            )
        },
    ];
    mock
}

fn with(features: &[(&str, FeatureValue)]) -> Camera {
    let features = features.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect::<BTreeMap<_, _>>();
    Camera { features, ..settings() }
}

fn value(mock: &Mock, id: u32) -> i32 {
    mock.state().controls.iter().find(|control| control.id == id).unwrap().value
}

fn refusal(settings: &Camera) -> String {
    apply(&mock().device(), settings).unwrap_err().to_string()
}

fn text(word: &str) -> FeatureValue {
    FeatureValue::Text(word.into())
}

#[test]
fn controls_are_set_by_name_and_those_that_lock_others_first() {
    let mock = mock();
    let wanted = with(&[
        // Inactive while the automatic one is on, which comes later in the alphabet.
        ("gain", FeatureValue::Integer(42)),
        ("gain_automatic", FeatureValue::Bool(false)),
        ("Power Line Frequency", text("Auto")),
        ("zoom", FeatureValue::Bool(true)),
    ]);
    apply(&mock.device(), &wanted).unwrap();
    assert_eq!([GAIN, AUTO_GAIN, 3, 4].map(|id| value(&mock, id)), [42, 0, 3, 1]);
}

#[test]
fn exposure_in_us_turns_the_automatic_one_off_and_lands_in_its_control() {
    let mock = mock();
    apply(&mock.device(), &Camera { exposure_us: Some(2500.0), ..settings() }).unwrap();
    assert_eq!(value(&mock, sys::V4L2_CID_EXPOSURE_AUTO), 1);
    assert_eq!(value(&mock, sys::V4L2_CID_EXPOSURE_ABSOLUTE), 25);
}

#[test]
fn what_a_control_cannot_be_is_refused_with_what_it_can() {
    let off = ("gain_automatic", FeatureValue::Bool(false));
    for (name, value, said) in [
        ("gain", FeatureValue::Integer(61), "cannot set camera feature gain to 61: allowed 0 to 60 in steps of 2"),
        ("gain", FeatureValue::Integer(7), "cannot set camera feature gain to 7: allowed 0 to 60 in steps of 2"),
        (
            "gain",
            text("much"),
            "cannot set camera feature gain to much: it is of type integer, allowed 0 to 60 in steps of 2",
        ),
        (
            "zoom",
            FeatureValue::Bool(false),
            "cannot set camera feature zoom to false: it is a command: true executes it",
        ),
        (
            "power_line_frequency",
            text("60 Hz"),
            "cannot set camera feature power_line_frequency to 60 Hz: allowed Disabled, 50 Hz, Auto",
        ),
    ] {
        assert_eq!(refusal(&with(&[(name, value), off.clone()])), said);
    }
    let unknown = refusal(&with(&[("gian", FeatureValue::Integer(1))]));
    assert!(unknown.ends_with("no such control; it has gain, gain_automatic, power_line_frequency, zoom, auto_exposure, exposure_time_absolute"), "{unknown}");
    let ruled = refusal(&with(&[("gain", FeatureValue::Integer(2))]));
    assert!(ruled.ends_with("another control, usually an automatic one, overrides it"), "{ruled}");
}

#[test]
fn an_exposure_between_two_steps_or_beyond_the_range_is_refused() {
    let exposure = |us| refusal(&Camera { exposure_us: Some(us), ..settings() });
    assert_eq!(exposure(150.0), "cannot set camera feature exposure_us to 150: allowed in steps of 100 us");
    assert_eq!(
        exposure(600_000.0),
        "cannot set camera feature exposure_us to 600000: allowed 1 to 5000, in units of 100 us"
    );
}

#[test]
fn formats_sizes_and_rates_a_camera_does_not_keep_are_refused() {
    let format = Camera { pixel_format: Some(PixelFormat::Mono12), ..settings() };
    assert_eq!(
        refusal(&format),
        "cannot set camera feature pixel_format to Mono12: the camera offers GREY; ricochet supports GREY, Y10, Y12, Y16, NV12, YUYV, UYVY, MJPG, JPEG"
    );
    let size = Camera { width_px: Some(512), ..settings() };
    assert_eq!(
        refusal(&size),
        "cannot set camera feature width_px to 512: the camera keeps 4; sizes as GREY: not listed"
    );
    let rate = Camera { frame_rate_hz: Some(1000.0), ..settings() };
    assert_eq!(
        refusal(&rate),
        "cannot set camera feature frame_rate_hz to 1000: the camera keeps 100.000; rates at this size: not listed Hz"
    );
}

#[test]
fn the_reported_rate_is_the_one_the_driver_keeps() {
    assert_eq!(apply(&mock().device(), &settings()).unwrap().frame_rate_hz.to_bits(), 100.0_f64.to_bits());
}

/// A webcam whose largest image has a useful rate only if compressed.
fn webcam() -> Mock {
    let mock = mock();
    mock.state().modes = vec![
        (sys::FOURCC_MJPG, (640, 480), 30),
        (sys::FOURCC_MJPG, (1280, 720), 30),
        (sys::FOURCC_YUYV, (640, 480), 30),
        (sys::FOURCC_YUYV, (1280, 720), 10),
        (sys::FOURCC_NV12, (320, 240), 30),
    ];
    mock
}

fn mode(width_px: u32, height_px: u32, frame_rate_hz: f64) -> Camera {
    let (width_px, height_px, frame_rate_hz) = (Some(width_px), Some(height_px), Some(frame_rate_hz));
    Camera { width_px, height_px, frame_rate_hz, pixel_format: Some(PixelFormat::Mono8), ..settings() }
}

#[test]
fn the_least_lossy_format_with_the_size_and_rate_is_taken() {
    for (wanted, code) in [
        (mode(320, 240, 30.0), "NV12"),
        (mode(640, 480, 30.0), "YUYV"),
        (mode(1280, 720, 10.0), "YUYV"),
        (mode(1280, 720, 30.0), "MJPG"),
    ] {
        let mock = webcam();
        let applied = apply(&mock.device(), &wanted).unwrap();
        assert_eq!(fourcc_text(applied.buffer.layout.fourcc), code);
        assert_eq!(Some(applied.frame_rate_hz), wanted.frame_rate_hz);
        let size = applied.buffer.size;
        assert_eq!(Some((size.width_px, size.height_px)), wanted.width_px.zip(wanted.height_px));
    }
    let rate = apply(&webcam().device(), &mode(320, 240, 60.0)).unwrap_err().to_string();
    assert_eq!(
        rate,
        "cannot set camera feature frame_rate_hz to 60: the camera keeps 30.000; rates at this size: 30 Hz"
    );
    let size = apply(&webcam().device(), &mode(512, 512, 30.0)).unwrap_err().to_string();
    assert!(size.contains("sizes as NV12: 320x240"), "{size}");
}

#[test]
fn an_exposure_is_reported_only_if_it_is_fixed() {
    let reported = |settings: &Camera, mock: &Mock| apply(&mock.device(), settings).unwrap().exposure_us;
    let mock = mock();
    let plain = settings();
    assert_eq!(reported(&plain, &mock).to_bits(), 0.0_f64.to_bits(), "the camera chooses it for each frame");
    assert_eq!(reported(&with(&[("auto_exposure", text("Manual Mode"))]), &mock).to_bits(), 15_600.0_f64.to_bits());
    assert_eq!(reported(&Camera { exposure_us: Some(500.0), ..plain }, &mock).to_bits(), 500.0_f64.to_bits());
}

#[test]
fn automatic_adjustments_are_reported_until_they_are_switched_off() {
    let given = |mock: &Mock, settings: &Camera| {
        let device = mock.device();
        let applied = apply(&device, settings).unwrap();
        warnings(&device, &applied, settings)
    };
    let mock = webcam();
    mock.state().controls.push(MockControl {
        id: sys::V4L2_CID_EXPOSURE_AUTO_PRIORITY,
        name: "Exposure, Dynamic Framerate",
        kind: sys::V4L2_CTRL_TYPE_BOOLEAN,
        range: (0, 1, 1),
        words: &[],
        value: 1,
        ruled_by: None,
    });
    // In the order of their numbers, as a driver lists them.
    let gamma = MockControl {
        id: sys::V4L2_CID_GAMMA,
        name: "Gamma",
        kind: sys::V4L2_CTRL_TYPE_INTEGER,
        range: (1, 500, 1),
        words: &[],
        value: 220,
        ruled_by: None,
    };
    mock.state().controls.insert(4, gamma);
    let warnings = given(&mock, &mode(1280, 720, 30.0));
    assert_eq!(warnings.len(), 5);
    assert!(warnings[0].starts_with("images are compressed (MJPG)"), "{warnings:?}");
    assert!(warnings[1].starts_with("the camera adjusts gain_automatic, auto_exposure automatically"), "{warnings:?}");
    assert!(warnings[2].starts_with("in the dark the camera lowers its frame rate"), "{warnings:?}");
    assert!(warnings[3].starts_with("its control gamma is 220, but usually only 100"), "{warnings:?}");
    assert!(
        warnings[4].contains("usually have a rolling shutter: the speed of what falls 7 px per frame"),
        "{warnings:?}"
    );
    let known = Camera { gamma: 0.5, row_time_us: Some(0.0), ..mode(1280, 720, 30.0) };
    assert_eq!(given(&mock, &known), warnings[..3]);
    let fixed = Camera {
        row_time_us: Some(0.0),
        exposure_us: Some(1000.0),
        ..with(&[("gain_automatic", FeatureValue::Bool(false)), ("gamma", FeatureValue::Integer(100))])
    };
    mock.state().fourcc = sys::FOURCC_YUYV;
    assert_eq!(given(&mock, &Camera { width_px: Some(640), height_px: Some(480), ..fixed }), [""; 0]);
}
