//! Faults of a stream, and the frames that must come of it.

use super::camera::{Gige, HEIGHT_PX, WIDTH_PX, stamp_ns};
use super::control::{PRIVILEGE, Resend};
use super::packets::Packet;
use super::take::Eye;
use crate::recording::recover::xorshift;
use ricochet::camera::genicam::FeatureValue;
use ricochet::config;
use std::collections::BTreeMap;
use std::net::UdpSocket;

/// The numbers of all frames but those in the list.
fn all_but(frames: u64, lost: &[u64]) -> Vec<u64> {
    (0..frames).filter(|index| !lost.contains(index)).collect()
}

fn same(frames: impl IntoIterator<Item = u64>) -> Vec<(u64, u64)> {
    frames.into_iter().map(|index| (index, index)).collect()
}

fn with_long_ids(gige: &Gige) -> config::Camera {
    let features = BTreeMap::from([("GevGVSPExtendedIDMode".into(), FeatureValue::Text("On".into()))]);
    config::Camera { features, ..gige.settings() }
}

/// Sends frames with ids from `first` on, without the packets that `drops` lists by frame and number.
fn send_without(gige: &Gige, first: u64, frames: u64, drops: &[(u64, usize)]) {
    for index in 0..frames {
        let packets = gige.frame(first + index, index);
        let kept = |(number, _): &(usize, &Packet)| !drops.contains(&(index, *number));
        gige.send(packets.iter().enumerate().filter(kept).map(|(_, packet)| packet));
    }
}

/// Lost packets: leader, payload at the beginning, in the middle and at the end, two in a row, trailer.
const DROPS: [(u64, usize); 8] = [(2, 0), (4, 1), (6, 7), (8, 16), (10, 17), (12, 5), (12, 6), (15, 9)];

#[test]
fn lost_packets_are_requested_again_and_no_frame_is_lost() {
    let Some(gige) = Gige::plug_in() else { return };
    for settings in [gige.settings(), with_long_ids(&gige)] {
        let mut eye = Eye::open(&settings);
        send_without(&gige, 1, 20, &DROPS);
        let taken = eye.take(20);
        assert_eq!((taken.torn.clone(), taken.places()), (vec![], same(0..20)));
        let statistics = eye.camera.statistics();
        assert_eq!((statistics.completed, statistics.failed), (20, 0));
        assert!(statistics.resend_requests >= DROPS.len() as u64, "{statistics:?}");
        assert!(statistics.resent_packets >= DROPS.len() as u64, "{statistics:?}");
    }
}

#[test]
fn a_frame_whose_packets_are_not_sent_again_is_torn_and_a_gap() {
    let Some(gige) = Gige::plug_in() else { return };
    for resend in [Resend::Refuse, Resend::Silence] {
        gige.control().resend = resend;
        let mut eye = Eye::open(&gige.settings());
        send_without(&gige, 1, 20, &DROPS);
        let taken = eye.take(20);
        let lost = [2, 4, 6, 8, 10, 12, 15];
        assert_eq!(taken.places(), same(all_but(20, &lost)), "{resend:?}");
        assert_eq!(taken.torn.len(), lost.len(), "{resend:?}");
        assert!(taken.torn.iter().all(|cause| cause.ends_with("packets still missing at the timeout")));
        assert!(eye.camera.statistics().resend_requests > 0, "they were asked for");
        assert!(gige.control().asked > 0);
    }
}

#[test]
fn packets_in_any_order_make_the_same_frames() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut random = xorshift(0x9e37_79b9_7f4a_7c15);
    for settings in [gige.settings(), with_long_ids(&gige)] {
        let mut eye = Eye::open(&settings);
        for pair in 0..20 {
            // Two frames at once, each shuffled and mixed with the other. The first packets keep their order.
            let [mut first, mut second] = [0, 1].map(|odd| gige.frame(100 + 2 * pair + odd, 2 * pair + odd));
            for packets in [&mut first, &mut second] {
                for place in (1..packets.len()).rev() {
                    packets.swap(place, random(place + 1));
                }
            }
            let mut mixed = vec![first.remove(0)];
            while !first.is_empty() || !second.is_empty() {
                let from =
                    if second.is_empty() || (!first.is_empty() && random(2) == 0) { &mut first } else { &mut second };
                mixed.push(from.remove(0));
            }
            gige.send(&mixed);
        }
        let taken = eye.take(40);
        assert_eq!((taken.torn.clone(), taken.places()), (vec![], same(0..40)));
    }
}

