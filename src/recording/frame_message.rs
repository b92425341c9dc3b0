//! Frames encoded as messages.

use super::container::MESSAGE_OVERHEAD_BYTES;
use super::schema::proto;
use crate::image::{Frame, PixelFormat};
use foxglove::messages::{RawImage, Timestamp};
use prost::Message;
use prost::encoding::{WireType, encode_key, encode_varint};

/// Field number of `data` in `foxglove.RawImage`.
const DATA_TAG: u32 = 6;

/// Encodes the frame information: the properties that the image message cannot hold, and the CRC-32 of the pixels.
/// Replaces the content of `message`.
pub(super) fn encode_info(frame: &Frame<'_>, pixels_crc32: u32, message: &mut Vec<u8>) {
    let meta = &frame.meta;
    message.clear();
    message.extend(
        proto::FrameInfo {
            sequence: meta.sequence,
            epoch: meta.epoch,
            stamp_ns: meta.stamp_ns,
            device_ns: meta.device_ns,
            pixel_format: meta.format as u32,
            pixels_crc32,
        }
        .encode_to_vec(),
    );
}

/// Encodes the image message up to its pixels, with their length. The pixels come last, so they need no copy. Replaces
/// the content of `message`.
pub(super) fn encode_image_head(frame: &Frame<'_>, message: &mut Vec<u8>) {
    let meta = &frame.meta;
    let encoding = match meta.format {
        PixelFormat::Mono8 => "mono8",
        PixelFormat::Mono10 | PixelFormat::Mono12 | PixelFormat::Mono16 => "mono16",
    };
    let header = RawImage {
        timestamp: Some(timestamp(meta.stamp_ns)),
        frame_id: "camera".into(),
        width: meta.width_px,
        height: meta.height_px,
        encoding: encoding.into(),
        step: meta.stride_bytes,
        data: Default::default(),
    };
    message.clear();
    message.extend(header.encode_to_vec());
    encode_key(DATA_TAG, WireType::LengthDelimited, message);
    encode_varint(frame.bytes.len() as u64, message);
}

/// Converts ns since the Unix epoch to Foxglove's timestamp. Seconds beyond 32 bits saturate.
pub(super) fn timestamp(stamp_ns: u64) -> Timestamp {
    let seconds = u32::try_from(stamp_ns / 1_000_000_000).unwrap_or(u32::MAX);
    Timestamp::new(seconds, (stamp_ns % 1_000_000_000) as u32)
}

/// Returns an upper bound of the size of a frame's two messages in a file, bytes.
pub(super) fn expected_bytes(frame: &Frame<'_>) -> u64 {
    /// Both messages without the pixels.
    const HEADERS_BYTES: u64 = 256;
    frame.bytes.len() as u64 + HEADERS_BYTES + 2 * MESSAGE_OVERHEAD_BYTES
}
