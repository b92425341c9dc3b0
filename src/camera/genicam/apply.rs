//! A rig's settings, written to the camera in the order cameras need.

use super::device::Device;
use super::feature::{check_real, is_near};
use super::handle::{c_text, checked};
use super::settings::GenicamSettings;
use super::sys::ARV_AUTO_OFF;
use crate::camera::setting::{set_until_none_is_left, setting};
use crate::camera::{CameraError, StreamFormat};
use crate::config::FeatureValue;
use crate::image::PixelFormat;

/// Longest side of a picture: no sensor has more, so that a camera which tells more tells nonsense.
const MAX_SIDE_PX: u32 = 65_535;

/// After so long without a sign of life a camera lets go of whoever controls it: twice the library's second between two
/// of them, and a second less than cameras come with, so that a process that died is replaced the sooner.
const HEARTBEAT_MS: i64 = 2000;

/// Most that a camera sends behind a picture.
const MAX_CHUNKS_BYTES: usize = 64 << 10;

/// Writes every setting and answers with what the camera delivers then.
///
/// Order: features by name, then region, format, exposure, rate and trigger by
/// their own keys, then the features of triggers and those the camera refused the
/// first time (one may unlock another). At the end every one is read again.
pub fn apply(device: &Device, settings: &GenicamSettings) -> Result<StreamFormat, CameraError> {
    // A camera still streaming for someone who died locks most features; one that is not, refuses this.
    let _ = device.ask(device.aravis.arv_camera_stop_acquisition);
    if device.integer("GevHeartbeatTimeout").is_ok_and(|ms| ms > HEARTBEAT_MS)
        && let Err(reason) = device.set_integer("GevHeartbeatTimeout", HEARTBEAT_MS)
    {
        log::debug!("GevHeartbeatTimeout stays as it is: {reason}");
    }
    let mut features: Vec<_> = settings.features.iter().collect();
    // What the others mean depends on the selectors; otherwise the order of the names stays.
    features.sort_by_key(|(key, _)| !key.ends_with("Selector"));
    let (triggers, mut pending): (Vec<_>, Vec<_>) =
        features.into_iter().partition(|(key, _)| key.starts_with("Trigger"));
    pending.retain(|(key, value)| device.set_feature(key, value).is_err());
    set_region(device, settings)?;
    let format = set_format(device, settings)?;
    set_exposure(device, settings)?;
    let frame_rate_hz = set_rate_and_trigger(device, settings, triggers.is_empty())?;
    pending.extend(triggers);
    set_until_none_is_left(pending, |key, value| device.set_feature(key, value))?;
    for (key, value) in &settings.features {
        device.verify_feature(key, value)?;
    }
    let size = |name: &str| {
        let value = device.integer(name).map_err(|reason| setting(name, "its current value", reason))?;
        let pixels = u32::try_from(value).ok().filter(|pixels| (1..=MAX_SIDE_PX).contains(pixels));
        pixels.ok_or_else(|| setting(name, value, format!("allowed 1 to {MAX_SIDE_PX}")))
    };
    let exposure_us = match settings.exposure_us {
        Some(exposure_us) => exposure_us,
        None => exposure(device),
    };
    let stream =
        StreamFormat { width_px: size("Width")?, height_px: size("Height")?, format, frame_rate_hz, exposure_us };
    check_region(settings, &stream)?;
    if let Some(gamma) = device.gamma().filter(|_| !settings.is_tone_known) {
        log::warn!(
            "{}: its Gamma is {gamma}: grey levels are not light, and edges of bodies lie elsewhere; set Gamma = 1.0 under \
             [camera.features], or tell camera.gamma",
            settings.id
        );
    }
    Ok(stream)
}

