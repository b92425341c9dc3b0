//! The GenICam back end against a GigE camera on 127.0.0.1: real control and stream packets.
#![expect(clippy::disallowed_methods, reason = "waiting has a deadline")]

use crate::fake_gige::{ADDRESS, FakeGige, Wiring, aravis_or_leave_out};
use crate::support::camera_settings;
use ricochet::camera::genicam::{GenicamCamera, list};
use ricochet::camera::{Camera, CameraError, Next};
use ricochet::config;
use ricochet::image::{FrameMeta, PixelFormat};
use std::time::{Duration, Instant};

use crate::slots::Slots;

const SIZE_PX: u32 = 512;
const FRAME_BYTES: usize = (SIZE_PX * SIZE_PX) as usize;

/// The longest wait of a failing test for a frame.
const PATIENCE: Duration = Duration::from_secs(20);

/// 512x512 Mono8 at this rate.
pub fn settings(frame_rate_hz: f64) -> config::Camera {
    config::Camera {
        id: Some(ADDRESS.into()),
        width_px: Some(SIZE_PX),
        height_px: Some(SIZE_PX),
        pixel_format: Some(PixelFormat::Mono8),
        frame_rate_hz: Some(frame_rate_hz),
        exposure_us: Some(100.0),
        ..camera_settings()
    }
}

/// Draws frame `index`: its number, then noise that depends on the number in every byte.
pub fn draw(index: u64, pixels: &mut [u8]) {
    let mut state = index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for word in pixels.chunks_mut(8) {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let noise = state.to_le_bytes();
        word.copy_from_slice(&noise[..word.len()]);
    }
    pixels[..8].copy_from_slice(&index.to_le_bytes());
}

/// Frames received until there were enough or the time was up.
struct Shot {
    whole: Vec<(FrameMeta, u64)>,
    torn: Vec<String>,
}

/// Receives frames and compares each complete one byte for byte with the one that was sent.
fn take(camera: &mut GenicamCamera, slots: &mut Slots, frames: usize) -> Shot {
    let mut shot = Shot { whole: Vec::new(), torn: Vec::new() };
    let mut expected = vec![0; FRAME_BYTES];
    let deadline = Instant::now() + PATIENCE;
    while shot.whole.len() + shot.torn.len() < frames && Instant::now() < deadline {
        match camera.next(Duration::from_millis(200)).unwrap() {
            Next::Frame(mut slot, meta) => {
                let pixels = &slot.bytes_mut()[..meta.size_bytes()];
                let index = u64::from_le_bytes(pixels[..8].try_into().unwrap());
                draw(index, &mut expected);
                assert!(pixels == expected, "frame {index} differs from the frame that was sent");
                shot.whole.push((meta, index));
                slots.give_back(slot, camera);
            }
            Next::Incomplete(slot, cause) => {
                shot.torn.push(cause);
                slots.give_back(slot, camera);
            }
            Next::Timeout => {}
            Next::End => break,
        }
    }
    shot
}

#[test]
fn frames_are_bit_exact_and_in_order_across_the_wrap_of_their_ids() {
    const FRAMES: usize = 300;
    let Some(gige) = FakeGige::plug_in(Wiring::Software, FRAMES as u64, draw) else { return };
    let mut slots = Slots::new(128, FRAME_BYTES);
    let mut camera = GenicamCamera::open(&settings(250.0)).unwrap();
    assert_eq!(camera.format().slot_bytes(), FRAME_BYTES);
    assert_eq!(camera.identity().serial, "R1");
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    let shot = take(&mut camera, &mut slots, FRAMES);
    assert_eq!(shot.torn, Vec::<String>::new());
    assert_eq!(gige.sent(), FRAMES as u64);
    // The imitated camera's block ids begin at 65401, so 300 frames cross the wrap.
    let indices: Vec<_> = shot.whole.iter().map(|(meta, index)| (meta.sequence, *index)).collect();
    let wanted: Vec<_> = (0..FRAMES as u64).map(|index| (index, index)).collect();
    assert_eq!(indices, wanted);
    for pair in shot.whole.windows(2) {
        assert!(pair[1].0.device_ns > pair[0].0.device_ns && pair[1].0.stamp_ns > pair[0].0.stamp_ns);
    }
    // The camera uses the host's clock, so its own stamps are kept.
    assert!(shot.whole.iter().all(|(meta, _)| meta.stamp_ns == meta.device_ns));
    assert!(matches!(camera.next(Duration::from_millis(50)).unwrap(), Next::Timeout));
}

