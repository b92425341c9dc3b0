//! Applies a rig's settings to the camera, in the order that cameras need.

use super::chunks::Chunks;
use super::device::Device;
use super::feature::{check_entry, is_near};
use super::handle::{c_text, checked};
use super::sys::ARV_AUTO_OFF;
use crate::camera::feature_setting::{FloatRange, is_linear, set_in_dependency_order, setting_error};
use crate::camera::{CameraError, StreamFormat};
use crate::config::{self, FeatureValue};
use crate::image::PixelFormat;
use crate::results::FrameCoding;

/// Maximum image side: no sensor has more, so a larger value is an error of the camera.
const MAX_SIDE_PX: u32 = 65_535;

/// Heartbeat timeout after which the camera releases its controlling program, ms.
///
/// The library sends a heartbeat every second. Cameras default to 3 s; 2 s let a crashed process be replaced sooner.
const HEARTBEAT_MS: i64 = 2000;

/// Maximum chunk data behind an image.
const MAX_CHUNK_BYTES: usize = 64 << 10;

/// Writes every setting and returns the resulting stream format.
///
/// The order is: features by name; then region, format, exposure, rate and trigger by their own keys; then the trigger
/// features and those that the camera refused the first time (one may unlock another). At the end every feature is read
/// again.
///
/// # Errors
///
/// [`CameraError::Setting`] if the camera refuses a setting, does not keep it, or delivers an unsupported pixel format
/// or image size.
pub fn apply(device: &Device, settings: &config::Camera) -> Result<StreamFormat, CameraError> {
    // A camera that still streams for a crashed program locks most features. An idle camera refuses this call.
    let _ = device.call(device.aravis.arv_camera_stop_acquisition);
    if device.integer("GevHeartbeatTimeout").is_ok_and(|ms| ms > HEARTBEAT_MS)
        && let Err(reason) = device.set_integer("GevHeartbeatTimeout", HEARTBEAT_MS)
    {
        log::debug!("cannot set GevHeartbeatTimeout: {reason}");
    }
    let mut features: Vec<_> = settings.features.iter().collect();
    // Selectors come first because they select what the others mean; the rest stays sorted by name.
    features.sort_by_key(|(key, _)| !key.ends_with("Selector"));
    let (triggers, mut pending): (Vec<_>, Vec<_>) = features.into_iter().partition(|(key, _)| is_trigger(key));
    pending.retain(|(key, value)| device.set_feature(key, value).is_err());
    set_region(device, settings)?;
    let format = set_format(device, settings)?;
    set_exposure(device, settings)?;
    let frame_rate_hz = set_rate_and_trigger(device, settings)?;
    pending.extend(triggers);
    set_in_dependency_order(pending, |key, value| device.set_feature(key, value))?;
    for (key, value) in &settings.features {
        device.verify_feature(key, value)?;
    }
    let size = |name: &str| {
        let value = device.integer(name).map_err(|reason| setting_error(name, "its current value", reason))?;
        let pixels = u32::try_from(value).ok().filter(|pixels| (1..=MAX_SIDE_PX).contains(pixels));
        pixels.ok_or_else(|| setting_error(name, value, format!("allowed 1 to {MAX_SIDE_PX}")))
    };
    let exposure_us = match settings.exposure_us {
        Some(exposure_us) => exposure_us,
        None => fixed_exposure_us(device),
    };
    let (width_px, height_px, coding) = (size("Width")?, size("Height")?, FrameCoding::default());
    let stream = StreamFormat { width_px, height_px, format, frame_rate_hz, exposure_us, coding };
    check_size(settings, &stream)?;
    if let Some(gamma) = device.gamma().filter(|_| is_linear(settings)) {
        log::warn!(
            "{}: its Gamma is {gamma}, so grey levels are not proportional to light and edges appear displaced; set \
                         Gamma = 1.0 under [camera.features], or set camera.gamma",
            settings.id.as_deref().unwrap_or_default()
        );
    }
    Ok(stream)
}

/// Whether a feature belongs to the triggers, by the beginning of its name.
fn is_trigger(key: &str) -> bool {
    key.starts_with("Trigger")
}

