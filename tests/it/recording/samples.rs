//! Frames and rows to write, with values that are easily corrupted.

use ricochet::image::{Frame, FrameMeta, PixelFormat};
use ricochet::recording::{Annotations, EventRow, RecordingInfo, RecordingWriter, StatusRow, WriterOptions};
use ricochet::results::{
    BodyVelocity, Displacement, Estimate, FieldPoint, ForceLaw, Impact, MotionSample, PairField, Phase, PointStatus,
    Rod, RodEdge, TrackSample, VelocitySample,
};
use std::collections::BTreeMap;
use std::path::Path;

/// 2026-01-01, with nanoseconds that seconds in f64 cannot hold.
pub const START_NS: u64 = 1_767_225_600_123_456_789;

const AWKWARD: [f64; 8] =
    [0.1, -0.0, f64::MIN_POSITIVE / 4.0, f64::MAX, -1.0 / 3.0, 1e-17, 123_456_789.012_345_67, f64::EPSILON];

pub fn number(seed: u64) -> f64 {
    AWKWARD[seed as usize % AWKWARD.len()]
}

/// A frame and its bytes, which are a fixed function of the sequence number.
pub fn frame(sequence: u64, format: PixelFormat, size: [u32; 2], padding: u32) -> (FrameMeta, Vec<u8>) {
    let stride_bytes = size[0] * format.bytes_per_pixel() as u32 + padding;
    let meta = FrameMeta {
        sequence,
        epoch: 3,
        stamp_ns: START_NS + sequence * 100_000,
        device_ns: 17 + sequence,
        width_px: size[0],
        height_px: size[1],
        stride_bytes,
        format,
    };
    let mut state = sequence.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let next = |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as u8
    };
    (meta, (0..meta.size_bytes()).map(next).collect())
}

pub fn velocity(frame: u64, body: u32) -> VelocitySample {
    let whole = !frame.is_multiple_of(3);
    let n = |k: u64| number(frame + k);
    VelocitySample {
        frame,
        body,
        stamp_ns: START_NS + frame * 100_000,
        center_x_px: whole.then(|| n(0)),
        center_y_px: Some(n(1)),
        radius_px: None,
        motion: whole.then(|| MotionSample {
            dx_px: n(2),
            dy_px: n(3),
            dtheta_deg: (!frame.is_multiple_of(5)).then(|| n(4)),
            sigma_dx_px: n(5),
            sigma_dy_px: n(6),
            sigma_dtheta_deg: (!frame.is_multiple_of(5)).then(|| n(7)),
            points: frame as u32,
        }),
        velocity: (frame.is_multiple_of(2)).then(|| BodyVelocity {
            vx_m_s: n(8),
            vy_m_s: n(9),
            vn_m_s: n(10),
            vt_m_s: n(11),
            omega_rad_s: (!frame.is_multiple_of(5)).then(|| n(12)),
            sigma_v_m_s: n(13),
            sigma_omega_rad_s: (!frame.is_multiple_of(5)).then(|| n(14)),
            window_frames: 9,
            order: 2,
        }),
        visible_fraction: Some(1.0),
        phase: Phase::ALL[frame as usize % 4],
        rotation_status: PointStatus::ALL[frame as usize % 7],
        status: PointStatus::ALL[frame as usize % 8],
    }
}

pub fn track(frame: u64) -> TrackSample {
    let n = |k: u64| (!(frame + k).is_multiple_of(3)).then(|| number(frame + k));
    TrackSample {
        frame,
        body: 1,
        stamp_ns: START_NS + frame * 100_000,
        center_x_px: n(0),
        center_y_px: n(1),
        angle_deg: n(2),
        radius_px: n(3),
        sigma_center_px: n(4),
        sigma_angle_deg: n(5),
        visible_fraction: n(6),
        // None in short films, whose tables are those of a ball.
        rod: (frame >= 8 && frame.is_multiple_of(2)).then(|| rod(frame)),
        status: PointStatus::ALL[frame as usize % 8],
    }
}

fn rod(frame: u64) -> Rod {
    let estimate = |k: u64| Estimate { value: number(frame + k), sigma: number(frame + k + 1) };
    let edge = |k: u64| RodEdge {
        y_px: (!(frame + k).is_multiple_of(3)).then(|| estimate(k)),
        status: PointStatus::ALL[(frame + k) as usize % 8],
    };
    Rod {
        x_px: estimate(20),
        y_px: estimate(22),
        half_width_px: estimate(24),
        tilt_deg: estimate(26),
        edges: [Some(edge(0)), Some(edge(1)), Some(edge(2)), (frame.is_multiple_of(4)).then(|| edge(3))],
    }
}

