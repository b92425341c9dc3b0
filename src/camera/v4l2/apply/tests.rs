//! Settings and controls against an imitated driver.

use super::super::mock::{Mock, MockControl};
use super::*;
use crate::image::PixelFormat;
use std::collections::BTreeMap;

const GAIN: u32 = 1;
const AUTO_GAIN: u32 = 2;

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

fn with(features: &[(&str, FeatureValue)]) -> V4l2Settings {
    let features = features.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect::<BTreeMap<_, _>>();
    V4l2Settings { features, ..V4l2Settings::default() }
}

fn value(mock: &Mock, id: u32) -> i32 {
    mock.state().controls.iter().find(|control| control.id == id).unwrap().value
}

fn refusal(settings: &V4l2Settings) -> String {
    apply(&mock().device(), settings).unwrap_err().to_string()
}

fn text(word: &str) -> FeatureValue {
    FeatureValue::Text(word.into())
}

#[test]
fn controls_are_set_by_name_and_those_that_lock_others_first() {
    let mock = mock();
    let wanted = with(&[
        // Without effect while the automatic one is on, which comes later in the alphabet.
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
    apply(&mock.device(), &V4l2Settings { exposure_us: Some(2500.0), ..V4l2Settings::default() }).unwrap();
    assert_eq!(value(&mock, sys::V4L2_CID_EXPOSURE_AUTO), 1);
    assert_eq!(value(&mock, sys::V4L2_CID_EXPOSURE_ABSOLUTE), 25);
}

#[test]
fn what_a_control_cannot_be_is_refused_with_what_it_can() {
    let off = ("gain_automatic", FeatureValue::Bool(false));
    for (name, value, said) in [
        ("gain", FeatureValue::Integer(61), "set camera feature gain to 61: allowed 0 to 60 in steps of 2"),
        ("gain", FeatureValue::Integer(7), "set camera feature gain to 7: allowed 0 to 60 in steps of 2"),
        ("gain", text("much"), "set camera feature gain to much: it is of type integer, allowed 0 to 60 in steps of 2"),
        ("zoom", FeatureValue::Bool(false), "set camera feature zoom to false: it is a command: true executes it"),
        (
            "power_line_frequency",
            text("60 Hz"),
            "set camera feature power_line_frequency to 60 Hz: allowed Disabled, 50 Hz, Auto",
        ),
    ] {
        assert_eq!(refusal(&with(&[(name, value), off.clone()])), said);
    }
    let unknown = refusal(&with(&[("gian", FeatureValue::Integer(1))]));
    assert!(unknown.ends_with("no such control; it has gain, gain_automatic, power_line_frequency, zoom, auto_exposure, exposure_time_absolute"), "{unknown}");
    let ruled = refusal(&with(&[("gain", FeatureValue::Integer(2))]));
    assert!(ruled.ends_with("another control, mostly an automatic one, keeps it without effect"), "{ruled}");
}

#[test]
fn an_exposure_between_two_steps_or_beyond_the_range_is_refused() {
    let exposure = |us| refusal(&V4l2Settings { exposure_us: Some(us), ..V4l2Settings::default() });
    assert_eq!(exposure(150.0), "set camera feature exposure_us to 150: allowed in steps of 100 us");
    assert_eq!(exposure(600_000.0), "set camera feature exposure_us to 600000: allowed 1 to 5000, in units of 100 us");
}

#[test]
fn formats_sizes_and_rates_a_camera_does_not_keep_are_refused() {
    let format = V4l2Settings { pixel_format: Some(PixelFormat::Mono12), ..V4l2Settings::default() };
    assert_eq!(
        refusal(&format),
        "set camera feature pixel_format to Mono12: the camera offers GREY; GREY, Y10, Y12, Y16, YUYV, UYVY can be read"
    );
    let size = V4l2Settings { width_px: Some(512), ..V4l2Settings::default() };
    assert_eq!(refusal(&size), "set camera feature width_px to 512: the camera keeps 4; sizes as GREY: not told");
    let rate = V4l2Settings { frame_rate_hz: Some(1000.0), ..V4l2Settings::default() };
    assert_eq!(
        refusal(&rate),
        "set camera feature frame_rate_hz to 1000: the camera keeps 100.000; rates at this size: not told Hz"
    );
}

#[test]
fn the_rate_told_is_the_one_the_driver_keeps() {
    assert_eq!(apply(&mock().device(), &V4l2Settings::default()).unwrap().1.to_bits(), 100.0_f64.to_bits());
}
