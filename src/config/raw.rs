//! The rig file as it is written: names and types only, nothing checked.
//!
//! Every key is optional here, and numbers are as wide as in TOML. The next stage, which has the ranges, words every error.

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

/// The tables of one camera and its image.
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

/// One number or a list.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "a whole number or a list of them")]
pub(super) enum OneOrMore {
    One(i64),
    More(Vec<i64>),
}

/// Defines tables whose keys are all optional.
macro_rules! tables {
    ($($table:ident { $($key:ident: $type:ty,)* })*) => {$(
        #[derive(Debug, Default, Deserialize)]
        #[serde(deny_unknown_fields, default, expecting = "a table")]
        pub(super) struct $table { $(pub $key: Option<$type>,)* }
    )*};
}

tables! {
    RawRig { name: String, }
    RawCamera {
        source: String, id: String, scenario: String, paced: bool, playback_rate: f64, from_s: f64, to_s: f64,
        parts: Vec<String>, view: String, shift_ns: i64, stepped: bool, width_px: i64, height_px: i64,
        offset_x_px: i64, offset_y_px: i64, pixel_format: String, frame_rate_hz: f64, exposure_us: f64,
        gamma: f64, row_time_us: f64, defective_px: Vec<Vec<i64>>, trigger_source: String, pulse_period_s: f64,
        pulse_frames: i64, packet_size_bytes: i64, features: BTreeMap<String, toml::Value>,
    }
    RawScale { mm_per_px: f64, ball_diameter_mm: f64, }
    RawCalibration {
        file: String, image_px: Vec<i64>, offset_px: Vec<i64>, camera_matrix: Vec<f64>,
        distortion_model: String, distortion: Vec<f64>, homography_mm: Vec<f64>,
    }
    RawSurface { angle_deg: f64, edge: Vec<Vec<f64>>, }
    RawBody {
        name: String, kind: String, diameter_mm: f64, mass_kg: f64, min_radius_px: f64, max_radius_px: f64,
        outline: String, edges: i64, end_mm: f64, roi_px: Vec<i64>, polygon_px: Vec<Vec<f64>>,
        holes_px: Vec<Vec<Vec<f64>>>, center_px: Vec<f64>,
    }
    RawCorrelation {
        method: String, shape: String, window: String, subset_size_px: i64, step_px: i64, spline_points: i64,
        search_px: i64, interval_frames: OneOrMore, min_zncc: f64, interpolation: String,
    }
    RawRotation { method: String, ring_inner_px: f64, ring_outer_px: f64, }
    RawVelocity { window_frames: i64, order: i64, gravity_m_s2: f64, gravity_angle_deg: f64, }
    RawTrigger {
        mode: String, threshold_dn: f64, roi_px: Vec<i64>, body: String, speed_m_s: f64, gap_mm: f64,
        lead_s: f64, silence_s: f64, pre_s: f64, post_s: f64, quiet_s: f64, rearm: bool, command: Vec<String>,
        url: String, other_rig: String,
    }
    RawRecord {
        directory: String, compression: String, raw_frames: bool, ring_bytes_max: i64, keep_last: i64,
        max_bytes: i64, split_bytes: i64,
    }
    RawWorkers { count: i64, block_frames: i64, }
    RawServe { http: String, foxglove: String, token_file: String, }
    RawBridge { zenoh: toml::Value, }
}
