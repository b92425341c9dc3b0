//! MCAP files of other programs.

use foxglove::messages::{RawImage, Timestamp};
use prost::Message as _;
use ricochet::image::PixelFormat;
use ricochet::recording::{Recording, Topic};
use std::collections::BTreeMap;
use std::io::Cursor;

/// An image message: encoding, width, height, step, bytes.
pub fn image(encoding: &'static str, width: u32, height: u32, step: u32, bytes: usize) -> Shape {
    Shape { encoding, width, height, step, bytes }
}

#[derive(Clone, Copy)]
pub struct Shape {
    encoding: &'static str,
    width: u32,
    height: u32,
    step: u32,
    bytes: usize,
}

impl Shape {
    fn message(self, fill: u8, timestamp: Option<Timestamp>) -> Vec<u8> {
        RawImage {
            timestamp,
            frame_id: String::new(),
            width: self.width,
            height: self.height,
            encoding: self.encoding.into(),
            step: self.step,
            data: vec![fill; self.bytes].into(),
        }
        .encode_to_vec()
    }
}

fn image_channel(writer: &mut mcap::Writer<Cursor<&mut Vec<u8>>>, topic: &str) -> u16 {
    let schema = writer.add_schema("foxglove.RawImage", "protobuf", &Topic::Image.schema_data()).unwrap();
    writer.add_channel(schema, topic, "protobuf", &BTreeMap::new()).unwrap()
}

fn header(channel_id: u16, log_time: u64) -> mcap::records::MessageHeader {
    mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: 0 }
}

/// A file with these images on `/cam`, 1 ms apart from 1 s on.
pub fn file(options: mcap::WriteOptions, images: &[Shape]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = options.create(Cursor::new(&mut bytes)).unwrap();
    let channel = image_channel(&mut writer, "/cam");
    for (index, image) in images.iter().enumerate() {
        let time = 1_000_000_000 + index as u64 * 1_000_000;
        writer.write_to_known_channel(&header(channel, time), &image.message(index as u8, None)).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

fn open(bytes: &[u8]) -> (tempfile::TempDir, Recording) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("foreign.mcap");
    std::fs::write(&path, bytes).unwrap();
    let recording = Recording::open(&path).unwrap();
    (folder, recording)
}

#[test]
fn images_alone_are_enough_in_any_chunking_and_compression() {
    let plain = || mcap::WriteOptions::new().compression(None);
    let packings = [
        plain(),
        plain().use_chunks(false),
        plain().emit_message_indexes(false).emit_chunk_indexes(false),
        plain().repeat_channels(false).repeat_schemas(false),
        mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd)),
        mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4)).chunk_size(Some(100)),
    ];
    for (number, options) in packings.into_iter().enumerate() {
        let (_folder, recording) = open(&file(options, &[image("mono8", 5, 3, 7, 21); 4]));
        assert_eq!(recording.frame_count(), 4, "packing {number}");
        assert!(!recording.is_ours());
        let frames: Vec<_> = recording.frames().unwrap().map(Result::unwrap).collect();
        for (index, (meta, pixels)) in frames.iter().enumerate() {
            assert_eq!((meta.sequence, meta.epoch), (index as u64, 0));
            assert_eq!(meta.stamp_ns, 1_000_000_000 + index as u64 * 1_000_000);
            assert_eq!((meta.width_px, meta.height_px, meta.stride_bytes), (5, 3, 7));
            assert_eq!(pixels, &vec![index as u8; 21]);
        }
        assert_eq!(recording.frame_rate_hz().unwrap(), Some(1000.0));
    }
}

#[test]
fn both_names_of_both_depths_are_understood_and_colours_are_refused() {
    let encodings = [
        ("mono8", 4, PixelFormat::Mono8),
        ("8UC1", 4, PixelFormat::Mono8),
        ("mono16", 8, PixelFormat::Mono16),
        ("16UC1", 8, PixelFormat::Mono16),
    ];
    for (encoding, step, format) in encodings {
        let bytes = file(mcap::WriteOptions::new(), &[image(encoding, 4, 2, step, 2 * step as usize)]);
        assert_eq!(open(&bytes).1.first_frame().unwrap().format, format);
    }
    for encoding in ["rgb8", "bayer_rggb8", "32FC1", ""] {
        let bytes = file(mcap::WriteOptions::new(), &[image(encoding, 4, 2, 16, 32)]);
        let error = open(&bytes).1.first_frame().unwrap_err().to_string();
        assert!(error.contains(&format!("{encoding:?}")) && error.contains("mono8"), "{error}");
    }
}

#[test]
fn contradictory_sizes_are_refused() {
    let odd = [
        image("mono8", 4, 2, 4, 7),
        image("mono8", 4, 2, 4, 9),
        image("mono8", 4, 2, 3, 6),
        image("mono16", 4, 2, 4, 8),
        image("mono8", 0, 2, 4, 8),
        image("mono8", 4, 0, 4, 0),
        image("mono8", u32::MAX, u32::MAX, u32::MAX, 8),
    ];
    for shape in odd {
        let error = open(&file(mcap::WriteOptions::new(), &[shape])).1.first_frame().unwrap_err().to_string();
        assert!(error.contains("frame 0") && error.contains("are not"), "{error}");
    }
}

