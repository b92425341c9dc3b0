//! Run in the virtual machine only, one after the other.

use super::drivers::{Fault, LOOPBACK, VIVID, Writer, inject};
use crate::camera_contract;
use crate::slots::Slots;
use ricochet::camera::v4l2::{V4l2Camera, V4l2Settings, features, list, sys};
use ricochet::camera::{Camera, CameraError, CameraIdentity, Next, Pace, Slot, StreamFormat};
use ricochet::config::FeatureValue;
use ricochet::image::PixelFormat;
use std::collections::BTreeMap;
use std::time::Duration;

/// How many tests are in this file; whoever adds one counts it.
pub const TESTS: usize = 10;

const SIZE: (u32, u32) = (320, 180);
const WAIT: Duration = Duration::from_millis(100);
/// Waits without a frame after which a camera counts as stuck.
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

/// A camera whose sequences are shifted to the numbers that its first frame carries.
struct Numbered {
    camera: V4l2Camera,
    shift: Option<u64>,
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
    fn next(&mut self, timeout: Duration) -> Result<Next, CameraError> {
        let Next::Frame(mut slot, mut meta) = self.camera.next(timeout)? else { return Ok(Next::Nothing) };
        let number = u64::from_le_bytes(slot.bytes_mut()[..8].try_into().unwrap());
        meta.sequence += *self.shift.get_or_insert(number);
        Ok(Next::Frame(slot, meta))
    }
}

fn vivid(format: PixelFormat, features: &[(&str, FeatureValue)]) -> V4l2Settings {
    V4l2Settings {
        id: VIVID.into(),
        width_px: Some(SIZE.0),
        height_px: Some(SIZE.1),
        pixel_format: Some(format),
        frame_rate_hz: Some(60.0),
        features: features.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect::<BTreeMap<_, _>>(),
        ..V4l2Settings::default()
    }
}

fn text(word: &str) -> FeatureValue {
    FeatureValue::Text(word.into())
}

