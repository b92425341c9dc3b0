//! Streams, answers and descriptions changed at random: nothing crashes, and no wrong frame comes out as complete and
//! in its place.
//!
//! One change is left out: a packet that claims to be another one of the same stream and has the right length. Nothing
//! in it shows the difference, neither to the library nor to this program.

use super::camera::{Gige, PACKET_BYTES, stamp_ns};
use super::control::Resend;
use super::hostile::alone;
use super::packets::{Packet, Picture, Wire};
use super::take::{Eye, Taken};
use crate::recording::recover::xorshift;
use ricochet::camera::genicam::FeatureValue;
use ricochet::camera::{Camera, CameraError};
use ricochet::config;
use std::time::{Duration, Instant};

/// The variable with the duration of the ignored tests, s.
const SECONDS: &str = "RICOCHET_MUTATE_SECONDS";

/// The duration of a test.
fn span(short: Duration, is_long: bool) -> Duration {
    if !is_long {
        return short;
    }
    Duration::from_secs(std::env::var(SECONDS).map_or(600, |text| text.parse().unwrap()))
}

/// Settings with block ids of 16 or 64 bits, with or without chunks.
fn settings(gige: &Gige, kind: usize) -> config::Camera {
    let mut features = std::collections::BTreeMap::new();
    let word = if kind & 1 == 0 { "Off" } else { "On" };
    features.insert("GevGVSPExtendedIDMode".into(), FeatureValue::Text(word.into()));
    features.insert("ChunkModeActive".into(), FeatureValue::Bool(kind & 2 != 0));
    if kind & 2 != 0 {
        for chunk in ["FrameID", "Timestamp"] {
            features.insert(format!("ChunkEnable[ChunkSelector={chunk}]"), FeatureValue::Bool(true));
        }
    }
    config::Camera { features, ..gige.settings() }
}

/// Changes the header data of a frame. Changed pixels would make an image that belongs to no frame.
fn mutate_picture(picture: &mut Picture, random: &mut impl FnMut(usize) -> usize) {
    let odd = [0, 1, 63, 127, 129, 4096, u32::MAX][random(7)];
    match random(7) {
        0 => picture.width = odd,
        1 => picture.height = odd,
        2 => picture.format = [0x0108_0009, 0x0110_0005, 0, u32::MAX][random(4)],
        3 => picture.kind ^= 1 << random(16),
        4 => picture.payload.truncate(random(picture.payload.len())),
        5 => picture.payload.extend(vec![0xee; 1 + random(2000)]),
        // Back in time, far ahead, or zero.
        _ => picture.stamp_ns = [0, 1, picture.stamp_ns - 20_000_000, picture.stamp_ns << 1, u64::MAX][random(5)],
    }
}

/// Changes the packets of a frame.
fn mutate_packets(packets: &mut Vec<Packet>, wire: Wire, random: &mut impl FnMut(usize) -> usize) {
    let at = random(packets.len());
    let bytes = packets[at].len();
    match random(9) {
        0 => drop(packets.remove(at)),
        1 => packets.truncate(at),
        2 => packets.swap(at, 0),
        3 => packets.insert(0, packets[at].clone()),
        4 => packets[at].truncate(random(bytes)),
        5 => packets[at].extend(vec![0xee; 1 + random(2000)]),
        // A status, the kind of ids or the content.
        6 => packets[at][[0, 1, 4][random(3)]] ^= 1 << random(8),
        7 => {
            // A packet number beyond the frame.
            let number = [18, 19, 255, 65_535, 0x00ff_ffff][random(5)] as u32;
            let place = if wire.is_extended { 16..20 } else { 5..8 };
            let digits = &number.to_be_bytes()[4 - place.len()..];
            packets[at][place].copy_from_slice(digits);
        }
        // A block id of no frame that is sent at this time.
        _ => packets[at][if wire.is_extended { 12 } else { 2 }] ^= 0x40 << random(2),
    }
}

