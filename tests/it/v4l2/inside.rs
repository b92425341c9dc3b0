//! Tests that run in the virtual machine only, one after the other.

use super::drivers::{Fault, LOOPBACK, VIVID, Writer, inject};
use super::sample;
use crate::camera_contract;
use crate::slots::Slots;
use crate::support::camera_settings;
use ricochet::camera::v4l2::{V4l2Camera, features, list, sys};
use ricochet::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use ricochet::config;
use ricochet::config::FeatureValue;
use ricochet::image::PixelFormat;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

const SIZE: (u32, u32) = (320, 180);
const WAIT: Duration = Duration::from_millis(100);
/// The number of waits without a frame after which a camera counts as stuck.
const WAITS: usize = 100;

/// A frame of noise that begins with its number.
fn draw(number: u64, pixels: &mut [u8]) {
    let mut state = number.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    for pixel in pixels.iter_mut() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        *pixel = (state >> 56) as u8;
    }
    pixels[..8].copy_from_slice(&number.to_le_bytes());
}

/// Draws a frame of noise of this many bytes that begins with its number.
fn drawn(bytes: u32) -> impl Fn(u64) -> Vec<u8> {
    move |number| {
        let mut pixels = vec![0; bytes as usize];
        draw(number, &mut pixels);
        pixels
    }
}

/// The number that a frame begins with.
fn number(pixels: &[u8]) -> u64 {
    u64::from_le_bytes(pixels[..8].try_into().unwrap())
}

/// A camera whose sequence numbers are shifted to the number in its first frame.
struct Numbered {
    camera: V4l2Camera,
    number: fn(&[u8]) -> u64,
    shift: Option<u64>,
}

/// Runs the loop-back camera with its present settings and compares each frame with the one that was written.
fn check_loopback(frames: u64, number: fn(&[u8]) -> u64, known: &dyn Fn(u64, &mut [u8])) {
    let settings = config::Camera { id: Some(LOOPBACK.into()), ..camera_settings() };
    let camera = V4l2Camera::open(&settings).unwrap();
    camera_contract::check(Box::new(Numbered { camera, number, shift: None }), frames, known);
}

impl Camera for Numbered {
    fn format(&self) -> StreamFormat {
        self.camera.format()
    }
    fn identity(&self) -> CameraIdentity {
        self.camera.identity()
    }
    fn pace(&self) -> Pace {
        self.camera.pace()
    }
    fn slots(&self) -> usize {
        self.camera.slots()
    }
    fn queue(&mut self, slot: Slot) {
        self.camera.queue(slot);
    }
    fn start(&mut self) -> Result<(), CameraError> {
        self.camera.start()
    }
    fn frame_age(&self) -> Duration {
        self.camera.frame_age()
    }
    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        let (mut slot, mut meta) = match self.camera.next(timeout)? {
            Next::Frame(slot, meta) => (slot, meta),
            other => return Ok(other),
        };
        let number = (self.number)(slot.bytes_mut());
        meta.sequence += *self.shift.get_or_insert_with(|| number - meta.sequence);
        Ok(Next::Frame(slot, meta))
    }
}

fn vivid(format: PixelFormat, features: &[(&str, FeatureValue)]) -> config::Camera {
    config::Camera {
        id: Some(VIVID.into()),
        width_px: Some(SIZE.0),
        height_px: Some(SIZE.1),
        pixel_format: Some(format),
        frame_rate_hz: Some(60.0),
        features: features.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect::<BTreeMap<_, _>>(),
        ..camera_settings()
    }
}

fn text(word: &str) -> FeatureValue {
    FeatureValue::Text(word.into())
}

