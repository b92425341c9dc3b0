//! A rig's settings, written to the driver: format and size, then rate, then controls.

use super::device::Device;
use super::layout::{LAYOUTS, Layout, Shape, word};
use super::offer::{interval_of_rate, is_rate, rate_hz};
use super::settings::V4l2Settings;
use super::sys;
use crate::camera::CameraError;
use crate::camera::setting::{set_until_none_is_left, setting};
use crate::config::FeatureValue;
use std::io;

/// An exposure read back this near, relative, is the one that was set.
const EXPOSURE_ROUNDING: f64 = 0.01;
/// Unit of `V4L2_CID_EXPOSURE_ABSOLUTE`, us.
const EXPOSURE_UNIT_US: f64 = 100.0;

/// What the driver delivers after its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Applied {
    pub shape: Shape,
    /// 0 when nobody knows.
    pub frame_rate_hz: f64,
    /// 0 when the driver does not tell, or changes it by itself.
    pub exposure_us: f64,
}

/// Writes every setting, reads every one back, and answers with what the driver delivers then.
pub(super) fn apply(device: &Device, settings: &V4l2Settings) -> Result<Applied, CameraError> {
    let layout = choose(device, settings)?;
    let shape = set_format(device, settings, layout)?;
    set_rate(device, settings, &shape)?;
    // An automatic control may lock those it rules.
    set_until_none_is_left(&settings.features, |name, value| device.set_control(name, value))?;
    set_exposure(device, settings)?;
    for (name, value) in &settings.features {
        device.verify_control(name, value)?;
    }
    // Controls may change the rate: an automatic exposure may lengthen the frames.
    let kept = device.interval().map(rate_hz);
    if let (Some(wanted), Some(kept)) = (settings.frame_rate_hz, kept) {
        check_rate(wanted, kept)?;
    }
    let frame_rate_hz = kept.or(settings.frame_rate_hz).unwrap_or(0.0);
    let exposure_us = settings.exposure_us.or_else(|| exposure_us(device)).unwrap_or(0.0);
    Ok(Applied { shape, frame_rate_hz, exposure_us })
}

/// How long a driver exposes that was told how long; nothing when it decides by itself or does not tell.
fn exposure_us(device: &Device) -> Option<f64> {
    let is_manual = device.number(sys::V4L2_CID_EXPOSURE_AUTO).is_none_or(|mode| {
        let fixed = [sys::V4L2_EXPOSURE_MANUAL, sys::V4L2_EXPOSURE_SHUTTER_PRIORITY];
        fixed.into_iter().any(|place| i64::from(place) == mode)
    });
    let units = device.number(sys::V4L2_CID_EXPOSURE_ABSOLUTE).filter(|units| is_manual && *units > 0)?;
    Some(units as f64 * EXPOSURE_UNIT_US)
}

/// The best of the driver's formats that gives the pixels wanted, if one can at this size and rate.
fn choose(device: &Device, settings: &V4l2Settings) -> Result<Layout, CameraError> {
    let offered = device.formats();
    let offers = |layout: &&Layout| offered.iter().any(|(fourcc, _)| *fourcc == layout.fourcc);
    let wanted = |layout: &&Layout| settings.pixel_format.is_none_or(|format| format == layout.format);
    let usable: Vec<_> = LAYOUTS.iter().filter(offers).filter(wanted).collect();
    // With none that can, the first is set, and refused with what it can.
    let best = usable.iter().find(|layout| reaches(device, settings, layout.fourcc)).or(usable.first());
    best.map(|layout| **layout).ok_or_else(|| {
        let value = settings.pixel_format.map_or("any", |format| format.word());
        let words: Vec<_> = offered.iter().map(|(fourcc, _)| word(*fourcc)).collect();
        let usable: Vec<_> = LAYOUTS.iter().map(|layout| word(layout.fourcc)).collect();
        let reason = format!("the camera offers {}; {} can be read", words.join(", "), usable.join(", "));
        setting("pixel_format", value, reason)
    })
}

/// Whether the driver says that it has this format in the size and at the rate wanted, or leaves it open.
fn reaches(device: &Device, settings: &V4l2Settings, fourcc: u32) -> bool {
    let Some(size) = settings.width_px.zip(settings.height_px) else { return true };
    let has_rate = |rate_hz| device.rates(fourcc, size).may_be(rate_hz);
    device.sizes(fourcc).may_be(size) && settings.frame_rate_hz.is_none_or(has_rate)
}

