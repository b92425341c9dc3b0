//! Extracts of a recording as separate files: its results without frames, or its frames for ROS 2.

use super::container::{Container, Payload, Settings};
use super::message_copy::Copier;
use super::part_file;
use super::part_file::PartFile;
use super::record::{Channel, MessageHeader, Schema};
use super::{CONTINUED_NAME, Compression, Recording, RecordingError, RecordingWriter, Topic, WriterOptions, split};
use crate::image::{FrameMeta, PixelFormat};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// The options of a file of results. Small messages compress well, and a reader loads whole chunks, so these are small.
const RESULTS: WriterOptions =
    WriterOptions { compression: Compression::Zstd1, chunk_bytes: 1 << 20, split_bytes: None };
/// Size at which a chunk of a ROS 2 recording is closed, bytes.
const ROS2_CHUNK_BYTES: u64 = 4 << 20;
/// The topic that camera drivers of ROS publish on.
const ROS2_TOPIC: &str = "/camera/image_raw";
const ROS2_SCHEMA_NAME: &str = "sensor_msgs/msg/Image";
/// The definition of the message and of its parts, as in ROS 2 bags.
const ROS2_SCHEMA: &str = "\
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Copies everything but the frames into a new, compressed recording; returns the number of messages.
///
/// Metadata and attachments are copied too. Each chunk stays a chunk, so a reader of one topic skips the others.
///
/// # Errors
///
/// [`RecordingError`] when the old file cannot be opened or is damaged, or the new one cannot be written.
pub fn copy_results(from: &Path, to: &Path) -> Result<u64, RecordingError> {
    let recording = Recording::open(from)?;
    let mut writer = RecordingWriter::start(to, part_file::part_path(to), &RESULTS)?;
    match copy_content(&recording, &mut writer) {
        Ok(messages) => {
            writer.finish()?;
            Ok(messages)
        }
        Err(error) => {
            drop(writer);
            Err(discard_part(to, error))
        }
    }
}

/// Copies metadata, attachments and rows of every file, without the entries about the split; returns the number of
/// messages.
fn copy_content(recording: &Recording, writer: &mut RecordingWriter) -> Result<u64, RecordingError> {
    for (name, entries) in recording.metadata_records().iter().filter(|(name, _)| name != CONTINUED_NAME) {
        let mut entries = entries.clone();
        // The copy is a single file.
        split::remove(&mut entries);
        writer.write_metadata(name, entries)?;
    }
    for attachment in recording.attachments() {
        let content = recording.attachment(&attachment.name)?;
        writer.attach(&attachment.name, &attachment.media_type, &content)?;
    }
    recording.singles().map(|file| copy_rows(&file, writer)).sum()
}

/// Copies the messages of one file except frames and their information; returns their number.
///
/// # Errors
///
/// [`RecordingError::Invalid`] at the first damage; errors of the writer and the system.
fn copy_rows(recording: &Recording, writer: &mut RecordingWriter) -> Result<u64, RecordingError> {
    let mut copier = Copier::new(recording, writer);
    let is_of_frames = |channel: u16| {
        let named = recording.channels().get(&channel).is_some_and(|c| Topic::FrameInfo.is_named_by(&c.topic));
        recording.is_image(channel) || named && recording.is_ours()
    };
    for number in 0..recording.section_count() {
        // A chunk of frames only is not loaded.
        if recording.section_channels(number).is_some_and(|channels| channels.into_iter().all(is_of_frames)) {
            continue;
        }
        let damage = recording.visit_section(number, |message| match is_of_frames(message.header.channel) {
            true => Ok(()),
            false => copier.write(&message),
        })?;
        if let Some(reason) = damage {
            return Err(RecordingError::invalid(recording.path(), reason));
        }
        copier.end_chunk()?;
    }
    Ok(copier.messages())
}

/// Writes the frames as `sensor_msgs/msg/Image` in CDR, as ROS 2 records them; returns their number.
///
/// # Errors
///
/// [`RecordingError`] when the old file cannot be read, or the new one cannot be written.
pub fn copy_as_ros2(from: &Recording, to: &Path) -> Result<u64, RecordingError> {
    let frames = from.frames()?;
    let part = part_file::part_path(to);
    let file = part_file::create(to, &part)?;
    let written = write_ros2(file, &part, frames);
    match written.and_then(|count| part_file::publish(to, &part).map(|()| count)) {
        Ok(count) => Ok(count),
        Err(error) => Err(discard_part(to, error)),
    }
}