/// Window: offsets to 0 first, since they bound the size.
fn set_region(device: &Device, settings: &GenicamSettings) -> Result<(), CameraError> {
    let whole = |name: &str, value: Option<u32>| match value {
        Some(value) => device.set_feature(name, &FeatureValue::Integer(i64::from(value))),
        None => Ok(()),
    };
    if settings.width_px.is_some() || settings.height_px.is_some() {
        for name in ["OffsetX", "OffsetY"] {
            if device.has(name) {
                whole(name, Some(0))?;
            }
        }
    }
    whole("Width", settings.width_px)?;
    whole("Height", settings.height_px)?;
    whole("OffsetX", settings.offset_x_px)?;
    whole("OffsetY", settings.offset_y_px)
}

fn check_region(settings: &GenicamSettings, stream: &StreamFormat) -> Result<(), CameraError> {
    for (name, wanted, kept) in
        [("Width", settings.width_px, stream.width_px), ("Height", settings.height_px, stream.height_px)]
    {
        if let Some(wanted) = wanted.filter(|wanted| *wanted != kept) {
            return Err(setting(name, wanted, format!("the camera keeps {kept} after its other settings")));
        }
    }
    Ok(())
}

fn set_format(device: &Device, settings: &GenicamSettings) -> Result<PixelFormat, CameraError> {
    if let Some(format) = settings.pixel_format {
        device.set_feature("PixelFormat", &FeatureValue::Text(format.word().into()))?;
    }
    let current = |reason| setting("PixelFormat", "its current value", reason);
    let code = device.ask(device.aravis.arv_camera_get_pixel_format).map_err(current)?;
    PixelFormat::from_code(code).ok_or_else(|| {
        let ours: Vec<_> = PixelFormat::ALL.iter().map(|format| format.word()).collect();
        let word = device.text("PixelFormat").unwrap_or_else(|_| format!("{code:#010x}"));
        setting("PixelFormat", word, format!("choose one of {}", ours.join(", ")))
    })
}

/// What the camera was left to expose for, us; 0 where it does not tell, or changes it by itself.
fn exposure(device: &Device) -> f64 {
    let is_automatic = ["ExposureAuto", "ExposureMode"]
        .into_iter()
        .any(|name| device.text(name).is_ok_and(|word| !matches!(word.as_str(), "Off" | "Timed")));
    let told = device.ask(device.aravis.arv_camera_get_exposure_time).ok();
    told.filter(|exposure_us| !is_automatic && exposure_us.is_finite() && *exposure_us > 0.0).unwrap_or(0.0)
}

fn set_exposure(device: &Device, settings: &GenicamSettings) -> Result<(), CameraError> {
    let Some(wanted) = settings.exposure_us else { return Ok(()) };
    let refused = |reason: String| setting("exposure_us", wanted, reason);
    let aravis = device.aravis;
    let pointer = device.camera.as_ptr();
    if device.ask(aravis.arv_camera_is_exposure_auto_available).is_ok_and(|available| available != 0) {
        // SAFETY: an open camera and a constant of the library.
        checked(aravis, |error| unsafe { aravis.arv_camera_set_exposure_time_auto(pointer, ARV_AUTO_OFF, error) })
            .map_err(refused)?;
    }
    let (mut least, mut most) = (0.0, 0.0);
    // SAFETY: an open camera and two numbers of ours to write to.
    checked(aravis, |error| unsafe {
        aravis.arv_camera_get_exposure_time_bounds(pointer, &raw mut least, &raw mut most, error);
    })
    .map_err(refused)?;
    check_real(wanted, least, most).map_err(refused)?;
    // SAFETY: an open camera.
    checked(aravis, |error| unsafe { aravis.arv_camera_set_exposure_time(pointer, wanted, error) }).map_err(refused)?;
    let kept = device.ask(aravis.arv_camera_get_exposure_time).map_err(refused)?;
    if is_near(wanted, kept) { Ok(()) } else { Err(refused(format!("the camera keeps {kept}"))) }
}

