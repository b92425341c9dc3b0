//! The frame rate that comes through, compared with the camera library's own receive loop.
#![expect(unsafe_code, reason = "the loop to compare with is written against the C library")]
#![expect(clippy::disallowed_methods, reason = "a rate needs a clock")]

use crate::fake_gige::{ADDRESS, FakeGige, Wiring, aravis_or_leave_out};
use crate::genicam::settings;
use crate::slots::Slots;
use ricochet::camera::genicam::{GenicamCamera, sys};
use ricochet::camera::{Camera, Next};
use ricochet::config;
use std::ffi::CString;
use std::ptr;
use std::time::{Duration, Instant};

/// Short turns in pairs, so that other load affects both alike. Many of them, because a turn is fast or slow depending
/// on whether sender and receiver share a processor.
const SPAN: Duration = Duration::from_millis(250);
const TURNS: usize = 48;
const FRAME_BYTES: usize = 512 * 512;
const BUFFERS: usize = 200;

/// Complete frames per second through a camera of this program.
fn ours(packet_bytes: u32) -> f64 {
    let mut slots = Slots::new(BUFFERS, FRAME_BYTES);
    let wanted = config::Camera { packet_size_bytes: Some(packet_bytes), ..settings(20_000.0) };
    let mut camera = GenicamCamera::open(&wanted).unwrap();
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    let (begin, mut whole) = (Instant::now(), 0);
    while begin.elapsed() < SPAN {
        match camera.next(Duration::from_millis(100)).unwrap() {
            Next::Frame(slot, _) => {
                whole += 1;
                slots.give_back(slot, &mut camera);
            }
            Next::Incomplete(slot, _) => slots.give_back(slot, &mut camera),
            _ => {}
        }
    }
    f64::from(whole) / begin.elapsed().as_secs_f64()
}

/// Complete frames per second through the library alone, with its own memory.
///
/// Its socket is as large as the library allows, from the second frame on. Its thread has the same priority as ours,
/// which on a loopback device costs the sender more than it gains.
fn library_alone(aravis: &sys::Aravis, packet_bytes: i32) -> f64 {
    let address = CString::new(ADDRESS).unwrap();
    let none = ptr::null_mut();
    // SAFETY: the calls of the library's own examples, in their order, all on this thread.
    unsafe {
        let camera = aravis.arv_camera_new(address.as_ptr(), none);
        assert!(!camera.is_null());
        aravis.arv_camera_gv_set_packet_size_adjustment(camera, sys::ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
        aravis.arv_camera_gv_set_stream_options(camera, sys::ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
        aravis.arv_camera_set_region(camera, 0, 0, 512, 512, none);
        aravis.arv_camera_set_frame_rate(camera, 20_000.0, none);
        aravis.arv_camera_gv_set_packet_size(camera, packet_bytes, none);
        let stream = aravis.arv_camera_create_stream_full(camera, Some(prefer), ptr::null_mut(), None, none);
        assert!(!stream.is_null());
        // G_TYPE_INT is the fundamental type 6, shifted by 2.
        let mut size: sys::GValue = std::mem::zeroed();
        aravis.g_value_init(&raw mut size, 6 << 2);
        aravis.g_value_set_int(&raw mut size, 64 << 20);
        aravis.g_object_set_property(stream.cast(), c"socket-buffer-size".as_ptr(), &raw const size);
        for _ in 0..BUFFERS {
            let buffer = aravis.arv_buffer_new_full(FRAME_BYTES, ptr::null_mut(), ptr::null_mut(), None);
            aravis.arv_stream_push_buffer(stream, buffer);
        }
        aravis.arv_camera_start_acquisition(camera, none);
        let (begin, mut whole) = (Instant::now(), 0);
        while begin.elapsed() < SPAN {
            let buffer = aravis.arv_stream_timeout_pop_buffer(stream, 100_000);
            if !buffer.is_null() {
                whole += i32::from(aravis.arv_buffer_get_status(buffer) == sys::ARV_BUFFER_STATUS_SUCCESS);
                aravis.arv_stream_push_buffer(stream, buffer);
            }
        }
        let rate = f64::from(whole) / begin.elapsed().as_secs_f64();
        aravis.arv_camera_stop_acquisition(camera, none);
        aravis.g_object_unref(stream.cast());
        aravis.g_object_unref(camera.cast());
        rate
    }
}

/// Called by the library on its receiving thread.
unsafe extern "C" fn prefer(_: *mut std::ffi::c_void, kind: sys::ArvStreamCallbackType, _: *mut sys::ArvBuffer) {
    if kind == sys::ARV_STREAM_CALLBACK_TYPE_INIT {
        let parameter = libc::sched_param { sched_priority: 20 };
        // SAFETY: 0 means this thread, and the parameter lives through the call. A refusal affects both loops alike.
        unsafe { libc::sched_setscheduler(0, libc::SCHED_RR, &raw const parameter) };
    }
}

fn mean(rates: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = rates.len() as f64;
    rates.sum::<f64>() / count
}

#[test]
#[ignore = "a measurement, to be run alone: cargo test --release --test it rate -- --ignored --nocapture"]
fn at_full_speed_at_least_nine_tenths_of_the_librarys_frame_rate_come_through() {
    let Some(aravis) = aravis_or_leave_out() else { return };
    // Only the first bytes change, so that the imitated camera spends its time sending.
    let Some(_gige) = FakeGige::plug_in(Wiring::Software, u64::MAX, |index, pixels| {
        pixels[..8].copy_from_slice(&index.to_le_bytes());
    }) else {
        return;
    };
    let share = |packet_bytes: i32| {
        // The order alternates from pair to pair.
        let pair = |turn: usize| {
            let first = turn.is_multiple_of(2).then(|| library_alone(aravis, packet_bytes));
            let through = ours(packet_bytes.cast_unsigned());
            (first.unwrap_or_else(|| library_alone(aravis, packet_bytes)), through)
        };
        let pairs: Vec<(f64, f64)> = (0..TURNS).map(pair).collect();
        let (alone, through) = (mean(pairs.iter().map(|pair| pair.0)), mean(pairs.iter().map(|pair| pair.1)));
        let share = through / alone;
        println!(
            "packets of {packet_bytes} bytes: library alone {alone:.0} frames/s, through the camera {through:.0}, \
             {share:.2} of it"
        );
        share
    };
    // The share at one size is known to a tenth only.
    let share = mean([1500, 9000, 16_000].into_iter().map(share));
    println!("{share:.2} in the mean");
    assert!(share >= 0.9);
}
