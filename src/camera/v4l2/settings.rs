//! What a rig asks of a V4L2 camera.

use crate::config::{self, FeatureValue};
use crate::image::PixelFormat;
use std::collections::BTreeMap;

/// How to find a V4L2 camera and what to set on it; what is not given stays as the driver has it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct V4l2Settings {
    /// Device file, place on the bus, serial number or name of the camera; empty for the first one found.
    pub id: String,
    /// Pixels a row.
    pub width_px: Option<u32>,
    /// Rows.
    pub height_px: Option<u32>,
    /// Pixel layout wanted in the ring.
    pub pixel_format: Option<PixelFormat>,
    /// Frames a second; of a driver that cannot set a rate, the rate to expect.
    pub frame_rate_hz: Option<f64>,
    /// Exposure time, us, in steps of 100 us.
    pub exposure_us: Option<f64>,
    /// Whether a tone curve of the camera is known, and taken out of what it delivers.
    pub is_tone_known: bool,
    /// Whether it is known when the camera exposes each row, and taken out of what is measured.
    pub is_shutter_known: bool,
    /// Further controls by name, lower-case with `_` between words.
    pub features: BTreeMap<String, FeatureValue>,
}

impl From<&config::Camera> for V4l2Settings {
    fn from(camera: &config::Camera) -> Self {
        Self {
            id: camera.id.clone().unwrap_or_default(),
            width_px: camera.width_px,
            height_px: camera.height_px,
            pixel_format: camera.pixel_format,
            frame_rate_hz: camera.frame_rate_hz,
            exposure_us: camera.exposure_us,
            is_tone_known: camera.gamma.total_cmp(&1.0).is_ne(),
            is_shutter_known: camera.row_time_us.is_some(),
            features: camera.features.clone(),
        }
    }
}