/// A white image without overlaid text.
fn white() -> [(&'static str, FeatureValue); 4] {
    still("100% White")
}

/// An image without overlaid text that is the same in each frame.
fn still(pattern: &str) -> [(&'static str, FeatureValue); 4] {
    [
        ("test_pattern", text(pattern)),
        ("osd_text_mode", text("None")),
        ("brightness", FeatureValue::Integer(128)),
        ("contrast", FeatureValue::Integer(128)),
    ]
}

fn start(settings: &config::Camera) -> (Slots, V4l2Camera) {
    let mut camera = V4l2Camera::open(settings).unwrap();
    let mut slots = Slots::new(camera.slots(), camera.format().slot_bytes());
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    (slots, camera)
}

/// Waits for the next event of a camera.
fn next(camera: &mut V4l2Camera) -> Result<Next, CameraError> {
    for _ in 0..WAITS {
        match camera.next(WAIT) {
            Ok(Next::Timeout) => {}
            other => return other,
        }
    }
    panic!("stuck");
}

fn frame(camera: &mut V4l2Camera) -> (Slot, u64) {
    match next(camera).unwrap() {
        Next::Frame(slot, meta) => (slot, meta.sequence),
        other => panic!("{other:?}"),
    }
}

fn refusal(settings: &config::Camera) -> String {
    V4l2Camera::open(settings).unwrap_err().to_string()
}

#[test]
#[ignore = "runs in the virtual machine"]
fn known_frames_arrive_bit_for_bit_in_order_with_every_gap_counted() {
    for (fourcc, format, size) in
        [(sys::FOURCC_GREY, PixelFormat::Mono8, (512, 512)), (sys::FOURCC_Y16, PixelFormat::Mono16, (320, 240))]
    {
        let bytes = size.0 * size.1 * format.bytes_per_pixel() as u32;
        let _writer = Writer::start(size, fourcc, bytes, drawn(bytes));
        let camera = V4l2Camera::open(&config::Camera { id: Some(LOOPBACK.into()), ..camera_settings() }).unwrap();
        let offered = camera.format();
        assert_eq!((offered.width_px, offered.height_px, offered.format), (size.0, size.1, format));
        drop(camera);
        check_loopback(100, number, &draw);
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn luma_of_packed_colour_arrives_bit_for_bit() {
    let size = (320, 240);
    for (fourcc, first) in [(sys::FOURCC_YUYV, 0), (sys::FOURCC_UYVY, 1)] {
        let _writer = Writer::start(size, fourcc, 2 * size.0 * size.1, move |number| {
            let luma = drawn(size.0 * size.1)(number);
            let pair = |luma: u8| if first == 0 { [luma, !luma] } else { [!luma, luma] };
            luma.into_iter().flat_map(pair).collect()
        });
        check_loopback(60, number, &draw);
    }
    let bytes = size.0 * size.1;
    let _writer = Writer::start(size, sys::FOURCC_NV12, bytes * 3 / 2, move |number| {
        let mut planes = drawn(bytes)(number);
        planes.resize(bytes as usize * 3 / 2, 0x55);
        planes
    });
    check_loopback(60, number, &draw);
}

/// One of this many images is truncated.
const CUT: u64 = 10;

/// The grey level of a block of 8 x 8 px of a compressed image.
fn level(number: u64, column: usize, row: usize) -> u8 {
    match (row, column) {
        (0, 0..8) => number.to_le_bytes()[column],
        _ => (number.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left((7 * column + 13 * row) as u32 % 64) & 0xff) as u8,
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn luma_of_compressed_images_arrives_bit_for_bit_and_truncated_images_never() {
    let (width, height) = (320_u16, 240_u16);
    let most = 2 * u32::from(width) * u32::from(height);
    let _writer = Writer::start((width.into(), height.into()), sys::FOURCC_MJPG, most, move |number| {
        let mut picture = sample::encode_picture((width, height), |column, row| level(number, column, row));
        if number % CUT == CUT - 1 {
            picture.truncate(picture.len() * 3 / 4);
        }
        picture
    });
    let number = |pixels: &[u8]| u64::from_le_bytes(std::array::from_fn(|byte| pixels[8 * byte]));
    check_loopback(100, number, &|number, pixels| {
        assert_ne!(number % CUT, CUT - 1, "the truncated image {number} was taken for a complete one");
        let width = usize::from(width);
        for (at, pixel) in pixels.iter_mut().enumerate() {
            *pixel = level(number, at % width / 8, at / width / 8);
        }
    });
}

#[test]
#[ignore = "runs in the virtual machine"]
fn a_driver_that_takes_user_memory_writes_to_the_slots_itself_and_keeps_the_contract() {
    let settings = vivid(PixelFormat::Mono8, &white());
    let mut camera = V4l2Camera::open(&settings).unwrap();
    assert_eq!(camera.format().frame_rate_hz, 60.0);
    {
        let mut slots = Slots::new(4, camera.format().slot_bytes());
        slots.queue_all(&mut camera);
        camera.start().unwrap();
        assert!(!camera.copies());
        drop(camera);
    }
    let camera = V4l2Camera::open(&settings).unwrap();
    let waited = camera_contract::check(Box::new(camera), 60, &|_, pixels| pixels.fill(WHITE));
    assert!(waited >= camera_contract::AWAY / 2, "{waited:?}");
}

/// The grey level of white in images of vivid.
const WHITE: u8 = 254;

#[test]
#[ignore = "runs in the virtual machine"]
fn each_format_has_the_bits_of_its_name() {
    let picture = |format| {
        let (_slots, mut camera) = start(&vivid(format, &still("Gray Ramp")));
        let (mut slot, _) = frame(&mut camera);
        slot.bytes_mut().to_vec()
    };
    let grey = picture(PixelFormat::Mono8);
    let levels: BTreeSet<u8> = grey.iter().copied().collect();
    assert!(levels.len() > 100 && !levels.contains(&255), "an image of {} levels", levels.len());
    // The driver fills the upper eight bits only.
    for (format, shift) in [(PixelFormat::Mono10, 2), (PixelFormat::Mono12, 4), (PixelFormat::Mono16, 8)] {
        let bytes = picture(format);
        assert_eq!(bytes.len(), 2 * grey.len());
        for (at, (pair, level)) in bytes.chunks_exact(2).zip(&grey).enumerate() {
            let value = u16::from_le_bytes([pair[0], pair[1]]);
            assert_eq!(value, u16::from(*level) << shift, "{format:?}, pixel {at} of level {level}");
        }
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn stamps_are_in_host_time_at_the_start_of_each_frame() {
    let now = || std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos() as i64;
    let shift_ns = |source: &str| {
        let (_slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[("timestamp_source", text(source))]));
        match next(&mut camera).unwrap() {
            Next::Frame(_, meta) => {
                // The driver stamps ends up to a frame ahead. A slow machine may be late by a second.
                assert!((now() - meta.stamp_ns as i64).abs() < 1_000_000_000, "{} now {}", meta.stamp_ns, now());
                meta.stamp_ns as i64 - meta.device_ns as i64
            }
            other => panic!("{other:?}"),
        }
    };
    let set_back = shift_ns("Start of Exposure") - shift_ns("End of Frame");
    let period = 16_666_667;
    // The offset between the two clocks is measured again for each camera, to some microseconds.
    assert!((set_back - period).abs() < 2_000_000, "set back by {set_back} ns, frame period {period}");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn controls_are_set_and_read_back_and_wrong_ones_are_refused_with_the_range() {
    let wanted = [
        ("brightness", FeatureValue::Integer(77)),
        ("boolean", FeatureValue::Bool(false)),
        // Without effect while the automatic control is on.
        ("gain", FeatureValue::Integer(42)),
        ("gain_automatic", FeatureValue::Bool(false)),
        ("menu", text("Menu Item 4")),
        ("integer_64_bits", FeatureValue::Integer(-7)),
        ("string", text("abcd")),
        ("bitmask", FeatureValue::Integer(0x8000_2000)),
        ("integer_menu", FeatureValue::Integer(42)),
    ];
    V4l2Camera::open(&vivid(PixelFormat::Mono8, &wanted)).unwrap();
    let (camera, lines) = features(VIVID).unwrap();
    assert_eq!((camera.path.to_str(), camera.unavailable), (Some(VIVID), None));
    for (name, value) in &wanted {
        let line = lines.iter().find(|line| line.name == *name).unwrap();
        assert_eq!(line.value.as_deref().map(str::trim), Some(value.to_string().as_str()), "{line:?}");
    }
    for (name, value, said) in [
        ("brightness", FeatureValue::Integer(256), "allowed 0 to 255"),
        ("brightness", text("bright"), "it is of type integer, allowed 0 to 255"),
        ("menu", text("Menu Item 2"), "allowed Menu Item 1, Menu Item 3, Menu Item 4"),
        ("britness", FeatureValue::Integer(1), "the camera has no such control; it has "),
    ] {
        let line = refusal(&vivid(PixelFormat::Mono8, &[(name, value)]));
        assert!(line.contains(said), "{line}");
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn unknown_sizes_rates_and_formats_are_refused_with_the_known_ones() {
    let plain = vivid(PixelFormat::Mono8, &[]);
    let size = refusal(&config::Camera { width_px: Some(512), height_px: Some(512), ..plain.clone() });
    assert!(
        size.contains("cannot set camera feature width_px to 512: the camera keeps ") && size.contains("320x180"),
        "{size}"
    );
    let rate = refusal(&config::Camera { frame_rate_hz: Some(1000.0), ..plain });
    assert!(rate.contains("cannot set camera feature frame_rate_hz to 1000: the camera keeps 60.000"), "{rate}");
    let cameras = list();
    let vivid = cameras.iter().find(|camera| camera.path.to_str() == Some(VIVID)).unwrap();
    assert_eq!((vivid.capability.driver.as_str(), vivid.capability.card.as_str()), ("vivid", "vivid"));
    let grey = vivid.formats.iter().find(|format| format.code == "GREY").unwrap();
    assert_eq!(grey.ring_format, Some(PixelFormat::Mono8));
    assert!(grey.sizes.to_string().starts_with("320x180, "), "{}", grey.sizes);
    let (size, rates) = &grey.rates[0];
    assert_eq!((size.width_px, size.height_px), SIZE);
    assert!(rates.to_string().contains("60"), "{rates}");
    for id in ["video0", "vivid", vivid.capability.bus.as_str()] {
        V4l2Camera::open(&config::Camera { id: Some(id.into()), ..camera_settings() }).unwrap();
    }
    assert!(refusal(&config::Camera { id: Some("nobody".into()), ..camera_settings() }).contains(VIVID));
}

/// Has one buffer damaged and returns its number, and those of the complete frames around it.
fn damage_one(slots: &Slots, camera: &mut V4l2Camera) -> (u64, Vec<u64>) {
    inject(Fault::DamageBuffer, 1);
    let (mut torn, mut taken) = (Vec::new(), Vec::new());
    while taken.len() < 20 {
        match next(camera).unwrap() {
            Next::Frame(slot, meta) => {
                taken.push(meta.sequence);
                slots.give_back(slot, camera);
            }
            Next::Incomplete(slot, reason) => {
                torn.push(reason);
                slots.give_back(slot, camera);
            }
            other => panic!("{other:?}"),
        }
    }
    torn.retain(|reason| !reason.ends_with(": not later than the previous frame"));
    let number =
        |reason: &str| reason.strip_prefix("frame ")?.strip_suffix(": the driver marks it as damaged")?.parse().ok();
    match torn.as_slice() {
        [reason] => (number(reason).unwrap_or_else(|| panic!("{reason}")), taken),
        _ => panic!("{torn:?}, {taken:?}"),
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn a_damaged_buffer_is_one_torn_frame_and_dropped_ones_are_gaps() {
    let (slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[]));
    let mut before = frame(&mut camera).1;
    assert_eq!(before, 0);
    // A driver whose thread is late by half a frame gives the next frame the same number. Then there is no gap.
    let is_gap = (0..10).any(|_| {
        let (damaged, taken) = damage_one(&slots, &mut camera);
        let is_new = damaged > before && !taken.contains(&damaged);
        before = *taken.last().unwrap();
        is_new
    });
    assert!(is_gap, "a torn frame is a gap");
    inject(Fault::DropPercent, 50);
    let mut last = before;
    for _ in 0..20 {
        let (slot, sequence) = frame(&mut camera);
        last = sequence;
        slots.give_back(slot, &mut camera);
    }
    inject(Fault::DropPercent, 0);
    assert!(last >= before + 20 + 5, "half of the frames were dropped, {} counted", last - before);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn the_count_continues_over_its_32_bit_wrap() {
    inject(Fault::WrapSequence, 1);
    let (slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[]));
    // The count starts 128 below the wrap. Frames that a stalled machine skips are gaps.
    let mut last = None;
    while last.is_none_or(|last| last < 140) {
        let (slot, sequence) = frame(&mut camera);
        let follows = last.is_none_or(|last| sequence > last && sequence - last < 1 << 16);
        assert!(follows, "{sequence} after {last:?}");
        last = Some(sequence);
        slots.give_back(slot, &mut camera);
    }
    drop(camera);
    inject(Fault::WrapSequence, 0);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn an_unplugged_or_broken_camera_has_vanished_and_can_be_opened_again() {
    for (fault, word) in [(Fault::FatalStreamError, "input/output error"), (Fault::Disconnect, "unplugged")] {
        let (_slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[]));
        frame(&mut camera);
        inject(fault, 1);
        let error = loop {
            match next(&mut camera) {
                Ok(_) => {}
                Err(error) => break error,
            }
        };
        assert!(matches!(error, CameraError::Lost { .. }) && error.to_string().contains(word), "{error}");
        drop(camera);
        let (_slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[]));
        assert_eq!(frame(&mut camera).1, 0);
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn a_camera_in_use_is_refused_with_the_reason_and_a_timeout_harms_nothing() {
    let (slots, mut camera) = start(&config::Camera { frame_rate_hz: Some(2.0), ..vivid(PixelFormat::Mono8, &[]) });
    assert!(refusal(&vivid(PixelFormat::Mono12, &[])).ends_with("another program uses it"));
    let mut vain = 0;
    for wanted in 0..2 {
        let (slot, sequence) = loop {
            match camera.next(Duration::from_millis(5)).unwrap() {
                Next::Frame(slot, meta) => break (slot, meta.sequence),
                Next::Timeout => vain += 1,
                other => panic!("{other:?}"),
            }
        };
        assert!(sequence >= wanted, "{sequence}");
        slots.give_back(slot, &mut camera);
    }
    assert!(vain > 10);
}
