//! What every camera keeps to, whatever it is.

use crate::fake_gige::{FakeGige, Wiring};
use crate::slots::Slots;
use ricochet::camera::genicam::GenicamCamera;
use ricochet::camera::{Camera, Next, Pace};
use ricochet::image::FrameMeta;
use std::collections::BTreeSet;
use std::time::Duration;

/// Waits without a frame after which a camera counts as stuck.
const WAITS: usize = 200;

/// Runs a camera over `frames` frames and checks all that its users rely on.
///
/// `known(sequence, pixels)` draws what the frame of this number must be.
///
/// # Panics
///
/// When the camera breaks the contract.
pub fn check(camera: Box<dyn Camera>, frames: u64, known: &dyn Fn(u64, &mut [u8])) {
    let format = camera.format();
    assert_eq!(camera.format(), format, "the format changed by itself");
    assert!(format.width_px > 0 && format.height_px > 0 && format.frame_rate_hz >= 0.0);
    assert!(camera.slots() > 0);
    let count = camera.slots() + 2;
    // Longer than a frame: a ring's slots are rounded up.
    let mut slots = Slots::new(count, format.slot_bytes() + 64);
    // Dropped before the slots, which it may still hold.
    let mut camera = camera;
    let camera = camera.as_mut();
    slots.queue_all(camera);
    camera.start().unwrap();
    let mut held: BTreeSet<usize> = (0..count).collect();
    let mut last: Option<FrameMeta> = None;
    let mut expected = vec![0; format.slot_bytes()];
    let (mut taken, mut waits) = (0, 0);
    while taken < frames {
        match camera.next(Duration::from_millis(100)).unwrap() {
            Next::Frame(mut slot, meta) => {
                assert!(held.remove(&slot.token()), "slot {} came twice", slot.token());
                check_meta(&meta, last.as_ref(), camera);
                known(meta.sequence, &mut expected);
                let (pixels, beyond) = slot.bytes_mut().split_at(meta.size_bytes());
                assert!(pixels == expected, "frame {} differs from what was sent", meta.sequence);
                assert!(beyond.iter().all(|byte| *byte == Slots::JUNK), "written beyond the frame");
                held.insert(slot.token());
                slots.give_back(slot, camera);
                (last, taken) = (Some(meta), taken + 1);
            }
            Next::Torn(slot, cause) => {
                assert!(held.remove(&slot.token()), "slot {} came twice", slot.token());
                assert!(!cause.is_empty());
                held.insert(slot.token());
                slots.give_back(slot, camera);
            }
            Next::Nothing => {
                waits += 1;
                assert!(waits < WAITS, "stuck after {taken} frames");
            }
            Next::End => panic!("the end after {taken} frames of {frames}"),
        }
    }
    assert_eq!(held.len(), count);
}

fn check_meta(meta: &FrameMeta, last: Option<&FrameMeta>, camera: &dyn Camera) {
    let format = camera.format();
    assert_eq!((meta.width_px, meta.height_px, meta.format), (format.width_px, format.height_px, format.format));
    assert!(meta.stride_bytes as usize >= meta.width_px as usize * meta.format.bytes_per_pixel());
    assert!(meta.size_bytes() <= format.slot_bytes());
    let Some(last) = last else { return };
    assert!(meta.sequence > last.sequence, "frame {} after {}", meta.sequence, last.sequence);
    assert!(meta.stamp_ns > last.stamp_ns, "stamps go back at frame {}", meta.sequence);
    assert!(meta.device_ns == 0 || meta.device_ns > last.device_ns, "the camera's clock goes back");
    assert!(meta.epoch == last.epoch);
    assert!(camera.pace() == Pace::Live || meta.sequence == last.sequence + 1, "a camera that waits lost a frame");
}

#[test]
fn a_genicam_camera_keeps_the_contract() {
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, crate::genicam::draw) else { return };
    let camera = GenicamCamera::open(&crate::genicam::settings(200.0)).unwrap();
    check(Box::new(camera), 200, &crate::genicam::draw);
}