fn triggered(wiring: Wiring, source: &str, fire: impl Fn(&FakeGige, &GenicamCamera)) {
    const PULSES: u64 = 20;
    let Some(gige) = FakeGige::plug_in(wiring, u64::MAX, draw) else { return };
    let mut slots = Slots::new(32, FRAME_BYTES);
    // Small packets, because a socket buffer of the usual size cannot hold the first frame.
    let wanted =
        config::Camera { trigger_source: Some(source.into()), packet_size_bytes: Some(1440), ..settings(100.0) };
    let mut camera = GenicamCamera::open(&wanted).unwrap();
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    assert!(matches!(camera.next(Duration::from_millis(300)).unwrap(), Next::Timeout), "a frame without a pulse");
    for pulse in 0..PULSES {
        fire(&gige, &camera);
        let shot = take(&mut camera, &mut slots, 1);
        assert_eq!(shot.torn, Vec::<String>::new());
        assert_eq!((shot.whole[0].0.sequence, shot.whole[0].1), (pulse, pulse));
    }
    assert!(matches!(camera.next(Duration::from_millis(300)).unwrap(), Next::Timeout), "more frames than pulses");
    assert_eq!(gige.sent(), PULSES);
}

#[test]
fn each_software_trigger_gives_one_frame_the_first_one_included() {
    triggered(Wiring::Software, "Software", |_, camera| camera.device().execute("TriggerSoftware").unwrap());
}

#[test]
fn each_edge_on_line1_gives_one_frame_the_first_one_included() {
    triggered(Wiring::Line1, "Line1", |gige, _| gige.pulse());
}

#[test]
fn a_frame_with_lost_packets_is_torn_or_a_gap_and_never_complete() {
    const FRAMES: usize = 100;
    let Some(gige) = FakeGige::plug_in(Wiring::Software, FRAMES as u64, draw) else { return };
    gige.lose(0.005);
    let mut slots = Slots::new(FRAMES, FRAME_BYTES);
    // Of 188 packets per frame about 6 frames of 10 lose at least one.
    let wanted = config::Camera { packet_size_bytes: Some(1440), ..settings(100.0) };
    let mut camera = GenicamCamera::open(&wanted).unwrap();
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    let shot = take(&mut camera, &mut slots, FRAMES);
    assert_eq!((shot.whole.len() + shot.torn.len(), gige.sent()), (FRAMES, FRAMES as u64));
    assert!(shot.torn.len() > 20 && shot.whole.len() > 20, "{} torn", shot.torn.len());
    // Pixels were compared on the way. Frames before the first id received are unknown, all others are counted.
    let before = shot.whole[0].1 - shot.whole[0].0.sequence;
    assert!(shot.whole.iter().all(|(meta, index)| meta.sequence + before == *index));
    assert_eq!(camera.statistics().failed, shot.torn.len() as u64);
}

#[test]
fn frames_that_find_no_slot_are_gaps_in_the_sequence() {
    const FRAMES: usize = 120;
    let Some(gige) = FakeGige::plug_in(Wiring::Software, FRAMES as u64, draw) else { return };
    let mut slots = Slots::new(4, FRAME_BYTES);
    let mut camera = GenicamCamera::open(&settings(200.0)).unwrap();
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    let deadline = Instant::now() + PATIENCE;
    while gige.sent() < 60 && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut shot = take(&mut camera, &mut slots, 4);
    assert!(shot.whole.iter().map(|(meta, _)| meta.sequence).eq(0..4), "{:?}", shot.whole);
    let mut rest = take(&mut camera, &mut slots, 10);
    shot.whole.append(&mut rest.whole);
    let gap = shot.whole.windows(2).map(|pair| pair[1].0.sequence - pair[0].0.sequence - 1).max().unwrap();
    assert!(gap >= 50, "{gap}");
    assert!(shot.whole.iter().all(|(meta, index)| meta.sequence == *index));
    assert!(camera.statistics().packets_without_slot > 50);
}