/// Removes the unfinished file of `to`, which can be made again, and returns `error` unchanged.
fn discard_part(to: &Path, error: RecordingError) -> RecordingError {
    let _ = std::fs::remove_file(part_file::part_path(to));
    error
}

/// Writes frames to a complete ROS 2 recording and syncs it; returns their number.
fn write_ros2(file: std::fs::File, part: &Path, frames: super::Frames) -> Result<u64, RecordingError> {
    let failure = |error: io::Error| RecordingError::io("write", part, error);
    let handle = file.try_clone().map_err(failure)?;
    let settings = Settings { profile: "ros2", compression: Compression::None, chunk_bytes: ROS2_CHUNK_BYTES };
    let mut container = Container::create(PartFile::new(file), settings).map_err(failure)?;
    let data = ROS2_SCHEMA.as_bytes().to_vec();
    let schema = Schema { name: ROS2_SCHEMA_NAME.into(), encoding: "ros2msg".into(), data };
    let schema = container.register_schema(&schema).map_err(failure)?;
    let channel = Channel { schema, topic: ROS2_TOPIC.into(), encoding: "cdr".into(), metadata: BTreeMap::new() };
    let channel = container.register_channel(&channel).map_err(failure)?;
    let mut message = Vec::new();
    let mut count = 0;
    for frame in frames {
        let (meta, pixels) = frame?;
        encode_image_head(&meta, pixels.len(), &mut message).map_err(|reason| RecordingError::refused(part, reason))?;
        // The message header has room for the low half of the number only.
        let sequence = (meta.sequence & u64::from(u32::MAX)) as u32;
        let (log_time_ns, publish_time_ns) = (meta.stamp_ns, meta.stamp_ns);
        let header = MessageHeader { channel, sequence, log_time_ns, publish_time_ns };
        let image = Payload { head: &message, body: &pixels, body_crc: crc32fast::hash(&pixels) };
        container.write_message(&header, &image).map_err(failure)?;
        count += 1;
    }
    container.finish().map_err(failure)?;
    handle.sync_all().map_err(|error| RecordingError::io("sync", part, error))?;
    Ok(count)
}

/// Encodes a `sensor_msgs/msg/Image` up to its pixels in little-endian CDR (OMG DDS-XTypes 1.3, section 7.4.3), and
/// replaces the content of `message`.
///
/// Numbers are aligned to their size. Alignment counts from after the first four bytes.
///
/// # Errors
///
/// The reason when the seconds exceed 31 bits or the number of bytes exceeds 32 bits.
fn encode_image_head(meta: &FrameMeta, pixels_bytes: usize, message: &mut Vec<u8>) -> Result<(), String> {
    let seconds = i32::try_from(meta.stamp_ns / 1_000_000_000)
        .map_err(|_| format!("frame {}: its time exceeds the 32-bit seconds of ROS", meta.sequence))?;
    let count = u32::try_from(pixels_bytes)
        .map_err(|_| format!("frame {}: {pixels_bytes} bytes exceed the 32-bit length of ROS", meta.sequence))?;
    let encoding = match meta.format {
        PixelFormat::Mono8 => "mono8",
        PixelFormat::Mono10 | PixelFormat::Mono12 | PixelFormat::Mono16 => "mono16",
    };
    message.clear();
    message.extend([0, 1, 0, 0]);
    message.extend(seconds.to_le_bytes());
    put_u32((meta.stamp_ns % 1_000_000_000) as u32, message);
    put_text("camera", message);
    put_u32(meta.height_px, message);
    put_u32(meta.width_px, message);
    put_text(encoding, message);
    // Little-endian pixels.
    message.push(0);
    put_u32(meta.stride_bytes, message);
    put_u32(count, message);
    Ok(())
}

/// Appends a little-endian number, aligned to 4 bytes as CDR requires.
fn put_u32(value: u32, message: &mut Vec<u8>) {
    // The first four bytes do not count, but they keep the alignment to 4.
    message.resize(message.len().next_multiple_of(4), 0);
    message.extend(value.to_le_bytes());
}

/// Appends a CDR string: its 32-bit length with the closing zero, bytes, then the bytes and the zero.
fn put_text(value: &str, message: &mut Vec<u8>) {
    put_u32(value.len() as u32 + 1, message);
    message.extend(value.as_bytes());
    message.push(0);
}
