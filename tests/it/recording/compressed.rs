//! Compressed images in recordings of other programs.

use foxglove::messages::{CompressedImage, Timestamp};
use image::{DynamicImage, GrayImage, ImageBuffer, ImageFormat, Luma, RgbImage};
use prost::Message as _;
use ricochet::image::PixelFormat;
use ricochet::recording::{Recording, RecordingError};
use std::collections::BTreeMap;
use std::io::Cursor;

type Read = Result<(ricochet::image::FrameMeta, Vec<u8>), RecordingError>;

fn packed(picture: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture.into().write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// A file with this one message.
fn file(schema: &str, encoding: &str, message: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema(schema, "any", b"...").unwrap();
    let channel_id = writer.add_channel(schema, "/cam", encoding, &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 9, publish_time: 9 };
    writer.write_to_known_channel(&header, message).unwrap();
    writer.finish().unwrap();
    drop(writer);
    bytes
}

/// Reads the one frame of such a file.
fn read(schema: &str, encoding: &str, message: &[u8]) -> Read {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.mcap");
    std::fs::write(&path, file(schema, encoding, message)).unwrap();
    Recording::open(&path).unwrap().frames().unwrap().next().unwrap()
}

fn foxglove(payload: &[u8]) -> Read {
    read("foxglove.CompressedImage", "protobuf", &foxglove_message(payload))
}

fn foxglove_message(payload: &[u8]) -> Vec<u8> {
    let timestamp = Some(Timestamp::new(3, 4));
    let (data, format) = (payload.to_vec().into(), "png".into());
    CompressedImage { timestamp, frame_id: "camera".into(), data, format }.encode_to_vec()
}

/// Small files of both kinds.
pub fn seeds() -> [Vec<u8>; 2] {
    let picture = GrayImage::from_fn(8, 8, |x, y| Luma([shade(x, y)]));
    let (png, jpeg) = (packed(picture.clone(), ImageFormat::Png), packed(picture, ImageFormat::Jpeg));
    [
        file("foxglove.CompressedImage", "protobuf", &foxglove_message(&png)),
        file("sensor_msgs/msg/CompressedImage", "cdr", &ros2(&jpeg)),
    ]
}

/// A `sensor_msgs/msg/CompressedImage` in little-endian CDR.
fn ros2(payload: &[u8]) -> Vec<u8> {
    let mut message = vec![0, 1, 0, 0];
    message.extend(12_u32.to_le_bytes());
    message.extend(34_u32.to_le_bytes());
    message.extend([4, 0, 0, 0]);
    message.extend(b"cam\0");
    message.extend([5, 0, 0, 0]);
    message.extend(b"jpeg\0\0\0\0");
    message.extend((payload.len() as u32).to_le_bytes());
    message.extend(payload);
    message
}

fn shade(x: u32, y: u32) -> u8 {
    (x * 7 + y * 13) as u8
}

#[test]
fn png_is_read_exactly_in_both_depths_and_jpeg_within_its_loss() {
    let grey = GrayImage::from_fn(9, 5, |x, y| Luma([shade(x, y)]));
    let (meta, pixels) = foxglove(&packed(grey.clone(), ImageFormat::Png)).unwrap();
    assert_eq!((meta.width_px, meta.height_px, meta.stride_bytes, meta.stamp_ns), (9, 5, 9, 3_000_000_004));
    assert_eq!((meta.format, &pixels), (PixelFormat::Mono8, grey.as_raw()));
    let deep: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_fn(4, 3, |x, y| Luma([(x * 1000 + y * 20_000) as u16]));
    let (meta, pixels) = foxglove(&packed(deep.clone(), ImageFormat::Png)).unwrap();
    let expected: Vec<u8> = deep.as_raw().iter().flat_map(|level| level.to_le_bytes()).collect();
    assert_eq!((meta.format, meta.stride_bytes, pixels), (PixelFormat::Mono16, 8, expected));
    let smooth = GrayImage::from_fn(64, 48, |x, y| Luma([(x * 2 + y) as u8]));
    let (meta, pixels) = foxglove(&packed(smooth.clone(), ImageFormat::Jpeg)).unwrap();
    assert_eq!((meta.width_px, meta.height_px, meta.format), (64, 48, PixelFormat::Mono8));
    let off = pixels.iter().zip(smooth.as_raw()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    println!("JPEG: largest error {off} of 255");
    // At quality 75 the finest quantization steps of a smooth ramp are 8 to 16 levels of a coefficient.
    assert!(off <= 8, "{off}");
}

#[test]
fn ros_2_compressed_images_are_read_and_truncated_ones_refused() {
    let grey = GrayImage::from_fn(6, 4, |x, y| Luma([shade(x, y)]));
    let message = ros2(&packed(grey.clone(), ImageFormat::Png));
    for length in 0..message.len() {
        let error = read("sensor_msgs/msg/CompressedImage", "cdr", &message[..length]).unwrap_err();
        assert!(error.to_string().contains("frame 0"), "cut at {length}: {error}");
    }
    let (meta, pixels) = read("sensor_msgs/msg/CompressedImage", "cdr", &message).unwrap();
    assert_eq!((meta.stamp_ns, &pixels), (12_000_000_034, grey.as_raw()));
}

#[test]
fn images_that_are_no_grey_png_or_jpeg_are_refused() {
    let colour = RgbImage::from_pixel(4, 4, image::Rgb([1, 2, 3]));
    let refusal = |payload: &[u8]| {
        let line = foxglove(payload).unwrap_err().to_string();
        assert!(line.contains("frame 0") && !line.contains('\n'), "{line}");
        line
    };
    assert!(refusal(&packed(colour, ImageFormat::Png)).contains("grey"));
    assert!(refusal(b"RIFF\x10\0\0\0WEBPVP8 ").contains("neither PNG nor JPEG"));
    assert!(refusal(&packed(GrayImage::new(4, 4), ImageFormat::Bmp)).contains("neither PNG nor JPEG"));
    assert!(refusal(b"").contains("neither PNG nor JPEG"));
    // An image whose header claims more than the memory of the machine.
    let mut huge = packed(GrayImage::new(4, 4), ImageFormat::Png);
    huge[16..24].copy_from_slice(&[0, 3, 0, 0, 0, 3, 0, 0]);
    let crc = crc32fast::hash(&huge[12..29]);
    huge[29..33].copy_from_slice(&crc.to_be_bytes());
    assert!(refusal(&huge).to_lowercase().contains("limit"), "{}", refusal(&huge));
}

#[test]
fn mutated_payloads_never_panic() {
    let picture = GrayImage::from_fn(24, 16, |x, y| Luma([shade(x, y)]));
    let seeds = [ImageFormat::Png, ImageFormat::Jpeg].map(|format| packed(picture.clone(), format));
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    };
    let mut read = 0;
    for round in 0..2000 {
        let mut payload = seeds[round % 2].clone();
        for _ in 0..=random(3) {
            let at = random(payload.len());
            match random(3) {
                0 => payload[at] ^= 1 << random(8),
                1 => payload[at] = [0, 0xff, 0xd9, 0x80][random(4)],
                _ => payload.truncate(at.max(1)),
            }
        }
        read += usize::from(foxglove(&payload).is_ok());
    }
    println!("{read} of 2000 were still read");
    assert!(read > 50, "some mutations leave a readable image: {read}");
}
