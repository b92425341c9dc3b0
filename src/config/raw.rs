//! The rig file as it is spelled: names and types only, nothing checked.
//!
//! Every key is optional here and numbers are as wide as TOML has them, so that
//! the next stage, which knows the ranges, words every refusal.

use serde::Deserialize;
use std::collections::BTreeMap;

/// The whole file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "tables")]
pub(super) struct RawConfig {
    pub rig: RawRig,
    pub camera: RawCamera,
    pub scale: RawScale,
    pub surface: RawSurface,
    pub calibration: Option<RawCalibration>,
    pub body: Vec<RawBody>,
    pub correlation: RawCorrelation,
    pub rotation: RawRotation,
    pub velocity: RawVelocity,
    pub trigger: RawTrigger,
    pub record: Option<RawRecord>,
    pub workers: RawWorkers,
    pub view: BTreeMap<String, RawView>,
    pub serve: Option<RawServe>,
    pub bridge: Option<RawBridge>,
}

/// What belongs to one camera and its picture.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "tables")]
pub(super) struct RawView {
    pub camera: RawCamera,
    pub scale: RawScale,
    pub surface: RawSurface,
    pub calibration: Option<RawCalibration>,
    pub body: Vec<RawBody>,
    pub correlation: RawCorrelation,
    pub rotation: RawRotation,
    pub velocity: RawVelocity,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawRig {
    pub name: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawCamera {
    pub source: Option<String>,
    pub id: Option<String>,
    pub scenario: Option<String>,
    pub paced: Option<bool>,
    pub playback_rate: Option<f64>,
    pub from_s: Option<f64>,
    pub to_s: Option<f64>,
    pub parts: Option<Vec<String>>,
    pub view: Option<String>,
    pub shift_ns: Option<i64>,
    pub stepped: Option<bool>,
    pub width_px: Option<i64>,
    pub height_px: Option<i64>,
    pub offset_x_px: Option<i64>,
    pub offset_y_px: Option<i64>,
    pub pixel_format: Option<String>,
    pub frame_rate_hz: Option<f64>,
    pub exposure_us: Option<f64>,
    pub gamma: Option<f64>,
    pub row_time_us: Option<f64>,
    pub defective_px: Option<Vec<Vec<i64>>>,
    pub trigger_source: Option<String>,
    pub pulse_period_s: Option<f64>,
    pub pulse_frames: Option<i64>,
    pub packet_size_bytes: Option<i64>,
    pub features: BTreeMap<String, toml::Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawScale {
    pub mm_per_px: Option<f64>,
    pub ball_diameter_mm: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawCalibration {
    pub file: Option<String>,
    pub image_px: Option<Vec<i64>>,
    pub offset_px: Option<Vec<i64>>,
    pub camera_matrix: Option<Vec<f64>>,
    pub distortion_model: Option<String>,
    pub distortion: Option<Vec<f64>>,
    pub homography_mm: Option<Vec<f64>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawSurface {
    pub angle_deg: Option<f64>,
    pub edge: Option<Vec<Vec<f64>>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawBody {
    pub name: Option<String>,
    pub kind: Option<String>,
    pub diameter_mm: Option<f64>,
    pub mass_kg: Option<f64>,
    pub min_radius_px: Option<f64>,
    pub max_radius_px: Option<f64>,
    pub outline: Option<String>,
    pub edges: Option<i64>,
    pub end_mm: Option<f64>,
    pub roi_px: Option<Vec<i64>>,
    pub polygon_px: Option<Vec<Vec<f64>>>,
    pub holes_px: Option<Vec<Vec<Vec<f64>>>>,
    pub center_px: Option<Vec<f64>>,
}

/// A number or a list of them.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "a whole number or a list of them")]
pub(super) enum OneOrMore {
    One(i64),
    More(Vec<i64>),
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawCorrelation {
    pub method: Option<String>,
    pub shape: Option<String>,
    pub window: Option<String>,
    pub subset_size_px: Option<i64>,
    pub step_px: Option<i64>,
    pub spline_points: Option<i64>,
    pub search_px: Option<i64>,
    pub interval_frames: Option<OneOrMore>,
    pub min_zncc: Option<f64>,
    pub interpolation: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawRotation {
    pub method: Option<String>,
    pub ring_inner_px: Option<f64>,
    pub ring_outer_px: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawVelocity {
    pub window_frames: Option<i64>,
    pub order: Option<i64>,
    pub gravity_m_s2: Option<f64>,
    pub gravity_angle_deg: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawTrigger {
    pub mode: Option<String>,
    pub threshold_dn: Option<f64>,
    pub roi_px: Option<Vec<i64>>,
    pub body: Option<String>,
    pub speed_m_s: Option<f64>,
    pub gap_mm: Option<f64>,
    pub lead_s: Option<f64>,
    pub silence_s: Option<f64>,
    pub pre_s: Option<f64>,
    pub post_s: Option<f64>,
    pub quiet_s: Option<f64>,
    pub rearm: Option<bool>,
    pub command: Option<Vec<String>>,
    pub url: Option<String>,
    pub other_rig: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawRecord {
    pub directory: Option<String>,
    pub compression: Option<String>,
    pub raw_frames: Option<bool>,
    pub ring_bytes_max: Option<i64>,
    pub keep_last: Option<i64>,
    pub max_bytes: Option<i64>,
    pub split_bytes: Option<i64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawWorkers {
    pub count: Option<i64>,
    pub block_frames: Option<i64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawServe {
    pub http: Option<String>,
    pub foxglove: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table")]
pub(super) struct RawBridge {
    pub zenoh: Option<toml::Value>,
}
