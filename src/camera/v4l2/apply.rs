//! Applies a rig's settings to the driver: format and size, then rate, then controls.

use super::device::Device;
use super::modes::{FrameSize, interval_of_rate, is_same_rate, rate_hz};
use super::pixel_layout::{BufferLayout, LAYOUTS, Layout, fourcc_text};
use super::sys;
use crate::camera::CameraError;
use crate::camera::feature_setting::{set_in_dependency_order, setting_error};
use crate::config::{self, FeatureValue};
use std::io;

/// Maximum relative difference between an exposure and its read-back.
const MAX_EXPOSURE_ROUNDING: f64 = 0.01;
/// Unit of `V4L2_CID_EXPOSURE_ABSOLUTE`, us.
const EXPOSURE_UNIT_US: f64 = 100.0;

/// The stream that results from the settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Applied {
    pub buffer: BufferLayout,
    /// 0 if unknown.
    pub frame_rate_hz: f64,
    /// 0 if the driver does not report it or adjusts it automatically.
    pub exposure_us: f64,
}

/// Applies every setting, reads every one back, and returns the resulting stream.
///
/// # Errors
///
/// [`CameraError::Setting`] with the key or control, the value and the allowed values if the driver refuses or changes
/// one. [`CameraError::NotFound`] if another program uses the camera.
pub(super) fn apply(device: &Device, settings: &config::Camera) -> Result<Applied, CameraError> {
    let layout = select_layout(device, settings)?;
    let buffer = set_format(device, settings, layout)?;
    set_rate(device, settings, &buffer)?;
    // An automatic control may lock the ones it adjusts.
    set_in_dependency_order(&settings.features, |name, value| device.set_control(name, value))?;
    set_exposure(device, settings)?;
    for (name, value) in &settings.features {
        device.verify_control(name, value)?;
    }
    // Controls may change the rate: automatic exposure may lengthen the frames.
    let kept = device.interval().map(rate_hz);
    if let (Some(wanted), Some(kept)) = (settings.frame_rate_hz, kept) {
        check_rate(wanted, kept)?;
    }
    let frame_rate_hz = kept.or(settings.frame_rate_hz).unwrap_or(0.0);
    let exposure_us = settings.exposure_us.or_else(|| fixed_exposure_us(device)).unwrap_or(0.0);
    Ok(Applied { buffer, frame_rate_hz, exposure_us })
}

/// Returns the exposure time if it is fixed, us; `None` if it is automatic or not reported.
///
/// It is fixed in the modes manual and shutter priority, and without a control for automatic exposure.
fn fixed_exposure_us(device: &Device) -> Option<f64> {
    let is_manual = device.number(sys::V4L2_CID_EXPOSURE_AUTO).is_none_or(|mode| {
        let fixed = [sys::V4L2_EXPOSURE_MANUAL, sys::V4L2_EXPOSURE_SHUTTER_PRIORITY];
        fixed.into_iter().any(|index| i64::from(index) == mode)
    });
    let units = device.number(sys::V4L2_CID_EXPOSURE_ABSOLUTE).filter(|units| is_manual && *units > 0)?;
    Some(units as f64 * EXPOSURE_UNIT_US)
}

/// Selects the best of the driver's formats for the requested pixel format, size and rate.
///
/// The order is that of [`LAYOUTS`]. If none has the size and rate, it is the first with the pixel format.
///
/// # Errors
///
/// [`CameraError::Setting`] if the camera offers no supported format, or not the requested one.
fn select_layout(device: &Device, settings: &config::Camera) -> Result<Layout, CameraError> {
    let offered = device.formats();
    let offers = |layout: &&Layout| offered.iter().any(|(fourcc, _)| *fourcc == layout.fourcc);
    let wanted = |layout: &&Layout| settings.pixel_format.is_none_or(|format| format == layout.format);
    let usable: Vec<_> = LAYOUTS.iter().filter(offers).filter(wanted).collect();
    // If none has the size and rate, setting the first one fails and lists what it supports.
    let best = usable.iter().find(|layout| may_support(device, settings, layout.fourcc)).or(usable.first());
    best.map(|layout| **layout).ok_or_else(|| {
        let value = settings.pixel_format.map_or("any", |format| format.as_str());
        let offered: Vec<_> = offered.iter().map(|(fourcc, _)| fourcc_text(*fourcc)).collect();
        let supported: Vec<_> = LAYOUTS.iter().map(|layout| fourcc_text(layout.fourcc)).collect();
        let reason = format!("the camera offers {}; ricochet supports {}", offered.join(", "), supported.join(", "));
        setting_error("pixel_format", value, reason)
    })
}

/// Whether a format (four-character code) has the requested size and rate, or may have because the driver lists none.
///
/// `true` if the settings leave the width or the height open.
fn may_support(device: &Device, settings: &config::Camera, fourcc: u32) -> bool {
    let (Some(width_px), Some(height_px)) = (settings.width_px, settings.height_px) else { return true };
    let size = FrameSize { width_px, height_px };
    let has_rate = |rate_hz| device.rates(fourcc, size).may_include(rate_hz);
    device.sizes(fourcc).may_include(size) && settings.frame_rate_hz.is_none_or(has_rate)
}

