//! The contract of every camera.

use crate::fake_gige::{FakeGige, Wiring};
use crate::slots::Slots;
use ricochet::camera::genicam::GenicamCamera;
use ricochet::camera::replay::{Playback, PlaybackRate, ReplayCamera};
use ricochet::camera::simulated::SimulatedCamera;
use ricochet::camera::{Camera, Next, Pace};
use ricochet::image::{Frame, FrameMeta};
use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
use ricochet::synth::{Scenario, SimulatedFilm};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// The number of waits without a frame after which a camera counts as stuck.
const WAITS: usize = 200;

/// A pause of the receiver, longer than a frame.
pub const AWAY: Duration = Duration::from_millis(40);

/// Runs a camera over `frames` frames and checks all that its users rely on.
///
/// `known(sequence, pixels)` draws the expected frame of a number. Returns the longest time that a frame waited for its
/// receiver, as reported by the camera. The receiver pauses five times for [`AWAY`].
///
/// # Panics
///
/// When the camera breaks the contract.
#[expect(clippy::disallowed_methods, reason = "frames that wait, wait for some time")]
pub fn check(camera: Box<dyn Camera>, frames: u64, known: &dyn Fn(u64, &mut [u8])) -> Duration {
    let format = camera.format();
    assert_eq!(camera.format(), format, "the format changed by itself");
    assert!(format.width_px > 0 && format.height_px > 0 && format.frame_rate_hz >= 0.0);
    assert!(camera.slots() > 0);
    let count = camera.slots() + 2;
    // Longer than a frame, because the slots of a ring are rounded up.
    let mut slots = Slots::new(count, format.slot_bytes() + 64);
    // Dropped before the slots, which it may still hold.
    let mut camera = camera;
    let camera = camera.as_mut();
    slots.queue_all(camera);
    // A camera may deliver frames before `start` returns.
    let started = Instant::now();
    camera.start().unwrap();
    let mut held: BTreeSet<usize> = (0..count).collect();
    let mut last: Option<FrameMeta> = None;
    let mut expected = vec![0; format.slot_bytes()];
    let (mut taken, mut waits, mut waited) = (0, 0, Duration::ZERO);
    while taken < frames {
        if taken % (frames / 5).max(1) == 1 {
            std::thread::sleep(AWAY + Duration::from_secs_f64(1.0 / format.frame_rate_hz.max(10.0)));
        }
        match camera.next(Duration::from_millis(100)).unwrap() {
            Next::Frame(mut slot, meta) => {
                let wait = camera.frame_age();
                assert!(wait <= started.elapsed(), "a frame waited {wait:?}, since before the start");
                waited = waited.max(wait);
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
            Next::Incomplete(slot, cause) => {
                assert!(held.remove(&slot.token()), "slot {} came twice", slot.token());
                assert!(!cause.is_empty());
                held.insert(slot.token());
                slots.give_back(slot, camera);
            }
            Next::Timeout => {
                waits += 1;
                assert!(waits < WAITS, "stuck after {taken} frames");
            }
            Next::End => panic!("the end after {taken} frames of {frames}"),
        }
    }
    assert_eq!(held.len(), count);
    assert!(camera.pace() == Pace::Live || waited.is_zero(), "a camera that waits for its taker");
    waited
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
    assert!(camera.pace() == Pace::Live || meta.sequence == last.sequence + 1, "a camera on demand lost a frame");
}

#[test]
fn a_genicam_camera_keeps_the_contract() {
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, crate::genicam::draw) else { return };
    let camera = GenicamCamera::open(&crate::genicam::settings(200.0)).unwrap();
    let waited = check(Box::new(camera), 200, &crate::genicam::draw);
    assert!(waited >= AWAY / 2, "{waited:?}");
}

/// A moving ball in a small image.
fn small() -> Scenario {
    let mut scenario = Scenario::translation(0.7, -0.3, 0.5);
    let camera = &mut scenario.camera;
    (camera.width_px, camera.height_px, camera.frames, camera.frame_rate_hz) = (128, 96, 60, 200.0);
    scenario.body.diameter_mm = 25.0;
    scenario
}

#[test]
fn a_simulated_camera_keeps_the_contract() {
    for pace in [Pace::OnDemand, Pace::Live] {
        let camera = SimulatedCamera::open(small(), pace).unwrap();
        let world = SimulatedFilm::new(&small()).unwrap();
        let waited = check(Box::new(camera), 50, &|number, pixels| world.render(number, pixels));
        assert_eq!(waited >= AWAY / 2, pace == Pace::Live, "{waited:?}");
    }
}

#[test]
fn a_recording_keeps_the_contract_as_a_camera() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.mcap");
    let world = SimulatedFilm::new(&small()).unwrap();
    let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default()).unwrap();
    for number in 0..60 {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(number, &mut bytes);
        let meta = FrameMeta {
            sequence: number,
            stamp_ns: 1_700_000_000_000_000_000 + number * 5_000_000,
            width_px: 128,
            height_px: 96,
            stride_bytes: 128,
            ..FrameMeta::default()
        };
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    }
    writer.finish().unwrap();
    for rate in [PlaybackRate::Max, PlaybackRate::Times(1.0)] {
        let camera =
            ReplayCamera::new(Recording::open(&path).unwrap(), Playback { rate, ..Playback::default() }).unwrap();
        let waited = check(Box::new(camera), 50, &|number, pixels| world.render(number, pixels));
        assert_eq!(waited >= AWAY / 2, rate != PlaybackRate::Max, "{waited:?}");
    }
}