#[test]
fn the_timestamp_of_the_image_is_preferred_to_the_log_time() {
    let mut bytes = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut bytes)).unwrap();
    let channel = image_channel(&mut writer, "/cam");
    let shape = image("mono8", 2, 2, 2, 4);
    for (log_time, second) in [(50, 7), (10, 5)] {
        let message = shape.message(0, Some(Timestamp::new(second, 3)));
        writer.write_to_known_channel(&header(channel, log_time), &message).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let stamps: Vec<_> = open(&bytes).1.frames().unwrap().map(|frame| frame.unwrap().0.stamp_ns).collect();
    assert_eq!(stamps, [5_000_000_003, 7_000_000_003], "in the order of the log time");
}

#[test]
fn a_file_without_an_image_topic_is_refused_with_its_topics() {
    let none = file(mcap::WriteOptions::new(), &[]);
    let error = open(&none).1.frames().unwrap_err().to_string();
    assert!(error.contains("it has no frames"), "{error}");

    let mut bytes = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema("std_msgs/String", "ros2msg", b"string data").unwrap();
    writer.add_channel(schema, "/chatter", "cdr", &BTreeMap::new()).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let error = open(&bytes).1.frames().unwrap_err().to_string();
    assert!(error.contains("no image topic") && error.contains("/chatter (std_msgs/String)"), "{error}");

    let mut bytes = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut bytes)).unwrap();
    for topic in ["/left", "/right"] {
        let channel = image_channel(&mut writer, topic);
        let message = image("mono8", 2, 2, 2, 4).message(0, None);
        writer.write_to_known_channel(&header(channel, 1), &message).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let error = open(&bytes).1.frames().unwrap_err().to_string();
    assert!(error.contains("more than one image topic: /left, /right"), "{error}");
}

#[test]
fn a_topic_of_our_name_with_another_schema_is_refused() {
    let mut bytes = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema("geometry_msgs/Twist", "jsonschema", b"{}").unwrap();
    writer.add_channel(schema, "/velocity", "json", &BTreeMap::new()).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let error = open(&bytes).1.velocities().unwrap_err().to_string();
    assert!(error.contains("/velocity") && error.contains("geometry_msgs/Twist"), "{error}");
}

/// A `sensor_msgs/msg/Image` in little-endian CDR, aligned as the standard requires.
fn ros2_image(frame_id: &str, encoding: &str, size: [u32; 2], step: u32, data: &[u8]) -> Vec<u8> {
    let mut body: Vec<u8> = Vec::new();
    let number = |body: &mut Vec<u8>, value: u32| {
        body.resize(body.len().next_multiple_of(4), 0);
        body.extend(value.to_le_bytes());
    };
    let text = |body: &mut Vec<u8>, text: &str| {
        number(body, text.len() as u32 + 1);
        body.extend(text.as_bytes());
        body.push(0);
    };
    number(&mut body, 12);
    number(&mut body, 34);
    text(&mut body, frame_id);
    number(&mut body, size[1]);
    number(&mut body, size[0]);
    text(&mut body, encoding);
    body.push(0);
    number(&mut body, step);
    number(&mut body, data.len() as u32);
    body.extend(data);
    [&[0, 1, 0, 0][..], &body].concat()
}

#[test]
fn ros_2_images_are_read_and_truncated_ones_refused() {
    for (frame_id, encoding) in [("", "mono8"), ("camera", "8UC1"), ("cam_1", "mono8")] {
        let message = ros2_image(frame_id, encoding, [3, 2], 4, &[1, 2, 3, 0, 4, 5, 6, 0]);
        for length in 0..=message.len() {
            let mut bytes = Vec::new();
            let mut writer = mcap::Writer::new(Cursor::new(&mut bytes)).unwrap();
            let schema = writer.add_schema("sensor_msgs/msg/Image", "ros2msg", b"...").unwrap();
            let channel = writer.add_channel(schema, "/image_raw", "cdr", &BTreeMap::new()).unwrap();
            writer.write_to_known_channel(&header(channel, 1), &message[..length]).unwrap();
            writer.finish().unwrap();
            drop(writer);
            let frame = open(&bytes).1.frames().unwrap().next().unwrap();
            if length < message.len() {
                assert!(frame.unwrap_err().to_string().contains("frame 0"), "cut at {length}");
                continue;
            }
            let (meta, pixels) = frame.unwrap();
            assert_eq!((meta.width_px, meta.height_px, meta.stride_bytes, meta.stamp_ns), (3, 2, 4, 12_000_000_034));
            assert_eq!(pixels, [1, 2, 3, 0, 4, 5, 6, 0]);
        }
    }
}