/// Sets the pixel format and the size, and returns the layout of the driver's buffers.
///
/// # Errors
///
/// [`CameraError::Setting`] if the driver keeps another format or size, interlaces, or has too small buffers.
/// [`CameraError::NotFound`] if another program uses the camera.
fn set_format(device: &Device, settings: &config::Camera, layout: Layout) -> Result<BufferLayout, CameraError> {
    let name = fourcc_text(layout.fourcc);
    let failed = |error: io::Error| match error.raw_os_error() {
        Some(libc::EBUSY) => CameraError::NotFound { id: device.id.clone(), reason: "another program uses it".into() },
        _ => setting_error("pixel_format", &name, error.to_string()),
    };
    let mut pix = device.format().map_err(failed)?;
    pix.width = settings.width_px.unwrap_or(pix.width);
    pix.height = settings.height_px.unwrap_or(pix.height);
    pix.pixelformat = layout.fourcc;
    pix.field = sys::V4L2_FIELD_NONE;
    // The driver chooses: values of the previous format may be too large.
    (pix.bytesperline, pix.sizeimage) = (0, 0);
    let kept = device.set_format(pix).map_err(failed)?;
    if kept.pixelformat != layout.fourcc {
        return Err(setting_error("pixel_format", name, format!("the camera keeps {}", fourcc_text(kept.pixelformat))));
    }
    let sizes = || device.sizes(layout.fourcc);
    for (key, wanted, kept) in [("width_px", pix.width, kept.width), ("height_px", pix.height, kept.height)] {
        if wanted != kept {
            return Err(setting_error(key, wanted, format!("the camera keeps {kept}; sizes as {name}: {}", sizes())));
        }
    }
    if kept.field != sys::V4L2_FIELD_NONE {
        return Err(setting_error(
            "pixel_format",
            name,
            "the camera delivers interlaced fields instead of full frames",
        ));
    }
    let size = FrameSize { width_px: kept.width, height_px: kept.height };
    let buffer = BufferLayout { layout, size, stride_bytes: kept.bytesperline, image_bytes: kept.sizeimage };
    if size.height_px == 0 || size.width_px == 0 || buffer.min_bytes() > kept.sizeimage as usize {
        let reason = format!("the driver's buffers of {} bytes are too small for a frame", kept.sizeimage);
        return Err(setting_error("pixel_format", name, reason));
    }
    Ok(buffer)
}

/// Sets the requested frame rate, if there is one, and checks the rate that the driver keeps.
///
/// A driver without a settable rate is only warned about.
///
/// # Errors
///
/// [`CameraError::Setting`] with the rates at this size if the driver refuses the rate or keeps another.
fn set_rate(device: &Device, settings: &config::Camera, buffer: &BufferLayout) -> Result<(), CameraError> {
    let Some(wanted) = settings.frame_rate_hz else { return Ok(()) };
    if device.interval().is_none() {
        log::warn!("{}: cannot set the frame rate: the driver does not support it; the camera uses its own", device.id);
        return Ok(());
    }
    let refused = |reason: String| {
        let rates = device.rates(buffer.layout.fourcc, buffer.size);
        setting_error("frame_rate_hz", wanted, format!("{reason}; rates at this size: {rates} Hz"))
    };
    let kept = device.set_interval(interval_of_rate(wanted)).map_err(|error| refused(error.to_string()))?;
    match kept.map(rate_hz) {
        Some(kept) => check_rate(wanted, kept).map_err(|_| refused(format!("the camera keeps {kept:.3}"))),
        None => Ok(()),
    }
}

/// Checks that the driver keeps the requested frame rate after its other settings.
///
/// # Errors
///
/// [`CameraError::Setting`] with the rate that it keeps.
fn check_rate(wanted_hz: f64, kept_hz: f64) -> Result<(), CameraError> {
    if is_same_rate(wanted_hz, kept_hz) {
        return Ok(());
    }
    Err(setting_error("frame_rate_hz", wanted_hz, format!("the camera keeps {kept_hz:.3} after its other settings")))
}

/// Disables automatic exposure and sets the requested exposure time, if there is one.
///
/// # Errors
///
/// [`CameraError::Setting`] if the camera has no standard exposure control, or cannot be set to this time within
/// [`MAX_EXPOSURE_ROUNDING`].
fn set_exposure(device: &Device, settings: &config::Camera) -> Result<(), CameraError> {
    let Some(wanted) = settings.exposure_us else { return Ok(()) };
    let refused = |reason: String| setting_error("exposure_us", wanted, reason);
    let controls = device.controls();
    let name = |id| controls.iter().find(|control| control.id == id).map(|control| control.name.clone());
    let Some(exposure) = name(sys::V4L2_CID_EXPOSURE_ABSOLUTE) else {
        return Err(refused("the camera has no exposure in us; set its own control under features".into()));
    };
    if let Some(auto) = name(sys::V4L2_CID_EXPOSURE_AUTO) {
        device.set_menu_index(&auto, sys::V4L2_EXPOSURE_MANUAL).map_err(refused)?;
    }
    let units = (wanted / EXPOSURE_UNIT_US).round();
    if (units * EXPOSURE_UNIT_US - wanted).abs() > MAX_EXPOSURE_ROUNDING * wanted {
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
