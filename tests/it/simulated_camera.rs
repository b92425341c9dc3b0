//! The simulated camera through the camera trait.
#![expect(unsafe_code, reason = "slots are lent memory")]
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use ricochet::camera::simulated::SimulatedCamera;
use ricochet::camera::{Camera, CameraError, Next, Pace, Slot};
use ricochet::image::FrameMeta;
use ricochet::synth::{Scenario, SimulatedFilm};
use std::ptr::NonNull;
use std::time::{Duration, Instant};

const LONG: Duration = Duration::from_secs(60);

/// Memory for slots, which outlives them in every test.
struct Memory(Vec<Vec<u8>>);

impl Memory {
    fn new(slots: usize, bytes: usize) -> Self {
        Self((0..slots).map(|_| vec![0; bytes]).collect())
    }

    fn slot(&mut self, token: usize) -> Slot {
        let piece = &mut self.0[token];
        // SAFETY: the vector outlives the slot, and nobody reads it before the slot is returned.
        unsafe { Slot::new(NonNull::new(piece.as_mut_ptr()).unwrap(), piece.len(), token) }
    }
}

fn small(frame_rate_hz: f64, frames: u64) -> Scenario {
    let mut scenario = Scenario::built_in("lacrosse").unwrap();
    (scenario.camera.frame_rate_hz, scenario.camera.frames) = (frame_rate_hz, frames);
    scenario
}

fn frame(next: Next) -> (Slot, FrameMeta) {
    match next {
        Next::Frame(slot, meta) => (slot, meta),
        other => panic!("expected a frame, got {other:?}"),
    }
}

#[test]
fn on_demand_every_frame_comes_in_order_as_rendered() {
    let scenario = small(10_000.0, 8);
    let world = SimulatedFilm::new(&scenario).unwrap();
    let mut camera = SimulatedCamera::open(scenario, Pace::OnDemand).unwrap();
    assert_eq!((camera.pace(), camera.slots()), (Pace::OnDemand, 1));
    let format = camera.format();
    assert_eq!((format.width_px, format.height_px, format.slot_bytes()), (256, 192, world.frame_bytes()));
    let mut memory = Memory::new(1, format.slot_bytes());
    camera.queue(memory.slot(0));
    assert!(matches!(camera.next(LONG), Ok(Next::Timeout)), "nothing comes before the start");
    camera.start().unwrap();
    let mut expected = vec![0; world.frame_bytes()];
    for index in 0..8 {
        let (mut slot, meta) = frame(camera.next(LONG).unwrap());
        assert_eq!((meta.sequence, meta.stamp_ns), (index, world.stamp_ns(index)));
        assert_eq!((meta.device_ns, meta.size_bytes()), (index * 100_000, world.frame_bytes()));
        world.render(index, &mut expected);
        assert!(slot.bytes_mut() == expected, "frame {index}");
        assert_eq!(camera.truth(index), vec![world.truth(index)]);
        assert!(matches!(camera.next(LONG), Ok(Next::Timeout | Next::End)), "no slot, no frame");
        camera.queue(slot);
    }
    assert!(matches!(camera.next(LONG), Ok(Next::End)));
    assert!(camera.truth(8).is_empty());
    assert_eq!(camera.impact(), world.impact());
}

#[test]
#[expect(clippy::disallowed_methods, reason = "the camera's pace is the wall clock's")]
fn paced_frames_do_not_come_before_their_time() {
    let mut camera = SimulatedCamera::open(small(500.0, 10), Pace::Live).unwrap();
    assert_eq!(camera.pace(), Pace::Live);
    let mut memory = Memory::new(10, camera.format().slot_bytes());
    (0..10).for_each(|token| camera.queue(memory.slot(token)));
    let started = Instant::now();
    camera.start().unwrap();
    assert!(matches!(camera.next(Duration::ZERO), Ok(Next::Timeout)), "frame 0 is still being exposed");
    for index in 0..10u64 {
        let (slot, meta) = frame(camera.next(LONG).unwrap());
        assert_eq!((meta.sequence, slot.token()), (index, index as usize));
        assert!(started.elapsed() >= Duration::from_millis(2) * index as u32, "frame {index}");
    }
    assert!(matches!(camera.next(LONG), Ok(Next::End)));
}

