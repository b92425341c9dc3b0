//! Malicious packets, from the camera's own address and from others.

use super::camera::Gige;
use super::packets::{IMAGE, LEADER, PAYLOAD, Packet, TRAILER, UNAVAILABLE, Wire};
use super::take::Eye;
use crate::recording::recover::xorshift;
use ricochet::camera::genicam::FeatureValue;
use ricochet::config;
use std::net::UdpSocket;
use std::process::{Command, Stdio};

/// The variable that marks the process that does the work.
const WORKS: &str = "RICOCHET_ALONE";

/// Does the work of a test of this module in its own process, so that a crash ends no other test.
pub fn alone(module: &str, test: &str, work: impl FnOnce()) {
    if std::env::var(WORKS).is_ok_and(|name| name == test) {
        return work();
    }
    let (_, module) = module.split_once("::").unwrap();
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", &format!("{module}::{test}"), "--include-ignored", "--nocapture"])
        .env(WORKS, test)
        .stderr(Stdio::inherit())
        .output()
        .unwrap();
    let printed = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{test}: {}\n{printed}", output.status);
    // A child that finds no test of this name succeeds too.
    assert!(printed.contains("test result: ok. 1 passed"), "{test} did not run:\n{printed}");
}

/// A leader of this payload type with so many bytes of content.
fn leader(kind: u16, bytes: usize) -> Vec<u8> {
    let mut leader = vec![0xff; bytes];
    leader[..4].copy_from_slice(&[[0, 0], kind.to_be_bytes()].concat());
    leader
}

/// Invalid packets: too short, too long, beyond the frame, of another type, with too many parts.
fn evil(id: u64) -> Vec<Packet> {
    let mut packets = Vec::new();
    for is_extended in [false, true] {
        let wire = Wire { is_extended, packet_bytes: super::camera::PACKET_BYTES as usize };
        let whole = wire.packet(0, id, PAYLOAD, 1, &vec![0xee; wire.room()]);
        packets.extend((0..=wire.header_bytes()).map(|bytes| whole[..bytes].to_vec()));
        packets.push(wire.packet(0, id, PAYLOAD, 1, &vec![0xee; wire.room() + 1]));
        packets.push(wire.packet(0, id, PAYLOAD, 1, &[0xee; 40_000]));
        for number in [0, 17, 18, 40_000, 0x00ff_fffe, 0x00ff_ffff] {
            packets.push(wire.packet(0, id, PAYLOAD, number, &vec![0xee; wire.room()]));
            packets.push(wire.packet(UNAVAILABLE, id, PAYLOAD, number.max(17), &[]));
        }
        for number in [0, 1, 18, 40_000, 0x00ff_ffff] {
            packets.push(wire.packet(0, id, TRAILER, number, &[0; 8]));
            packets.push(wire.packet(0, id, LEADER, number.max(1), &leader(IMAGE, 36)));
        }
        for content in [0, 4, 5, 6, 7, 8, 0x7f] {
            packets.push(wire.packet(0, id, content, 1, &vec![0xee; wire.room()]));
        }
        packets.extend([0, 1, 11].map(|bytes| wire.packet(0, id, LEADER, 0, &vec![0; bytes])));
        packets.extend([
            wire.packet(0, id, LEADER, 0, &leader(IMAGE, 35)),
            wire.packet(0, id, LEADER, 0, &leader(10, 400)),
        ]);
        let mut parts = wire.packet(0, id, LEADER, 0, &leader(10, 400));
        parts[7] = 255;
        packets.push(parts);
    }
    packets
}

fn with_long_ids(gige: &Gige) -> config::Camera {
    let features = [("GevGVSPExtendedIDMode".into(), FeatureValue::Text("On".into()))].into();
    config::Camera { features, ..gige.settings() }
}

#[test]
fn invalid_packets_do_not_reach_the_library() {
    alone(module_path!(), "invalid_packets_do_not_reach_the_library", || {
        let Some(gige) = Gige::plug_in() else { return };
        for settings in [gige.settings(), with_long_ids(&gige)] {
            let mut eye = Eye::open(&settings);
            for index in 0..20 {
                // Of this frame, of the next, and of one far away; before, within and after a valid one.
                let id = 1 + index;
                let packets = gige.frame(id, index);
                gige.send(&evil(id));
                gige.send(&packets[..5]);
                gige.send(&evil(id));
                gige.send(&evil(id + 1));
                gige.send(&packets[5..]);
                gige.send(&evil(id + 9000));
            }
            let taken = eye.take_all().unwrap();
            assert_eq!((taken.torn.clone(), taken.indices()), (vec![], (0..20).collect()));
            assert_eq!(eye.camera.statistics().failed, 0);
        }
    });
}

#[test]
fn packets_from_another_computer_do_not_reach_the_library() {
    alone(module_path!(), "packets_from_another_computer_do_not_reach_the_library", || {
        let Some(gige) = Gige::plug_in() else { return };
        let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut eye = Eye::open(&gige.settings());
        for index in 0..20 {
            // Well-formed, and of the next frame, with the pixels of another one.
            let mut picture = gige.picture(1 + index, 1000 + index);
            picture.stamp_ns += 7;
            gige.send_from(&stranger, &gige.wire().cut(&picture));
            gige.send(&gige.frame(1 + index, index));
        }
        let taken = eye.take_all().unwrap();
        assert_eq!((taken.torn.clone(), taken.indices()), (vec![], (0..20).collect()));
    });
}

#[test]
fn cameras_are_opened_on_many_threads_at_once() {
    alone(module_path!(), "cameras_are_opened_on_many_threads_at_once", || {
        let Some(cameras) = (0..8).map(|_| Gige::plug_in()).collect::<Option<Vec<_>>>() else { return };
        std::thread::scope(|scope| {
            for gige in &cameras {
                scope.spawn(move || {
                    let mut eye = Eye::open(&gige.settings());
                    gige.send(&gige.frame(1, 7));
                    assert_eq!(eye.take(1).places(), [(0, 7)]);
                });
            }
        });
    });
}

#[test]
fn noise_of_any_length_is_survived() {
    alone(module_path!(), "noise_of_any_length_is_survived", || {
        let Some(gige) = Gige::plug_in() else { return };
        let mut random = xorshift(0x0123_4567_89ab_cdef);
        let mut eye = Eye::open(&gige.settings());
        for index in 0..300 {
            let noise: Vec<Packet> = (0..8)
                .map(|_| {
                    let bytes = random(700);
                    let mut packet: Vec<u8> = (0..bytes).map(|_| random(256) as u8).collect();
                    // Mostly with a status and a content type that are read.
                    if bytes > 8 && random(4) > 0 {
                        packet[..2].copy_from_slice(&[[0, 0], [1, 0], [0x80, 0x0c]][random(3)]);
                        packet[4] = [1, 2, 3, 0x81, 0x82, 0x83][random(6)];
                        packet[5..7].fill(0);
                    }
                    // Of none of the valid frames.
                    if bytes > 4 {
                        packet[2] |= 0x40;
                    }
                    packet
                })
                .collect();
            gige.send(&noise);
            gige.send(&gige.frame(1 + index, index));
        }
        let taken = eye.take_all().unwrap();
        // A leader in the noise may begin a frame that delays the valid ones. None of them is damaged.
        let whole = taken.indices();
        println!("{} of 300 frames whole, {} torn", whole.len(), taken.torn.len());
        assert!(whole.is_sorted() && whole.len() > 150, "{} whole", whole.len());
        let first = taken.whole[0].0.sequence - whole[0];
        assert!(taken.whole.iter().all(|(meta, index)| meta.sequence - first == *index));
    });
}
