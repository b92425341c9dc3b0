//! The queue, and the camera over it, against a simulated driver.

use super::super::V4l2Camera;
use super::super::mock::{Mock, settings};
use super::*;
use crate::camera::{Camera, CameraError, Next};
use std::ptr::NonNull;

/// Bytes of a slot: more than the 8 of a frame, as a ring rounds them up.
const ROOM: usize = 16;
const SHORT: Duration = Duration::from_millis(1);

/// Memory for slots; created first, so that it is dropped last.
struct Memories(Vec<[u8; ROOM]>);

impl Memories {
    fn new(count: usize) -> Self {
        Self(vec![[0xa5; ROOM]; count])
    }

    /// Queues all of the memory as slots, whose tokens are the indices.
    fn lend_all(&mut self, camera: &mut V4l2Camera) {
        for (token, memory) in self.0.iter_mut().enumerate() {
            let memory = NonNull::new(memory.as_mut_ptr()).unwrap();
            // SAFETY: the memory outlives the camera, and nothing touches it but through its slot.
            camera.queue(unsafe { Slot::new(memory, ROOM, token) });
        }
    }
}

fn open_camera(mock: &Mock) -> V4l2Camera {
    V4l2Camera::with_device(mock.device(), &settings()).unwrap()
}

/// Starts a camera with all of these slots.
fn start_camera(mock: &Mock, memories: &mut Memories) -> V4l2Camera {
    let mut camera = open_camera(mock);
    memories.lend_all(&mut camera);
    camera.start().unwrap();
    camera
}

/// Returns the slot and the sequence number of the next frame, which must be complete.
fn next_frame(camera: &mut V4l2Camera) -> (Slot, u64) {
    match camera.next(SHORT).unwrap() {
        Next::Frame(slot, meta) => (slot, meta.sequence),
        other => panic!("{other:?}"),
    }
}

/// Returns the slot and the defect of the next frame, which must be incomplete.
fn next_incomplete(camera: &mut V4l2Camera) -> (Slot, String) {
    match camera.next(SHORT).unwrap() {
        Next::Incomplete(slot, reason) => (slot, reason),
        other => panic!("{other:?}"),
    }
}

/// Passes a hundred frames through six slots and checks each byte; `copies` is whether they must be copied.
fn run_through(mock: &Mock, copies: bool) {
    let mut memories = Memories::new(6);
    let mut camera = start_camera(mock, &mut memories);
    assert_eq!(camera.copies(), copies);
    for count in 0..100_u8 {
        assert!(mock.fill(1000 + u32::from(count), count, 0), "the driver has no buffer for frame {count}");
        let (mut slot, sequence) = next_frame(&mut camera);
        assert_eq!(sequence, u64::from(count));
        let (pixels, beyond) = slot.bytes_mut().split_at(8);
        assert_eq!(pixels, [count; 8]);
        assert_eq!(beyond, [0xa5; 8], "written beyond the frame");
        camera.queue(slot);
    }
    drop(camera);
    assert!(!mock.state().streaming);
}

#[test]
fn frames_land_in_the_slots_themselves_where_the_driver_takes_them() {
    run_through(&Mock::new(), false);
}

#[test]
fn frames_are_copied_where_the_driver_takes_no_memory_or_finds_out_late() {
    for takes_user in [(false, false), (true, false)] {
        let mock = Mock::new();
        mock.state().takes_user = takes_user;
        run_through(&mock, true);
    }
}

#[test]
fn frames_with_padded_rows_are_copied_without_the_padding() {
    let mock = Mock::new();
    mock.state().padding_bytes = 3;
    run_through(&mock, true);
}

#[test]
fn a_wait_in_vain_gives_no_buffer_back_and_the_stream_goes_on() {
    for takes_user in [(true, true), (false, false)] {
        let mock = Mock::new();
        mock.state().takes_user = takes_user;
        let mut memories = Memories::new(6);
        let mut camera = start_camera(&mock, &mut memories);
        let owned = mock.state().owned.clone();
        for _ in 0..20 {
            assert!(matches!(camera.next(SHORT).unwrap(), Next::Timeout));
        }
        assert_eq!(mock.state().owned, owned);
        mock.fill(0, 7, 0);
        assert_eq!(next_frame(&mut camera).1, 0);
    }
}

#[test]
fn a_frame_from_before_the_start_is_no_frame_and_its_count_says_nothing() {
    for takes_user in [(true, true), (false, false)] {
        let mock = Mock::new();
        mock.state().takes_user = takes_user;
        let mut memories = Memories::new(6);
        let mut camera = start_camera(&mock, &mut memories);
        let owned = mock.state().owned.len();
        // A second after the start of the machine.
        let stamp_s = std::mem::replace(&mut mock.state().stamp_s, 1);
        mock.fill(0, 7, 0);
        assert!(matches!(camera.next(SHORT).unwrap(), Next::Timeout));
        assert_eq!(mock.state().owned.len(), owned, "its buffer is with the driver again");
        mock.state().stamp_s = stamp_s;
        for (count, sequence) in [(40, 0), (41, 1)] {
            mock.fill(count, 7, 0);
            assert_eq!(next_frame(&mut camera).1, sequence);
        }
    }
}