#[test]
fn repeated_packets_and_frames_count_once() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&gige.settings());
    let mut before = Vec::new();
    for index in 0..20 {
        let packets = gige.frame(1 + index, index);
        gige.send(packets.iter().flat_map(|packet| [packet, packet]).chain(&before));
        before = packets;
    }
    let taken = eye.take_all().unwrap();
    assert_eq!((taken.torn.clone(), taken.places()), (vec![], same(0..20)));
}

#[test]
fn ids_of_16_bits_wrap_without_a_false_or_missed_gap() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&gige.settings());
    let id = |index: u64| (65_520 + index) % 65_535 + 1;
    for index in all_but(40, &[13, 14, 15, 30]) {
        gige.send(&gige.frame(id(index), index));
    }
    let taken = eye.take(36);
    assert_eq!((taken.torn.clone(), taken.places()), (vec![], same(all_but(40, &[13, 14, 15, 30]))));
    let stamps: Vec<_> = taken.whole.iter().map(|(meta, index)| (meta.device_ns, stamp_ns(*index))).collect();
    assert!(stamps.iter().all(|(reason, sent)| reason == sent), "{stamps:?}");
}

#[test]
fn ids_of_64_bits_count_beyond_what_32_hold() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&with_long_ids(&gige));
    for index in all_but(20, &[7, 8]) {
        gige.send(&gige.frame(u64::from(u32::MAX) - 5 + index, index));
    }
    let taken = eye.take(18);
    assert_eq!((taken.torn.clone(), taken.places()), (vec![], same(all_but(20, &[7, 8]))));
}

#[test]
fn incomplete_frames_are_torn_and_a_gap() {
    let Some(gige) = Gige::plug_in() else { return };
    gige.control().resend = Resend::Silence;
    let mut eye = Eye::open(&gige.settings());
    for index in 0..20 {
        let packets = gige.frame(1 + index, index);
        let sent = if index % 5 == 3 { 1 + index as usize / 2 } else { packets.len() };
        gige.send(&packets[..sent]);
    }
    let taken = eye.take(20);
    assert_eq!(taken.places(), same(all_but(20, &[3, 8, 13, 18])));
    assert_eq!(taken.torn.len(), 4, "{:?}", taken.torn);
}

#[test]
fn a_frame_of_another_size_or_format_than_the_camera_was_set_to_is_torn() {
    let Some(gige) = Gige::plug_in() else { return };
    gige.control().resend = Resend::Silence;
    let mut eye = Eye::open(&gige.settings());
    let mut id = 0;
    let mut torn = |change: &dyn Fn(&mut super::packets::Picture)| {
        id += 2;
        gige.send(&gige.frame(id - 1, id - 1));
        let mut picture = gige.picture(id, id);
        change(&mut picture);
        gige.send(&gige.cut(&picture));
        let taken = eye.take(2);
        assert_eq!(taken.places(), [(id - 2, id - 1)], "{:?}", taken.torn);
        taken.torn.join("; ")
    };
    let reason = torn(&|picture| picture.width = WIDTH_PX / 2);
    assert!(reason.contains("64x64 px of format 0x01080001, which differs from the camera's settings"), "{reason}");
    let reason = torn(&|picture| (picture.width, picture.height) = (HEIGHT_PX, WIDTH_PX));
    assert!(reason.contains("64x128 px"), "{reason}");
    let reason = torn(&|picture| picture.format = 0x0110_0005);
    assert!(reason.contains("format 0x01100005"), "{reason}");
    let reason = torn(&|picture| picture.payload.truncate(4000));
    assert!(reason.contains("4000 bytes instead of 8192"), "{reason}");
    // Packets beyond the frame are filtered out, so that a longer frame never ends.
    let reason = torn(&|picture| picture.payload.extend([7; 4000]));
    assert!(reason.contains("packets still missing"), "{reason}");
    // A file in place of an image.
    let reason = torn(&|picture| picture.kind = 3);
    assert!(!reason.is_empty());
}

#[test]
fn an_id_of_a_torn_frame_does_not_spoil_the_count() {
    let Some(gige) = Gige::plug_in() else { return };
    gige.control().resend = Resend::Silence;
    let mut eye = Eye::open(&gige.settings());
    for index in 0..10 {
        if index == 5 {
            gige.send(&gige.frame(20_000, index)[..3]);
        }
        gige.send(&gige.frame(1 + index, index));
    }
    let taken = eye.take(11);
    assert_eq!((taken.places(), taken.torn.len()), (same(0..10), 1));
}