/// Rate, then trigger: setting a rate switches triggers off, so this order and no other.
fn set_rate_and_trigger(
    device: &Device,
    settings: &GenicamSettings,
    no_trigger_features: bool,
) -> Result<f64, CameraError> {
    let aravis = device.aravis;
    let has_rate = device.ask(aravis.arv_camera_is_frame_rate_available).is_ok_and(|available| available != 0);
    if let Some(wanted) = settings.frame_rate_hz {
        device
            .with_trigger_selector_kept(|| set_rate(device, wanted))
            .map_err(|reason| setting("frame_rate_hz", wanted, reason))?;
    }
    match &settings.trigger_source {
        Some(source) => set_trigger(device, source).map_err(|reason| setting("trigger_source", source, reason))?,
        // An armed trigger left behind by another program would keep the camera silent.
        None if no_trigger_features && device.has("TriggerMode") => {
            device.ask(aravis.arv_camera_clear_triggers).map_err(|reason| setting("TriggerMode", "Off", reason))?
        }
        None => {}
    }
    if has_rate {
        return device
            .ask(aravis.arv_camera_get_frame_rate)
            .map_err(|reason| setting("frame_rate_hz", "its current value", reason));
    }
    Ok(settings.frame_rate_hz.unwrap_or(0.0))
}

fn set_rate(device: &Device, wanted: f64) -> Result<(), String> {
    let aravis = device.aravis;
    let pointer = device.camera.as_ptr();
    let (least, most) = device.rate_range_hz()?;
    check_real(wanted, least, most)?;
    // SAFETY: an open camera.
    checked(aravis, |error| unsafe { aravis.arv_camera_set_frame_rate(pointer, wanted, error) })?;
    let kept = device.ask(aravis.arv_camera_get_frame_rate)?;
    if is_near(wanted, kept) { Ok(()) } else { Err(format!("the camera keeps {kept}")) }
}

impl Device {
    /// Calls what leaves the trigger selector at the last of its words, and turns it back.
    fn with_trigger_selector_kept(&self, act: impl FnOnce() -> Result<(), String>) -> Result<(), String> {
        let before = self.text("TriggerSelector").ok();
        act()?;
        before.map_or(Ok(()), |before| self.set_text("TriggerSelector", &before))
    }

    /// Lowest and highest frame rate at the present settings.
    pub(super) fn rate_range_hz(&self) -> Result<(f64, f64), String> {
        let (aravis, pointer) = (self.aravis, self.camera.as_ptr());
        let (mut least, mut most) = (0.0, 0.0);
        // SAFETY: an open camera and two numbers of ours to write to.
        checked(aravis, |error| unsafe {
            aravis.arv_camera_get_frame_rate_bounds(pointer, &raw mut least, &raw mut most, error);
        })?;
        Ok((least, most))
    }
}

fn set_trigger(device: &Device, source: &str) -> Result<(), String> {
    let sources = device.words("TriggerSource")?;
    if !sources.iter().any(|known| known == source) {
        return Err(format!("allowed {}", sources.join(", ")));
    }
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

/// Bytes that come with each frame: its pixels, and behind them only what chunk data is made of.
///
/// # Errors
///
/// [`CameraError::Setting`] when the camera sends something else.
pub fn payload_bytes(device: &Device, stream: &StreamFormat, has_chunks: bool) -> Result<usize, CameraError> {
    let refused = |value: String, reason: String| setting("PayloadSize", value, reason);
    let payload = device
        .ask(device.aravis.arv_camera_get_payload)
        .map_err(|reason| refused("its current value".into(), reason))?;
    let pixels = stream.slot_bytes();
    match payload as usize {
        bytes if bytes == pixels && !has_chunks => Ok(bytes),
        bytes if (pixels + 1..=pixels + MAX_CHUNKS_BYTES).contains(&bytes) && has_chunks => Ok(bytes),
        _ if has_chunks => {
            let reason = format!("a frame has {pixels} bytes, and up to {MAX_CHUNKS_BYTES} of chunk data behind them");
            Err(refused(payload.to_string(), reason))
        }
        _ => Err(refused(payload.to_string(), format!("a frame has {pixels} bytes: switch padding off"))),
    }
}
