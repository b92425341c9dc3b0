//! What a rig asks of a GenICam camera.

use crate::config::{self, FeatureValue};
use crate::image::PixelFormat;
use std::collections::BTreeMap;

/// How to find a GenICam camera and what to set on it.
///
/// What is not given stays as the camera has it, except that triggers are switched
/// off when neither `trigger_source` nor a `Trigger...` feature is given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GenicamSettings {
    /// IPv4 address, serial number or device id; empty for the first camera found.
    pub id: String,
    /// Pixels a row.
    pub width_px: Option<u32>,
    /// Rows.
    pub height_px: Option<u32>,
    /// First column of the sensor.
    pub offset_x_px: Option<u32>,
    /// First row of the sensor.
    pub offset_y_px: Option<u32>,
    /// Pixel layout.
    pub pixel_format: Option<PixelFormat>,
    /// Frames a second; with a trigger the greatest rate expected.
    pub frame_rate_hz: Option<f64>,
    /// Exposure time, us.
    pub exposure_us: Option<f64>,
    /// Whether a tone curve of the camera is known, and taken out of what it delivers.
    pub is_tone_known: bool,
    /// What starts a frame: `Software`, or a line such as `Line1`; none for the camera's own clock.
    pub trigger_source: Option<String>,
    /// Further features by their GenICam name, or `Name[Selector=Word]` for one of several behind a selector.
    pub features: BTreeMap<String, FeatureValue>,
    /// Bytes of one packet, IP header included (GigE Vision); the network card's and camera's largest, at most 16 000, when not given.
    pub packet_size_bytes: Option<u32>,
}

impl From<&config::Camera> for GenicamSettings {
    fn from(camera: &config::Camera) -> Self {
        Self {
            id: camera.id.clone().unwrap_or_default(),
            width_px: camera.width_px,
            height_px: camera.height_px,
            offset_x_px: camera.offset_x_px,
            offset_y_px: camera.offset_y_px,
            pixel_format: camera.pixel_format,
            frame_rate_hz: camera.frame_rate_hz,
            exposure_us: camera.exposure_us,
            is_tone_known: camera.gamma.total_cmp(&1.0).is_ne(),
            trigger_source: camera.trigger_source.clone(),
            features: camera.features.clone(),
            packet_size_bytes: camera.packet_size_bytes,
        }
    }
}
