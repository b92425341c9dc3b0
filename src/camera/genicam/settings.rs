//! The settings of a GenICam camera.

use crate::config::{self, FeatureValue};
use crate::image::PixelFormat;
use std::collections::BTreeMap;

/// The id of a GenICam camera and its settings.
///
/// Settings that are not given stay unchanged, except that triggers are disabled if neither `trigger_source` nor a
/// `Trigger...` feature is given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GenicamSettings {
    /// IPv4 address, serial number or device id; empty for the first camera found.
    pub id: String,
    /// Image width, px.
    pub width_px: Option<u32>,
    /// Image height, px.
    pub height_px: Option<u32>,
    /// Left column of the region of interest on the sensor, px.
    pub offset_x_px: Option<u32>,
    /// Top row of the region of interest on the sensor, px.
    pub offset_y_px: Option<u32>,
    /// Pixel format.
    pub pixel_format: Option<PixelFormat>,
    /// Frame rate, Hz; with a trigger the maximum rate expected.
    pub frame_rate_hz: Option<f64>,
    /// Exposure time, us.
    pub exposure_us: Option<f64>,
    /// Whether the camera's gamma is configured and thus corrected for.
    pub is_tone_known: bool,
    /// Frame trigger: `Software`, or a line such as `Line1`; `None` for the camera's own clock.
    pub trigger_source: Option<String>,
    /// Further features by their GenICam name, or `Name[Selector=Word]` behind a selector.
    pub features: BTreeMap<String, FeatureValue>,
    /// Packet size including the IP header (GigE Vision), bytes. The default is the maximum of network card and
    /// camera, at most 16 000.
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