#[test]
fn a_camera_that_restarts_its_ids_vanishes_so_that_it_is_opened_again() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&gige.settings());
    for index in 0..30 {
        gige.send(&gige.frame(5000 + index, index));
    }
    assert_eq!(eye.take(30).places(), same(0..30));
    for index in 30..60 {
        gige.send(&gige.frame(index - 29, index));
    }
    let error = eye.take_all().unwrap_err().to_string();
    assert_eq!(error, format!("lost camera {:?}: it restarted its frame count or its clock", gige.id()));
    drop(eye);
    let mut eye = Eye::open(&gige.settings());
    gige.send(&gige.frame(31, 60));
    assert_eq!(eye.take(1).places(), [(0, 60)]);
}

#[test]
fn a_frame_with_an_impossible_time_is_torn() {
    const HOUR_NS: u64 = 3_600_000_000_000;
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&gige.settings());
    let stamps = [100, 99, 100, 101].map(stamp_ns).into_iter().chain([0, stamp_ns(102) + HOUR_NS, stamp_ns(103)]);
    for (id, stamp_ns) in (1..).zip(stamps) {
        let mut picture = gige.picture(id, id);
        picture.stamp_ns = stamp_ns;
        gige.send(&gige.cut(&picture));
    }
    let taken = eye.take(7);
    assert_eq!(taken.places(), [(0, 1), (3, 4), (6, 7)]);
    let [back, same, none, leap] = taken.torn.as_slice() else { panic!("{:?}", taken.torn) };
    assert_eq!(*back, "frame id 2: its timestamp is not later than that of the previous frame");
    assert_eq!(*same, "frame id 3: its timestamp is not later than that of the previous frame");
    assert_eq!(*none, "frame id 5: it has no timestamp, unlike the previous one");
    assert!(
        leap.starts_with("frame id 6: its timestamp is 3600.0 s later than that of the previous frame, which arrived "),
        "{leap}"
    );
}

#[test]
fn a_camera_whose_clock_is_reset_vanishes_so_that_it_is_opened_again() {
    let Some(gige) = Gige::plug_in() else { return };
    let mut eye = Eye::open(&gige.settings());
    for index in 0..40 {
        let mut picture = gige.picture(1 + index, index);
        picture.stamp_ns += if index < 10 { 0 } else { 1_700_000_000_000_000_000 };
        gige.send(&gige.cut(&picture));
    }
    assert_eq!(eye.take(10).places(), same(0..10));
    let error = eye.take_all().unwrap_err().to_string();
    assert!(error.ends_with(": it restarted its frame count or its clock"), "{error}");
}

#[test]
fn control_is_taken_kept_by_the_heartbeat_and_released() {
    let Some(gige) = Gige::plug_in() else { return };
    // Longer than the library's heartbeat period of 1 s.
    gige.control().set(super::control::HEARTBEAT, 1900);
    let eye = Eye::open(&gige.settings());
    std::thread::sleep(std::time::Duration::from_millis(2500));
    assert_eq!(gige.control().register(PRIVILEGE), 2, "kept");
    assert_eq!(gige.control().register(super::control::ACQUISITION), 1);
    let error = Eye::try_open(&gige.settings()).err().unwrap();
    assert_eq!(error.to_string(), format!("cannot open camera {:?}: another program controls it", gige.id()));
    drop(eye);
    assert_eq!(gige.control().register(PRIVILEGE), 0);
    assert_eq!(gige.control().register(super::control::ACQUISITION), 0);
}

#[test]
fn a_camera_that_asks_for_more_time_gets_it() {
    let Some(gige) = Gige::plug_in() else { return };
    gige.control().put_off_ms = Some(300);
    let mut eye = Eye::open(&gige.settings());
    gige.send(&gige.frame(1, 0));
    assert_eq!(eye.take(1).places(), [(0, 0)]);
}

#[test]
fn the_imitated_camera_answers_discovery() {
    let Some(gige) = Gige::plug_in() else { return };
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(std::time::Duration::from_secs(5))).unwrap();
    socket.send_to(&[0x42, 0x11, 0, 2, 0, 0, 0, 9], gige.port()).unwrap();
    let mut answer = [0; 512];
    let size = socket.recv(&mut answer).unwrap();
    assert_eq!(answer[..8], [0, 0, 0, 3, 0, 0xf8, 0, 9]);
    assert_eq!((size, &answer[8 + 0x48..8 + 0x50]), (8 + 0xf8, b"Ricochet".as_slice()));
}