#[test]
fn a_paced_frame_without_a_slot_is_a_visible_loss() {
    let mut camera = SimulatedCamera::open(small(1000.0, 200), Pace::Live).unwrap();
    let mut memory = Memory::new(1, camera.format().slot_bytes());
    camera.queue(memory.slot(0));
    camera.start().unwrap();
    let (slot, meta) = frame(camera.next(LONG).unwrap());
    assert_eq!(meta.sequence, 0, "this slot was queued in time");
    std::thread::sleep(Duration::from_millis(30));
    camera.queue(slot);
    let (slot, meta) = frame(camera.next(LONG).unwrap());
    assert!(meta.sequence >= 30, "frame {} came although no slot was queued", meta.sequence);
    std::thread::sleep(Duration::from_millis(200));
    camera.queue(slot);
    assert!(matches!(camera.next(LONG), Ok(Next::End)), "the film is over");
}

#[test]
fn a_film_too_fast_to_draw_is_drawn_in_advance_with_the_same_pixels() {
    let scenario = small(2_000_000.0, 20);
    let mut scenario = scenario;
    scenario.camera.exposure_us = 0.1;
    let world = SimulatedFilm::new(&scenario).unwrap();
    let mut camera = SimulatedCamera::open(scenario, Pace::Live).unwrap();
    let mut memory = Memory::new(20, camera.format().slot_bytes());
    (0..20).for_each(|token| camera.queue(memory.slot(token)));
    camera.start().unwrap();
    let mut expected = vec![0; world.frame_bytes()];
    for index in 0..20 {
        let (mut slot, meta) = frame(camera.next(LONG).unwrap());
        assert_eq!(meta.sequence, index);
        world.render(index, &mut expected);
        assert!(slot.bytes_mut() == expected, "frame {index}");
    }
}

#[test]
fn a_film_too_fast_to_draw_and_too_long_to_keep_is_refused() {
    let mut scenario = small(1_000_000.0, 40_000);
    scenario.camera.exposure_us = 0.5;
    let error = SimulatedCamera::open(scenario, Pace::Live).unwrap_err();
    assert!(matches!(error, CameraError::Setting { .. }));
    let line = error.to_string();
    assert!(line.starts_with("cannot set camera feature camera.frame_rate_hz to 1000000: a frame takes"), "{line}");
    assert!(line.contains("40000 frames of 49152 bytes exceed the 1073741824 bytes"), "{line}");
}

#[test]
fn a_bad_scenario_is_refused_with_its_key() {
    let error = SimulatedCamera::open(small(0.0, 10), Pace::OnDemand).unwrap_err().to_string();
    assert_eq!(
        error,
        "cannot set camera feature scenario to lacrosse: camera.frame_rate_hz = 0 is out of range: allowed is 0.001 to 10000000"
    );
}

#[test]
fn an_endless_film_turns_at_its_ends_and_its_stamps_are_of_the_present() {
    let (rate_hz, count) = (2000.0, 3);
    let world = SimulatedFilm::new(&small(rate_hz, count)).unwrap();
    let film: Vec<Vec<u8>> = (0..count)
        .map(|index| {
            let mut frame = vec![0; world.frame_bytes()];
            world.render(index, &mut frame);
            frame
        })
        .collect();
    let mut camera = SimulatedCamera::endless(world).unwrap();
    let mut memory = Memory::new(10, film[0].len());
    (0..10).for_each(|token| camera.queue(memory.slot(token)));
    let host_ns = || std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos() as u64;
    let before_ns = host_ns();
    camera.start().unwrap();
    let after_ns = host_ns();
    let mut first_ns = 0;
    for (index, shown) in [0, 1, 2, 2, 1, 0, 0, 1, 2, 2].into_iter().enumerate() {
        let (mut slot, meta) = frame(camera.next(LONG).unwrap());
        assert_eq!(meta.sequence, index as u64);
        assert!(slot.bytes_mut()[..] == film[shown], "frame {index}");
        if index == 0 {
            first_ns = meta.stamp_ns;
            assert!((before_ns..=after_ns).contains(&first_ns));
        }
        assert_eq!((meta.stamp_ns - first_ns, meta.device_ns), (index as u64 * 500_000, index as u64 * 500_000));
        assert!(camera.truth(meta.sequence).is_empty());
    }
}