/// Receives frames until the camera reports that it is gone.
fn until_it_fails(camera: &mut GenicamCamera, slots: &Slots) -> CameraError {
    let deadline = Instant::now() + PATIENCE;
    loop {
        match camera.next(Duration::from_millis(200)) {
            Ok(Next::Frame(slot, _) | Next::Incomplete(slot, _)) => slots.give_back(slot, camera),
            Ok(_) => {}
            Err(error) => return error,
        }
        assert!(Instant::now() < deadline, "not noticed");
    }
}

#[test]
fn an_unplugged_camera_vanishes_and_streams_again_when_it_is_back() {
    let Some(mut gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, draw) else { return };
    let mut slots = Slots::new(16, FRAME_BYTES);
    let mut camera = GenicamCamera::open(&settings(50.0)).unwrap();
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    assert_eq!(take(&mut camera, &mut slots, 3).whole.len(), 3);
    gige.unplug();
    let error = until_it_fails(&mut camera, &slots);
    assert!(matches!(error, CameraError::Lost { .. }), "{error}");
    assert!(error.to_string().starts_with("lost camera \"127.0.0.1\": "), "{error}");
    let begin = Instant::now();
    drop(camera);
    assert!(begin.elapsed() < Duration::from_secs(1), "closing waited {:?} for a camera that is gone", begin.elapsed());
    let error = GenicamCamera::open(&settings(50.0)).unwrap_err();

    assert!(matches!(error, CameraError::NotFound { .. }), "{error}");
    gige.plug_back();
    let begin = Instant::now();
    let mut camera = GenicamCamera::open(&settings(50.0)).unwrap();
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    let shot = take(&mut camera, &mut slots, 3);
    assert!(shot.whole.iter().map(|(meta, _)| meta.sequence).eq(0..3));
    assert!(begin.elapsed() < Duration::from_secs(3), "streaming again after {:?}", begin.elapsed());
}

#[test]
fn a_camera_taken_over_by_another_program_vanishes() {
    /// The register of the control channel privilege (GigE Vision bootstrap registers), 0 for no controlling program.
    const PRIVILEGE: u32 = 0xa00;
    let Some(gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, draw) else { return };
    let mut slots = Slots::new(16, FRAME_BYTES);
    let mut camera = GenicamCamera::open(&settings(50.0)).unwrap();
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    assert_eq!(take(&mut camera, &mut slots, 3).whole.len(), 3);
    gige.write(PRIVILEGE, 0);
    let error = until_it_fails(&mut camera, &slots);
    assert!(matches!(error, CameraError::Lost { .. }), "{error}");
}

#[test]
fn an_address_without_a_camera_is_refused_within_seconds() {
    if aravis_or_leave_out().is_none() {
        return;
    }
    let begin = Instant::now();
    let wanted = config::Camera { id: Some("127.0.0.77".into()), ..settings(100.0) };
    let error = GenicamCamera::open(&wanted).unwrap_err();
    assert_eq!(
        error.to_string(),
        "cannot open camera \"127.0.0.77\": no GigE Vision camera answers at 127.0.0.77, UDP port 3956"
    );
    assert!(begin.elapsed() < Duration::from_secs(10));
}

#[test]
fn a_camera_under_the_control_of_another_program_is_refused() {
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, draw) else { return };
    let first = GenicamCamera::open(&settings(50.0)).unwrap();
    let error = GenicamCamera::open(&settings(50.0)).unwrap_err();
    assert_eq!(error.to_string(), "cannot open camera \"127.0.0.1\": another program controls it");
    drop(first);
    GenicamCamera::open(&settings(50.0)).unwrap();
}

#[test]
fn a_camera_is_listed_and_found_by_its_serial_number() {
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, draw) else { return };
    let cameras = list().unwrap();
    assert!(cameras.iter().any(|camera| camera.serial == "R1" && camera.protocol == "GigEVision"), "{cameras:?}");
    let by_serial = config::Camera { id: Some("R1".into()), ..settings(50.0) };
    assert_eq!(GenicamCamera::open(&by_serial).unwrap().identity().serial, "R1");
}