#[test]
fn a_gap_in_the_drivers_count_is_a_gap_in_the_sequence() {
    let mock = Mock::new();
    let mut memories = Memories::new(6);
    let mut camera = start_camera(&mock, &mut memories);
    for (count, sequence) in [(5, 0), (6, 1), (9, 4)] {
        mock.fill(count, 1, 0);
        assert_eq!(next_frame(&mut camera).1, sequence);
    }
}

#[test]
fn damaged_short_and_repeated_frames_are_torn_and_leave_a_gap() {
    let mock = Mock::new();
    let mut memories = Memories::new(6);
    let mut camera = start_camera(&mock, &mut memories);
    mock.fill(0, 1, 0);
    mock.fill(1, 2, sys::V4L2_BUF_FLAG_ERROR);
    mock.fill_part(2, 3, 0, 5);
    mock.fill(2, 4, 0);
    mock.fill(3, 5, 0);
    assert_eq!(next_frame(&mut camera).1, 0);
    assert_eq!(next_incomplete(&mut camera).1, "frame 1: the driver marks it as damaged");
    assert_eq!(next_incomplete(&mut camera).1, "frame 2: 5 bytes instead of 8");
    assert_eq!(next_incomplete(&mut camera).1, "frame 2: not later than the previous frame");
    assert_eq!(next_frame(&mut camera).1, 3);
}

#[test]
fn without_a_slot_nothing_is_lost_that_the_driver_can_hold() {
    let mock = Mock::new();
    mock.state().takes_user = (false, false);
    let mut memories = Memories::new(1);
    let mut camera = start_camera(&mock, &mut memories);
    mock.fill(0, 1, 0);
    mock.fill(1, 2, 0);
    let (slot, _) = next_frame(&mut camera);
    assert!(matches!(camera.next(SHORT).unwrap(), Next::Timeout));
    camera.queue(slot);
    let (mut slot, sequence) = next_frame(&mut camera);
    assert_eq!((sequence, slot.bytes_mut()[0]), (1, 2));
}

#[test]
fn slots_beyond_the_drivers_buffers_wait_their_turn() {
    let mock = Mock::new();
    let mut memories = Memories::new(12);
    let mut camera = start_camera(&mock, &mut memories);
    assert_eq!(mock.state().owned.len(), 8);
    for count in 0..50 {
        assert!(mock.fill(count, 1, 0));
        let (slot, _) = next_frame(&mut camera);
        camera.queue(slot);
        assert_eq!(mock.state().owned.len(), 8);
    }
}

#[test]
fn an_unplugged_camera_has_vanished_and_is_dropped_in_peace() {
    for (code, word) in [(libc::ENODEV, "it was unplugged"), (libc::EIO, "its driver reports an input/output error")] {
        let mock = Mock::new();
        let mut memories = Memories::new(6);
        let mut camera = start_camera(&mock, &mut memories);
        mock.state().broken = Some(code);
        match camera.next(SHORT) {
            Err(CameraError::Lost { id, reason }) => assert_eq!((id.as_str(), reason.as_str()), ("mock", word)),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_refused_buffer_comes_back_as_torn_and_refusals_without_end_are_the_end() {
    let mock = Mock::new();
    let mut memories = Memories::new(6);
    let mut camera = start_camera(&mock, &mut memories);
    mock.fill(0, 1, 0);
    let (slot, _) = next_frame(&mut camera);
    mock.state().refuses_buffers = Some(libc::EIO);
    camera.queue(slot);
    let mut refusals = 0;
    let error = loop {
        match camera.next(SHORT) {
            Ok(Next::Incomplete(slot, reason)) => {
                assert!(reason.starts_with("the driver refused the buffer: "), "{reason}");
                camera.queue(slot);
                refusals += 1;
                assert!(refusals < 1000, "refused for ever");
            }
            Ok(other) => panic!("{other:?}"),
            Err(error) => break error.to_string(),
        }
    };
    assert!(error.contains("buffers in a row"), "{error}");
    assert!(refusals > 10);
}

#[test]
#[should_panic(expected = "a slot of 16 bytes is too small")]
fn a_slot_that_is_too_small_never_reaches_the_driver() {
    let mock = Mock::new();
    mock.state().size = (16, 16);
    Memories::new(1).lend_all(&mut open_camera(&mock));
}
