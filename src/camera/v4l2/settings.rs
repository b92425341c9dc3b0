//! The settings of a V4L2 camera.

use crate::config::{self, FeatureValue};
use crate::image::PixelFormat;
use std::collections::BTreeMap;

/// The id of a V4L2 camera and its settings; settings that are not given stay unchanged.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct V4l2Settings {
    /// Device file, bus address, serial number or name of the camera; empty for the first camera found.
    pub id: String,
    /// Image width, px.
    pub width_px: Option<u32>,
    /// Image height, px.
    pub height_px: Option<u32>,
    /// Pixel format in the ring.
    pub pixel_format: Option<PixelFormat>,
    /// Frame rate, Hz; the expected rate if the driver cannot set one.
    pub frame_rate_hz: Option<f64>,
    /// Exposure time, us, in steps of 100 us.
    pub exposure_us: Option<f64>,
    /// Whether the camera's gamma is configured and thus corrected for.
    pub is_gamma_known: bool,
    /// Whether the row time is configured and a rolling shutter thus corrected for.
    pub is_row_time_known: bool,
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
            is_gamma_known: camera.gamma.total_cmp(&1.0).is_ne(),
            is_row_time_known: camera.row_time_us.is_some(),
            features: camera.features.clone(),
        }
    }
}