fn set_format(device: &Device, settings: &V4l2Settings, layout: Layout) -> Result<Shape, CameraError> {
    let name = word(layout.fourcc);
    let failed = |error: io::Error| match error.raw_os_error() {
        Some(libc::EBUSY) => CameraError::NotFound { id: device.id.clone(), reason: "another program uses it".into() },
        _ => setting("pixel_format", &name, error.to_string()),
    };
    let mut pix = device.format().map_err(failed)?;
    pix.width = settings.width_px.unwrap_or(pix.width);
    pix.height = settings.height_px.unwrap_or(pix.height);
    pix.pixelformat = layout.fourcc;
    pix.field = sys::V4L2_FIELD_NONE;
    // The driver's to choose: what is left of another format may be too long.
    (pix.bytesperline, pix.sizeimage) = (0, 0);
    let kept = device.set_format(pix).map_err(failed)?;
    if kept.pixelformat != layout.fourcc {
        return Err(setting("pixel_format", name, format!("the camera keeps {}", word(kept.pixelformat))));
    }
    let sizes = || device.sizes(layout.fourcc);
    for (key, wanted, kept) in [("width_px", pix.width, kept.width), ("height_px", pix.height, kept.height)] {
        if wanted != kept {
            return Err(setting(key, wanted, format!("the camera keeps {kept}; sizes as {name}: {}", sizes())));
        }
    }
    if kept.field != sys::V4L2_FIELD_NONE {
        return Err(setting("pixel_format", name, "the camera delivers interlaced fields, not whole pictures"));
    }
    let shape = Shape {
        layout,
        width_px: kept.width,
        height_px: kept.height,
        stride_bytes: kept.bytesperline,
        image_bytes: kept.sizeimage,
    };
    if shape.height_px == 0 || shape.width_px == 0 || shape.whole_bytes() > kept.sizeimage as usize {
        let reason = format!("the driver's buffers of {} bytes do not hold a picture", kept.sizeimage);
        return Err(setting("pixel_format", name, reason));
    }
    Ok(shape)
}

fn set_rate(device: &Device, settings: &V4l2Settings, shape: &Shape) -> Result<(), CameraError> {
    let Some(wanted) = settings.frame_rate_hz else { return Ok(()) };
    if device.interval().is_none() {
        log::warn!("{}: the driver sets no rates; frames come at the camera's own", device.id);
        return Ok(());
    }
    let refused = |reason: String| {
        let rates = device.rates(shape.layout.fourcc, (shape.width_px, shape.height_px));
        setting("frame_rate_hz", wanted, format!("{reason}; rates at this size: {rates} Hz"))
    };
    let kept = device.set_interval(interval_of_rate(wanted)).map_err(|error| refused(error.to_string()))?;
    match kept.map(rate_hz) {
        Some(kept) => check_rate(wanted, kept).map_err(|_| refused(format!("the camera keeps {kept:.3}"))),
        None => Ok(()),
    }
}

fn check_rate(wanted: f64, kept: f64) -> Result<(), CameraError> {
    if is_rate(wanted, kept) {
        return Ok(());
    }
    Err(setting("frame_rate_hz", wanted, format!("the camera keeps {kept:.3} after its other settings")))
}

fn set_exposure(device: &Device, settings: &V4l2Settings) -> Result<(), CameraError> {
    let Some(wanted) = settings.exposure_us else { return Ok(()) };
    let refused = |reason: String| setting("exposure_us", wanted, reason);
    let controls = device.controls();
    let name = |id| controls.iter().find(|control| control.id == id).map(|control| control.name.clone());
    let Some(exposure) = name(sys::V4L2_CID_EXPOSURE_ABSOLUTE) else {
        return Err(refused("the camera has no exposure in us; set its own control under features".into()));
    };
    if let Some(auto) = name(sys::V4L2_CID_EXPOSURE_AUTO) {
        device.set_menu_place(&auto, sys::V4L2_EXPOSURE_MANUAL).map_err(refused)?;
    }
    let units = (wanted / EXPOSURE_UNIT_US).round();
    if (units * EXPOSURE_UNIT_US - wanted).abs() > EXPOSURE_ROUNDING * wanted {
        return Err(refused(format!("allowed in steps of {EXPOSURE_UNIT_US} us")));
    }
    device.set_control(&exposure, &FeatureValue::Integer(units as i64)).map_err(|error| match error {
        CameraError::Setting { reason, .. } => refused(format!("{reason}, in units of {EXPOSURE_UNIT_US} us")),
        other => other,
    })
}

#[cfg(test)]
#[path = "apply/tests.rs"]
mod tests;