/// Checks that each complete frame has its place, its time and its number.
fn judge(taken: &Taken, origin: &mut Option<u64>, has_chunks: bool) {
    for (meta, index) in &taken.whole {
        let first = *origin.get_or_insert(index - meta.sequence.min(*index));
        assert_eq!(meta.sequence + first, *index, "the place of frame {index}");
        let later = if has_chunks { super::camera::CHUNK_LATER_NS } else { 0 };
        assert_eq!(meta.device_ns, stamp_ns(*index) + later, "the time of frame {index}");
    }
}

/// Sends frames, some of them changed, and checks all that come out.
fn stream(span: Duration) {
    let Some(gige) = Gige::plug_in() else { return };
    gige.control().resend = Resend::Silence;
    let mut random = xorshift(0x2545_f491_4f6c_dd1d);
    let (start, mut index, mut whole, mut torn, mut changed) = (Instant::now(), 20, 0, 0, 0);
    let mut kind = 0;
    while start.elapsed() < span {
        let mut eye = Eye::open(&settings(&gige, kind));
        let (wire, mut origin) = (gige.wire(), None);
        for id in 1..=250 {
            // The first frames are unchanged, so that the count starts right.
            let is_changed = origin.is_some() && random(4) == 0;
            let mut picture = gige.picture(id, index);
            if is_changed && random(3) == 0 {
                mutate_picture(&mut picture, &mut random);
            }
            let mut packets = gige.cut(&picture);
            if is_changed {
                mutate_packets(&mut packets, wire, &mut random);
            }
            gige.send(&packets);
            changed += u64::from(is_changed);
            index += 1;
            if index % 10 == 0 {
                let taken = eye.take_now().unwrap();
                judge(&taken, &mut origin, kind & 2 != 0);
                (whole, torn) = (whole + taken.whole.len(), torn + taken.torn.len());
            }
        }
        let taken = eye.take_all().unwrap();
        judge(&taken, &mut origin, kind & 2 != 0);
        (whole, torn) = (whole + taken.whole.len(), torn + taken.torn.len());
        kind = (kind + 1) % 4;
    }
    println!("{} frames sent, {changed} changed; {whole} whole, {torn} torn", index - 20);
    assert!(whole as u64 > (index - 20) / 3 && torn > 0, "{whole} whole, {torn} torn");
}

#[test]
fn a_mutated_stream_gives_no_wrong_frame() {
    alone(module_path!(), "a_mutated_stream_gives_no_wrong_frame", || stream(span(Duration::from_secs(3), false)));
}

#[test]
#[ignore = "ten minutes, or RICOCHET_MUTATE_SECONDS"]
fn a_mutated_stream_gives_no_wrong_frame_for_long() {
    alone(module_path!(), "a_mutated_stream_gives_no_wrong_frame_for_long", || stream(span(Duration::ZERO, true)));
}

/// Opens a camera and takes a frame if that succeeds.
fn open_and_take(gige: &Gige, index: u64) -> Result<(), CameraError> {
    let mut eye = Eye::try_open(&gige.settings())?;
    gige.control().disguise = None;
    let is_started = gige.is_started();
    // The size may be less than an index needs, or more than the memory of the machine.
    let sizes = [gige.picture_bytes(), eye.camera.format().slot_bytes()];
    if is_started && sizes.iter().all(|bytes| (8..1 << 20).contains(bytes)) {
        // Sent with the true settings of the camera, whatever the program read.
        gige.send(&gige.frame(1 + index, index));
    }
    eye.take_all().map(|_| ())
}