/// A white picture without writing on it.
fn white() -> [(&'static str, FeatureValue); 2] {
    [("test_pattern", text("100% White")), ("osd_text_mode", text("None"))]
}

fn start(settings: &V4l2Settings) -> (Slots, V4l2Camera) {
    let mut camera = V4l2Camera::open(settings).unwrap();
    let mut slots = Slots::new(camera.slots(), camera.format().slot_bytes());
    slots.queue_all(&mut camera);
    camera.start().unwrap();
    (slots, camera)
}

/// What comes next, waited for.
fn next(camera: &mut V4l2Camera) -> Result<Next, CameraError> {
    for _ in 0..WAITS {
        match camera.next(WAIT) {
            Ok(Next::Nothing) => {}
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

fn refusal(settings: &V4l2Settings) -> String {
    V4l2Camera::open(settings).unwrap_err().to_string()
}

#[test]
#[ignore = "runs in the virtual machine"]
fn known_frames_arrive_bit_for_bit_in_order_with_every_gap_counted() {
    let _writer = Writer::start((512, 512), sys::FOURCC_GREY, Duration::from_millis(4), draw);
    let settings = V4l2Settings { id: LOOPBACK.into(), ..V4l2Settings::default() };
    let camera = V4l2Camera::open(&settings).unwrap();
    assert_eq!((camera.format().width_px, camera.format().height_px), (512, 512));
    camera_contract::check(Box::new(Numbered { camera, shift: None }), 300, &draw);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn luma_of_packed_colour_arrives_bit_for_bit() {
    let _writer = Writer::start((320, 240), sys::FOURCC_YUYV, Duration::from_millis(4), |number, pixels| {
        let mut luma = vec![0; pixels.len() / 2];
        draw(number, &mut luma);
        pixels.chunks_exact_mut(2).zip(luma).for_each(|(pair, luma)| pair.copy_from_slice(&[luma, !luma]));
    });
    let settings = V4l2Settings { id: LOOPBACK.into(), ..V4l2Settings::default() };
    let camera = V4l2Camera::open(&settings).unwrap();
    camera_contract::check(Box::new(Numbered { camera, shift: None }), 100, &draw);
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
    camera_contract::check(Box::new(camera), 60, &|_, pixels| pixels.fill(WHITE));
}

/// White as vivid draws it: the top of the range that television leaves to luma.
const WHITE: u8 = 235;

#[test]
#[ignore = "runs in the virtual machine"]
fn each_format_has_the_bits_its_name_says() {
    let white16 = u16::from(WHITE);
    for (format, wanted) in
        [(PixelFormat::Mono10, white16 << 2), (PixelFormat::Mono12, white16 << 4), (PixelFormat::Mono16, white16 << 8)]
    {
        let (_slots, mut camera) = start(&vivid(format, &white()));
        let (mut slot, _) = frame(&mut camera);
        let bytes = slot.bytes_mut().to_vec();
        assert_eq!(bytes.len(), (SIZE.0 * SIZE.1 * 2) as usize);
        // What lies below the upper eight bits is the driver's: some repeat, some leave 0.
        let shift = format.bits() - 8;
        for pair in bytes.chunks_exact(2) {
            let value = u16::from_le_bytes([pair[0], pair[1]]);
            assert_eq!(value >> shift, wanted >> shift, "{format:?}: {value:#x}");
        }
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn controls_are_set_and_read_back_and_wrong_ones_are_refused_with_the_range() {
    let wanted = [
        ("brightness", FeatureValue::Integer(77)),
        ("boolean", FeatureValue::Bool(false)),
        // Without effect while the automatic one is on.
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
    assert_eq!((camera.path.to_str(), camera.closed), (Some(VIVID), None));
    for (name, value) in &wanted {
        let line = lines.iter().find(|line| line.name == *name).unwrap();
        assert_eq!(line.value.as_deref().map(str::trim), Some(value.to_string().as_str()), "{line:?}");
    }
    for (name, value, said) in [
        ("brightness", FeatureValue::Integer(256), "allowed 0 to 255"),
        ("brightness", text("bright"), "it is of type integer, allowed 0 to 255"),
        ("menu", text("Menu Item 2"), "allowed Menu Item 0, Menu Item 1, Menu Item 3, Menu Item 4"),
        ("britness", FeatureValue::Integer(1), "the camera has no such control; it has "),
    ] {
        let line = refusal(&vivid(PixelFormat::Mono8, &[(name, value)]));
        assert!(line.contains(said), "{line}");
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn sizes_rates_and_formats_that_are_not_there_are_refused_and_listed() {
    let plain = vivid(PixelFormat::Mono8, &[]);
    let size = refusal(&V4l2Settings { width_px: Some(512), height_px: Some(512), ..plain.clone() });
    assert!(
        size.contains("set camera feature width_px to 512: the camera keeps ") && size.contains("320x180"),
        "{size}"
    );
    let rate = refusal(&V4l2Settings { frame_rate_hz: Some(1000.0), ..plain });
    assert!(rate.contains("set camera feature frame_rate_hz to 1000: the camera keeps 60.000"), "{rate}");
    let cameras = list();
    let vivid = cameras.iter().find(|camera| camera.path.to_str() == Some(VIVID)).unwrap();
    assert_eq!((vivid.capability.driver.as_str(), vivid.capability.card.as_str()), ("vivid", "vivid"));
    let grey = vivid.formats.iter().find(|format| format.code == "GREY").unwrap();
    assert_eq!(grey.becomes, Some(PixelFormat::Mono8));
    assert!(grey.sizes.to_string().starts_with("320x180, "), "{}", grey.sizes);
    let (size, rates) = &grey.rates[0];
    assert_eq!(*size, SIZE);
    assert!(rates.to_string().contains("60"), "{rates}");
    for id in ["video0", "vivid", vivid.capability.bus.as_str()] {
        V4l2Camera::open(&V4l2Settings { id: id.into(), ..V4l2Settings::default() }).unwrap();
    }
    assert!(refusal(&V4l2Settings { id: "nobody".into(), ..V4l2Settings::default() }).contains(VIVID));
}

#[test]
#[ignore = "runs in the virtual machine"]
fn a_damaged_buffer_is_one_torn_frame_and_dropped_ones_are_gaps() {
    let (slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[]));
    assert_eq!(frame(&mut camera).1, 0);
    inject(Fault::DamageBuffer, 1);
    let (mut damaged, mut taken, mut last) = (0, 0, 0);
    while taken < 20 {
        match next(&mut camera).unwrap() {
            Next::Frame(slot, meta) => {
                (taken, last) = (taken + 1, meta.sequence);
                slots.give_back(slot, &mut camera);
            }
            Next::Torn(slot, reason) => {
                assert!(reason.ends_with("the driver marks it as damaged"), "{reason}");
                damaged += 1;
                slots.give_back(slot, &mut camera);
            }
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(damaged, 1);
    assert_eq!(last, taken + damaged, "a torn frame is a gap");
    inject(Fault::DropPercent, 50);
    for _ in 0..20 {
        let (slot, sequence) = frame(&mut camera);
        last = sequence;
        slots.give_back(slot, &mut camera);
    }
    inject(Fault::DropPercent, 0);
    assert!(last >= taken + damaged + 20 + 5, "half of the frames were dropped, {last} counted");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn the_count_goes_on_over_its_32_bit_wrap() {
    inject(Fault::WrapSequence, 1);
    let (slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[]));
    // It starts 128 below the wrap.
    for wanted in 0..140 {
        let (slot, sequence) = frame(&mut camera);
        assert_eq!(sequence, wanted);
        slots.give_back(slot, &mut camera);
    }
    drop(camera);
    inject(Fault::WrapSequence, 0);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn an_unplugged_or_broken_camera_has_vanished_and_can_be_opened_again() {
    for (fault, word) in [(Fault::FatalStreamError, "gave up"), (Fault::Disconnect, "unplugged")] {
        let (_slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[]));
        frame(&mut camera);
        inject(fault, 1);
        let error = loop {
            match next(&mut camera) {
                Ok(_) => {}
                Err(error) => break error,
            }
        };
        assert!(matches!(error, CameraError::Vanished { .. }) && error.to_string().contains(word), "{error}");
        drop(camera);
        let (_slots, mut camera) = start(&vivid(PixelFormat::Mono8, &[]));
        assert_eq!(frame(&mut camera).1, 0);
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn a_camera_in_use_is_refused_with_the_reason_and_a_wait_in_vain_harms_nothing() {
    let (slots, mut camera) = start(&V4l2Settings { frame_rate_hz: Some(2.0), ..vivid(PixelFormat::Mono8, &[]) });
    assert!(refusal(&vivid(PixelFormat::Mono12, &[])).ends_with("another program uses it"));
    let mut vain = 0;
    for wanted in 0..2 {
        let (slot, sequence) = loop {
            match camera.next(Duration::from_millis(5)).unwrap() {
                Next::Frame(slot, meta) => break (slot, meta.sequence),
                Next::Nothing => vain += 1,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(sequence, wanted);
        slots.give_back(slot, &mut camera);
    }
    assert!(vain > 10);
}
