//! Warnings about automatic adjustments and image processing in the camera that disturb a measurement.

use super::apply::Applied;
use super::device::Device;
use super::pixel_layout::fourcc_text;
use super::sys;
use crate::camera::feature_setting::is_linear;
use crate::config;

/// The gamma control's value for a linear response, by the USB video class.
const LINEAR_GAMMA: i64 = 100;

/// Returns the warnings for a configured camera; empty if none applies.
///
/// They concern compressed images, automatic adjustments, a rate that falls in the dark, a gamma that is not corrected,
/// and an unknown row time of the shutter.
pub(super) fn warnings(device: &Device, applied: &Applied, settings: &config::Camera) -> Vec<String> {
    let mut warnings = Vec::new();
    let layout = applied.buffer.layout;
    if layout.is_compressed() {
        warnings.push(format!(
            "images are compressed ({}) because no other format has this size and rate; the lost speckle detail adds \
                     scatter to displacements; a smaller size or a lower rate may be available without compression",
            fourcc_text(layout.fourcc)
        ));
    }
    let automatic = device.active_auto_controls();
    if !automatic.is_empty() {
        let exposure = device.number(sys::V4L2_CID_EXPOSURE_AUTO).map_or("", |_| "; exposure_us sets a fixed exposure");
        warnings.push(format!(
            "the camera adjusts {} automatically, even during a shot: set its controls for fixed values under \
                     [camera.features]{exposure}",
            automatic.join(", ")
        ));
    }
    let is_manual = device.number(sys::V4L2_CID_EXPOSURE_AUTO) == Some(i64::from(sys::V4L2_EXPOSURE_MANUAL));
    if !is_manual && device.number(sys::V4L2_CID_EXPOSURE_AUTO_PRIORITY) == Some(1) {
        warnings.push(
                    "in the dark the camera lowers its frame rate: set exposure_us, or exposure_dynamic_framerate = false under \
                     [camera.features]"
                .into(),
        );
    }
    let gamma = device.number(sys::V4L2_CID_GAMMA).filter(|gamma| *gamma != LINEAR_GAMMA && is_linear(settings));
    if let Some(gamma) = gamma {
        warnings.push(format!(
            "its control gamma is {gamma}, but usually only {LINEAR_GAMMA} is linear, and any other value displaces \
                     edges; set gamma = {LINEAR_GAMMA} under [camera.features], or the exponent as camera.gamma"
        ));
    }
    if settings.row_time_us.is_none() {
        warnings.push(format!(
            "such cameras usually have a rolling shutter: the speed of what falls {:.0} px per frame is up to 1 % too \
                     high, and of what rises too low; set camera.row_time_us (0 for a global shutter)",
            0.01 * f64::from(applied.buffer.size.height_px)
        ));
    }
    warnings
}