/// Sets the requested size and offsets of the region of interest.
///
/// Before a size, offsets are set to 0 because they limit it; without a requested offset they stay 0.
///
/// # Errors
///
/// [`CameraError::Setting`] if the camera refuses one of them.
fn set_region(device: &Device, settings: &config::Camera) -> Result<(), CameraError> {
    let set_if_some = |name: &str, value: Option<u32>| match value {
        Some(value) => device.set_feature(name, &FeatureValue::Integer(i64::from(value))),
        None => Ok(()),
    };
    if settings.width_px.is_some() || settings.height_px.is_some() {
        for name in ["OffsetX", "OffsetY"] {
            if device.has(name) {
                set_if_some(name, Some(0))?;
            }
        }
    }
    set_if_some("Width", settings.width_px)?;
    set_if_some("Height", settings.height_px)?;
    set_if_some("OffsetX", settings.offset_x_px)?;
    set_if_some("OffsetY", settings.offset_y_px)
}

/// Checks that the image still has the requested size, which a later setting (such as binning) may change.
///
/// # Errors
///
/// [`CameraError::Setting`] with the size that the camera keeps.
fn check_size(settings: &config::Camera, stream: &StreamFormat) -> Result<(), CameraError> {
    for (name, wanted, kept) in
        [("Width", settings.width_px, stream.width_px), ("Height", settings.height_px, stream.height_px)]
    {
        if let Some(wanted) = wanted.filter(|wanted| *wanted != kept) {
            return Err(setting_error(name, wanted, format!("the camera keeps {kept} after its other settings")));
        }
    }
    Ok(())
}

/// Sets the requested pixel format, if there is one, and returns the resulting format.
///
/// # Errors
///
/// [`CameraError::Setting`] if the camera refuses the format, or its own is not supported.
fn set_format(device: &Device, settings: &config::Camera) -> Result<PixelFormat, CameraError> {
    if let Some(format) = settings.pixel_format {
        device.set_feature("PixelFormat", &FeatureValue::Text(format.as_str().into()))?;
    }
    let current = |reason| setting_error("PixelFormat", "its current value", reason);
    let code = device.call(device.aravis.arv_camera_get_pixel_format).map_err(current)?;
    PixelFormat::from_number(code).ok_or_else(|| {
        let supported: Vec<_> = PixelFormat::ALL.iter().map(|format| format.as_str()).collect();
        let name = device.text("PixelFormat").unwrap_or_else(|_| format!("{code:#010x}"));
        setting_error("PixelFormat", name, format!("choose one of {}", supported.join(", ")))
    })
}

/// Returns the present exposure time, us; 0 if the camera does not report it or adjusts it automatically.
fn fixed_exposure_us(device: &Device) -> f64 {
    let is_automatic = ["ExposureAuto", "ExposureMode"]
        .into_iter()
        .any(|name| device.text(name).is_ok_and(|word| !matches!(word.as_str(), "Off" | "Timed")));
    let exposure_us = device.call(device.aravis.arv_camera_get_exposure_time).ok();
    exposure_us.filter(|exposure_us| !is_automatic && exposure_us.is_finite() && *exposure_us > 0.0).unwrap_or(0.0)
}

/// Disables automatic exposure, and sets and reads back the requested exposure time; does nothing without one.
///
/// # Errors
///
/// [`CameraError::Setting`] if the camera refuses it, with the allowed range, or keeps another time.
fn set_exposure(device: &Device, settings: &config::Camera) -> Result<(), CameraError> {
    let Some(wanted) = settings.exposure_us else { return Ok(()) };
    let refused = |reason: String| setting_error("exposure_us", wanted, reason);
    let aravis = device.aravis;
    let pointer = device.camera.as_ptr();
    if device.call(aravis.arv_camera_is_exposure_auto_available).is_ok_and(|available| available != 0) {
        // SAFETY: an open camera and a constant of the library.
        checked(aravis, |error| unsafe { aravis.arv_camera_set_exposure_time_auto(pointer, ARV_AUTO_OFF, error) })
            .map_err(refused)?;
    }
    device.bounds(aravis.arv_camera_get_exposure_time_bounds).and_then(|range| range.check(wanted)).map_err(refused)?;
    // SAFETY: an open camera.
    checked(aravis, |error| unsafe { aravis.arv_camera_set_exposure_time(pointer, wanted, error) }).map_err(refused)?;
    let kept = device.call(aravis.arv_camera_get_exposure_time).map_err(refused)?;
    if is_near(wanted, kept) { Ok(()) } else { Err(refused(format!("the camera keeps {kept}"))) }
}

