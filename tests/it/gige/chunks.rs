//! Chunk data behind each image, by which frames are timed and counted.

use super::camera::{CHUNK_LATER_NS, FRAME_BYTES, Gige, stamp_ns};
use super::take::Eye;
use crate::camera_contract;
use ricochet::camera::Camera;
use ricochet::camera::genicam::{FeatureValue, GenicamCamera};
use ricochet::config;

/// Settings that switch these chunks on.
fn with_chunks(gige: &Gige, chunks: &[&str]) -> config::Camera {
    let on = FeatureValue::Bool(true);
    let mut features: std::collections::BTreeMap<_, _> =
        chunks.iter().map(|chunk| (format!("ChunkEnable[ChunkSelector={chunk}]"), on.clone())).collect();
    features.insert("ChunkModeActive".into(), on);
    config::Camera { features, ..gige.settings() }
}

#[test]
fn a_camera_with_chunks_keeps_the_contract() {
    let Some(gige) = Gige::plug_in() else { return };
    std::thread::scope(|scope| {
        let checked = scope.spawn(|| {
            let camera = GenicamCamera::open(&with_chunks(&gige, &["FrameID", "Timestamp"])).unwrap();
            let waited = camera_contract::check(Box::new(camera), 100, &crate::genicam::draw);
            assert!(waited >= camera_contract::AWAY / 2, "{waited:?}");
        });
        let mut index = 0;
        while !checked.is_finished() {
            if gige.is_started() {
                gige.send(&gige.frame(1 + index, index));
                index += 1;
            }
        }
    });
}

#[test]
fn frames_are_timed_by_their_chunk_and_have_the_size_of_their_pixels() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&with_chunks(&gige, &["FrameID", "Timestamp"]));
    assert_eq!(eye.camera.format().slot_bytes(), FRAME_BYTES);
    for index in 0..20 {
        gige.send(&gige.frame(1 + index, index));
    }
    let taken = eye.take(20);
    assert_eq!((taken.torn.clone(), taken.indices()), (vec![], (0..20).collect()));
    for (meta, index) in &taken.whole {
        assert_eq!((meta.sequence, meta.device_ns), (*index, stamp_ns(*index) + CHUNK_LATER_NS));
    }
}

#[test]
fn without_a_timestamp_chunk_the_time_is_that_of_the_header() {
    let Some(gige) = Gige::plug_in() else { return };
    for chunks in [&["FrameID"][..], &[]] {
        let mut eye = Eye::open(&with_chunks(&gige, chunks));
        gige.send(&gige.frame(1, 5));
        let taken = eye.take(1);
        assert_eq!((taken.torn.clone(), taken.whole[0].0.device_ns), (vec![], stamp_ns(5)));
        drop(eye);
        for register in [super::control::CHUNK_MODE, super::control::CHUNK_FRAME_ID] {
            gige.control().set(register, 0);
        }
    }
}

#[test]
fn frames_that_the_camera_never_sent_are_gaps() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&with_chunks(&gige, &["FrameID"]));
    // The block ids are consecutive.
    for (id, index) in [(1, 0), (2, 1), (3, 7), (4, 8)] {
        gige.send(&gige.frame(id, index));
    }
    assert_eq!(eye.take(4).places(), [(0, 0), (1, 1), (7, 7), (8, 8)]);
}

#[test]
fn the_previous_frame_sent_as_a_new_one_is_torn() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&with_chunks(&gige, &["FrameID"]));
    for (id, index) in [(1, 0), (2, 1), (3, 1), (4, 3)] {
        gige.send(&gige.frame(id, index));
    }
    let taken = eye.take(4);
    assert_eq!(taken.places(), [(0, 0), (1, 1), (3, 3)]);
    assert_eq!(taken.torn, ["frame id 3: its own counter repeats that of the previous frame"]);
}

#[test]
fn missing_damaged_or_contradictory_chunks_make_a_frame_torn() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&with_chunks(&gige, &["FrameID", "Timestamp"]));
    let tail = FRAME_BYTES + 8;
    type Change = fn(&mut Vec<u8>, usize);
    let changes: [(Change, &str); 6] = [
        (|payload, tail| payload.truncate(tail - 8), "inconsistent chunk sizes"),
        (|payload, tail| payload.truncate(tail), "ChunkFrameID: "),
        (|payload, tail| payload[tail + 8] ^= 1, "ChunkFrameID: "),
        (|payload, _| *payload.last_mut().unwrap() = 9, "inconsistent chunk sizes"),
        (|payload, _| drop(payload.splice(..0, [0; 16])), "an image of 0 bytes instead of 8192"),
        (
            |payload, tail| payload[tail + 16] ^= 1,
            "ChunkTimestamp is 72057654049928186 ns, but the header has 60012000000 ns",
        ),
    ];
    for (at, (change, reason)) in changes.iter().enumerate() {
        let id = 1 + 2 * at as u64;
        gige.send(&gige.frame(id, id));
        let mut picture = gige.picture(id + 1, id + 1);
        change(&mut picture.payload, tail);
        gige.send(&gige.cut(&picture));
        let taken = eye.take(2);
        assert_eq!(taken.indices(), [id], "{:?}", taken.torn);
        let message = taken.torn.join("; ");
        assert!(message.contains(reason), "change {at}: {message}");
    }
}

#[test]
fn lost_packets_of_chunks_are_requested_again() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&with_chunks(&gige, &["FrameID", "Timestamp"]));
    for index in 0..10 {
        let mut packets = gige.frame(1 + index, index);
        // The last packet of the payload holds the chunks.
        packets.remove(packets.len() - 2);
        gige.send(&packets);
    }
    let taken = eye.take(10);
    assert_eq!((taken.torn.clone(), taken.indices()), (vec![], (0..10).collect()));
    assert!(taken.whole.iter().all(|(meta, index)| meta.device_ns == stamp_ns(*index) + CHUNK_LATER_NS));
}
