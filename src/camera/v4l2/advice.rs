//! What a camera does by itself that a measurement would rather not have, told once.

use super::apply::Applied;
use super::device::Device;
use super::layout::word;
use super::settings::V4l2Settings;
use super::sys;

/// The control's value that leaves grey levels as they are, by the USB video class.
const STRAIGHT: i64 = 100;

/// What to know of a camera that is set up, each a sentence.
pub(super) fn advice(device: &Device, applied: &Applied, settings: &V4l2Settings) -> Vec<String> {
    let mut advice = Vec::new();
    let layout = applied.shape.layout;
    if layout.is_compressed() {
        advice.push(format!(
            "pictures come compressed ({}), since no other format has this size and rate: what is lost of the speckles \
             is scatter of the displacements; smaller or slower pictures may come whole",
            word(layout.fourcc)
        ));
    }
    let automatic = device.automatic();
    if !automatic.is_empty() {
        let exposure = device.number(sys::V4L2_CID_EXPOSURE_AUTO).map_or("", |_| "; exposure_us sets a fixed exposure");
        advice.push(format!(
            "the camera adjusts {} by itself, in the middle of a shot too: set what it offers for fixed values under \
             [camera.features]{exposure}",
            automatic.join(", ")
        ));
    }
    let is_manual = device.number(sys::V4L2_CID_EXPOSURE_AUTO) == Some(i64::from(sys::V4L2_EXPOSURE_MANUAL));
    if !is_manual && device.number(sys::V4L2_CID_EXPOSURE_AUTO_PRIORITY) == Some(1) {
        advice.push(
            "in the dark the camera takes fewer frames than it was set to: set exposure_us, or \
             exposure_dynamic_framerate = false under [camera.features]"
                .into(),
        );
    }
    let gamma = device.number(sys::V4L2_CID_GAMMA).filter(|gamma| *gamma != STRAIGHT && !settings.is_tone_known);
    if let Some(gamma) = gamma {
        advice.push(format!(
            "its control gamma stands at {gamma}, where {STRAIGHT} mostly leaves grey levels as they are: edges of bodies lie \
             elsewhere then; set gamma = {STRAIGHT} under [camera.features], or the exponent as camera.gamma"
        ));
    }
    if !settings.is_shutter_known {
        advice.push(format!(
            "the shutter of such a camera mostly rolls, row by row: what falls {:.0} px a frame is measured by up to 1 % too \
             fast then, and what rises too slow; tell camera.row_time_us (0 of one that opens for all rows at once)",
            0.01 * f64::from(applied.shape.height_px)
        ));
    }
    advice
}