/// Sets the rate, then the trigger, and returns the resulting rate, Hz; 0 if neither camera nor settings have one.
///
/// Setting a rate disables triggers, so the order matters. Without a trigger in the settings, all are switched off.
///
/// # Errors
///
/// [`CameraError::Setting`] if the camera refuses the rate or the trigger, keeps another, or does not report its rate.
fn set_rate_and_trigger(device: &Device, settings: &config::Camera) -> Result<f64, CameraError> {
    let aravis = device.aravis;
    let has_rate = device.call(aravis.arv_camera_is_frame_rate_available).is_ok_and(|available| available != 0);
    if let Some(wanted) = settings.frame_rate_hz {
        device
            .with_trigger_selector_kept(|| set_rate(device, wanted))
            .map_err(|reason| setting_error("frame_rate_hz", wanted, reason))?;
    }
    match &settings.trigger_source {
        Some(source) => {
            set_trigger(device, source).map_err(|reason| setting_error("trigger_source", source, reason))?
        }
        // A trigger that another program left armed would keep the camera silent.
        None if !settings.features.keys().any(|key| is_trigger(key)) && device.has("TriggerMode") => device
            .call(aravis.arv_camera_clear_triggers)
            .map_err(|reason| setting_error("TriggerMode", "Off", reason))?,
        None => {}
    }
    if has_rate {
        return device
            .call(aravis.arv_camera_get_frame_rate)
            .map_err(|reason| setting_error("frame_rate_hz", "its current value", reason));
    }
    Ok(settings.frame_rate_hz.unwrap_or(0.0))
}

/// Sets the frame rate and reads it back.
///
/// # Errors
///
/// The allowed range, the library's message, or the rate that the camera keeps instead.
fn set_rate(device: &Device, wanted_hz: f64) -> Result<(), String> {
    let aravis = device.aravis;
    let pointer = device.camera.as_ptr();
    device.rate_range_hz()?.check(wanted_hz)?;
    // SAFETY: an open camera.
    checked(aravis, |error| unsafe { aravis.arv_camera_set_frame_rate(pointer, wanted_hz, error) })?;
    let kept = device.call(aravis.arv_camera_get_frame_rate)?;
    if is_near(wanted_hz, kept) { Ok(()) } else { Err(format!("the camera keeps {kept}")) }
}

impl Device {
    /// Runs a call that changes the trigger selector, and restores the selector, even if the call fails.
    fn with_trigger_selector_kept(&self, act: impl FnOnce() -> Result<(), String>) -> Result<(), String> {
        let before = self.text("TriggerSelector").ok();
        let result = act();
        let restored = before.map_or(Ok(()), |before| self.set_text("TriggerSelector", &before));
        result.and(restored)
    }

    /// Returns the range of frame rates at the present settings, Hz.
    pub(super) fn rate_range_hz(&self) -> Result<FloatRange, String> {
        self.bounds(self.aravis.arv_camera_get_frame_rate_bounds)
    }
}

/// Switches to hardware triggers from this source, and checks that the camera keeps the setting.
///
/// # Errors
///
/// The allowed sources, the library's message, or the source and mode that the camera keeps instead.
fn set_trigger(device: &Device, source: &str) -> Result<(), String> {
    check_entry(source, &device.enum_entries("TriggerSource")?)?;
    let name = c_text(source)?;
    let aravis = device.aravis;
    // SAFETY: an open camera and a terminated name.
    checked(aravis, |error| unsafe {
        aravis.arv_camera_set_trigger(device.camera.as_ptr(), name.as_ptr(), error);
    })?;
    let (mode, kept) = (device.text("TriggerMode")?, device.text("TriggerSource")?);
    if mode != "On" || kept != source {
        return Err(format!("the camera keeps source {kept}, mode {mode}"));
    }
    Ok(())
}

/// Returns the payload size of each frame, bytes. The payload is the pixels and, with `chunks`, the chunk data behind
/// them.
///
/// # Errors
///
/// [`CameraError::Setting`] if the camera sends something else.
pub fn payload_bytes(device: &Device, stream: &StreamFormat, chunks: Option<&Chunks>) -> Result<usize, CameraError> {
    let refused = |value: String, reason: String| setting_error("PayloadSize", value, reason);
    let payload = device
        .call(device.aravis.arv_camera_get_payload)
        .map_err(|reason| refused("its current value".into(), reason))?;
    let pixels = stream.slot_bytes();
    let has_chunks = chunks.is_some();
    match payload as usize {
        bytes if bytes == pixels && !has_chunks => Ok(bytes),
        bytes if (pixels + 1..=pixels + MAX_CHUNK_BYTES).contains(&bytes) && has_chunks => Ok(bytes),
        _ if has_chunks => {
            let reason = format!("a frame has {pixels} bytes and up to {MAX_CHUNK_BYTES} bytes of chunk data");
            Err(refused(payload.to_string(), reason))
        }
        _ => Err(refused(payload.to_string(), format!("a frame has {pixels} bytes: switch padding off"))),
    }
}