pub fn field(frame: u64) -> PairField {
    let point = |i: u64| FieldPoint {
        x_px: i as f32 * 16.0,
        y_px: 0.1,
        displacement: (!i.is_multiple_of(3)).then(|| Displacement {
            u_px: f32::MIN_POSITIVE / 2.0,
            v_px: -0.0,
            sigma_u_px: 1.0 / 3.0,
            sigma_v_px: i as f32 * 1e-3,
        }),
        zncc: (!i.is_multiple_of(2)).then_some(0.987_654_3),
        peak_ratio: i.is_multiple_of(5).then_some(f32::MAX),
        status: PointStatus::ALL[i as usize % 8],
    };
    PairField {
        frame,
        target_frame: frame + 1,
        stamp_ns: START_NS + frame * 100_000,
        body: 0,
        points: (0..24).map(point).collect(),
    }
}

pub fn impact(number_of: u32, revision: u32) -> Impact {
    let estimate = |k: u64| Some(Estimate { value: number(k), sigma: number(k + 3) });
    Impact {
        revision,
        start_s: Some(Estimate { value: 0.0125, sigma: 1e-6 }),
        deepest_s: None,
        end_s: estimate(1),
        vn_before_m_s: estimate(2),
        vn_after_m_s: estimate(3),
        vt_before_m_s: estimate(4),
        vt_after_m_s: estimate(5),
        omega_before_rad_s: estimate(6),
        omega_after_rad_s: None,
        restitution: Some(Estimate { value: 0.61 + f64::from(revision), sigma: 0.01 }),
        restitution_tangential: estimate(9),
        impulse_ratio: estimate(10),
        contact_time_s: estimate(11),
        compression_max_mm: estimate(12),
        acceleration_max_m_s2: estimate(13),
        slip_end_s: None,
        force_law: ForceLaw::HuntCrossley,
        force_law_probability: Some(number(14)),
        status: PointStatus::Valid,
        ..Impact::unknown(0, number_of, START_NS)
    }
}

pub fn event(k: u64) -> EventRow {
    EventRow { stamp_ns: START_NS + k, kind: "trigger".into(), text: format!("by hand, \"{k}\"") }
}

pub fn status(k: u64) -> StatusRow {
    let readings = [("ring_fill".to_owned(), Some(number(k))), ("latency_p99_us".to_owned(), None)];
    StatusRow {
        stamp_ns: START_NS + k,
        process: "acquire".into(),
        state: "armed".into(),
        readings: readings.into_iter().collect(),
    }
}

pub fn info() -> RecordingInfo {
    RecordingInfo {
        config_toml: "[rig]\nname = \"test\"\n".into(),
        metadata: BTreeMap::from([("version".into(), "0.1.0".into()), ("camera".into(), "simulated".into())]),
        bodies: vec!["ball".into(), "racket".into()],
        attachments: vec![("calibration.json".into(), "application/json".into(), b"{}".to_vec())],
        views: Vec::new(),
    }
}

/// Writes a shot of `frames` frames with all kinds of rows and returns the writer, unfinished.
pub fn write(path: &Path, options: &WriterOptions, frames: u64, size: [u32; 2]) -> RecordingWriter {
    let mut writer = RecordingWriter::create(path, &info(), options).unwrap();
    for sequence in 0..frames {
        let (meta, bytes) = frame(sequence, PixelFormat::Mono8, size, 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        writer.write_velocity(&velocity(sequence, 0)).unwrap();
        writer.write_truth(&velocity(sequence, 1)).unwrap();
        writer.write_track(&track(sequence)).unwrap();
        writer.write_field(&field(sequence)).unwrap();
    }
    writer.write_impact(&impact(0, 0)).unwrap();
    writer.write_truth_impact(&impact(0, 1)).unwrap();
    writer.write_event(&event(0)).unwrap();
    writer.write_status(&status(0)).unwrap();
    let annotations = Annotations { circles: vec![[1.0, 2.0, 3.0]], vectors: vec![[[0.0, 0.0], [1.0, 1.0]]] };
    writer.write_annotations(START_NS, &annotations).unwrap();
    writer
}