/// Opens a camera repeatedly while some of its answers are wrong.
fn answers(span: Duration) {
    let Some(gige) = Gige::plug_in() else { return };
    let (start, mut round, mut opened) = (Instant::now(), 0, 0);
    while start.elapsed() < span {
        let mut random = xorshift(0x9e37_79b9_7f4a_7c15 ^ round << 8);
        gige.control().disguise = Some(Box::new(move |answer: &mut Vec<u8>| {
            if random(60) != 0 {
                return;
            }
            match random(4) {
                0 => answer.truncate(random(answer.len())),
                1 => answer.extend(vec![0xee; random(600)]),
                // The value, where a wrong one looks like a right one.
                _ if answer.len() > 8 => {
                    let at = 8 + random(answer.len() - 8);
                    answer[at] ^= 1 << random(8);
                }
                _ => answer[0] = 0x80,
            }
        }));
        match open_and_take(&gige, round) {
            Ok(()) => opened += 1,
            Err(error) => assert!(!error.to_string().is_empty()),
        }
        round += 1;
    }
    println!("opened {opened} times of {round}");
    gige.control().disguise = None;
    let mut eye = Eye::open(&gige.settings());
    gige.send(&gige.frame(1, 0));
    assert_eq!(eye.take(1).places(), [(0, 0)], "and well again");
}

#[test]
fn mutated_answers_are_survived() {
    alone(module_path!(), "mutated_answers_are_survived", || answers(span(Duration::from_secs(3), false)));
}

#[test]
#[ignore = "ten minutes, or RICOCHET_MUTATE_SECONDS"]
fn mutated_answers_are_survived_for_long() {
    alone(module_path!(), "mutated_answers_are_survived_for_long", || answers(span(Duration::ZERO, true)));
}

/// A description with words exchanged and, now and then, letters missing.
fn mutate_description(random: &mut impl FnMut(usize) -> usize) -> Vec<u8> {
    let text = include_str!("camera.xml");
    let mut words: Vec<&str> = text.split_inclusive(['<', '>', '"', ' ']).collect();
    let is_plain = |word: &&str| word.ends_with('<') || word.ends_with('"');
    let plain: Vec<usize> = (0..words.len()).filter(|at| is_plain(&words[*at]) && words[*at].len() > 1).collect();
    for _ in 0..=random(3) {
        let (from, to) = (plain[random(plain.len())], plain[random(plain.len())]);
        // Text between two tags, or in quotation marks, in place of another of its kind.
        if words[from].ends_with('<') == words[to].ends_with('<') {
            words[to] = words[from];
        }
    }
    let mut text = words.concat().into_bytes();
    if random(8) == 0 {
        let at = random(text.len() - 40);
        match random(3) {
            0 => text[at] ^= 1 << random(7),
            1 => text.truncate(at + 40),
            _ => drop(text.drain(at..at + 1 + random(30))),
        }
    }
    text
}

/// Opens cameras with changed descriptions.
fn descriptions(span: Duration) {
    let mut random = xorshift(0x0123_4567_89ab_cdef);
    let (start, mut round, mut opened) = (Instant::now(), 0, 0);
    while start.elapsed() < span {
        let text = mutate_description(&mut random);
        // The newest description is the one that crashed the process, if any did.
        std::fs::write(std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("mutated-camera.xml"), &text).unwrap();
        let Some(gige) = Gige::described_by(&text) else { return };
        match open_and_take(&gige, round) {
            Ok(()) => opened += 1,
            Err(error) => assert!(!error.to_string().is_empty()),
        }
        round += 1;
    }
    println!("opened {opened} times of {round}");
    assert!(opened > round / 8, "many changes leave a camera to open: {opened} of {round}");
}

#[test]
fn mutated_descriptions_are_survived() {
    alone(module_path!(), "mutated_descriptions_are_survived", || descriptions(span(Duration::from_secs(3), false)));
}

#[test]
#[ignore = "ten minutes, or RICOCHET_MUTATE_SECONDS"]
fn mutated_descriptions_are_survived_for_long() {
    alone(module_path!(), "mutated_descriptions_are_survived_for_long", || descriptions(span(Duration::ZERO, true)));
}

#[test]
fn a_frame_of_these_tests_has_the_packets_that_the_mutations_think_of() {
    for is_extended in [false, true] {
        let wire = Wire { is_extended, packet_bytes: PACKET_BYTES as usize };
        assert_eq!(super::camera::FRAME_BYTES.div_ceil(wire.room()) + 2, 18);
    }
}
