//! Images of ROS 2 recordings.

use super::compressed;
use bytes::Bytes;
use foxglove::messages::{RawImage, Timestamp};

/// The schema of an image.
pub(super) const SCHEMA_NAME: &str = "sensor_msgs/msg/Image";
/// The schema of a compressed image.
pub(super) const COMPRESSED_SCHEMA_NAME: &str = "sensor_msgs/msg/CompressedImage";

/// Length of the encapsulation header. Alignment counts from its end.
const ENCAPSULATION_BYTES: usize = 4;

/// Decodes a `sensor_msgs/msg/Image` in little-endian CDR (OMG DDS-XTypes 1.3, section 7.4.3).
pub(super) fn decode_image(message: &Bytes) -> Result<RawImage, String> {
    decode_cdr(message, parse_image)
}

/// Decodes a `sensor_msgs/msg/CompressedImage` in the same encoding.
pub(super) fn decode_compressed_image(message: &Bytes) -> Result<RawImage, String> {
    decode_cdr(message, parse_compressed_image)
}

/// Checks the encapsulation of a message and parses its fields with `parse`, which returns `None` when the message ends
/// too early.
///
/// # Errors
///
/// The reason when the message is not little-endian CDR or ends too early, and that of `parse`.
fn decode_cdr(
    message: &Bytes,
    parse: impl FnOnce(&mut Cdr<'_>) -> Option<Result<RawImage, String>>,
) -> Result<RawImage, String> {
    match message.get(..2) {
        Some([0, 1]) => {}
        _ => return Err("the message is not little-endian CDR".into()),
    }
    let mut cdr = Cdr { bytes: message, at: ENCAPSULATION_BYTES };
    parse(&mut cdr).ok_or_else(|| format!("the message ends within its fields, at byte {}", cdr.at))?
}

/// Parses the fields of a `sensor_msgs/msg/CompressedImage` and decodes its picture; `None` when the message ends too
/// early.
fn parse_compressed_image(cdr: &mut Cdr<'_>) -> Option<Result<RawImage, String>> {
    let (seconds, nanoseconds) = (cdr.u32()?, cdr.u32()?);
    let (_frame_id, _format) = (cdr.text()?, cdr.text()?);
    let count = cdr.u32()? as usize;
    let payload = cdr.next_bytes(count)?;
    Some(compressed::decode_picture(payload, Some(Timestamp::new(seconds, nanoseconds))))
}

/// Parses the fields of a `sensor_msgs/msg/Image`; its pixels share the memory of the message. `None` when the message
/// ends too early, an error for big-endian pixels of 16 bits.
fn parse_image(cdr: &mut Cdr<'_>) -> Option<Result<RawImage, String>> {
    let (seconds, nanoseconds) = (cdr.u32()?, cdr.u32()?);
    let frame_id = cdr.text()?;
    let (height, width) = (cdr.u32()?, cdr.u32()?);
    let encoding = cdr.text()?;
    let is_big_endian = cdr.next_bytes(1)?[0] != 0;
    let step = cdr.u32()?;
    let count = cdr.u32()? as usize;
    let start = cdr.at;
    cdr.next_bytes(count)?;
    if is_big_endian && encoding.contains("16") {
        return Some(Err("16-bit pixels are big-endian; only little-endian ones are supported".into()));
    }
    let timestamp = Some(Timestamp::new(seconds, nanoseconds));
    let data = cdr.bytes.slice(start..start + count);
    Some(Ok(RawImage { timestamp, frame_id, width, height, encoding, step, data }))
}

/// A position in a CDR message.
struct Cdr<'a> {
    bytes: &'a Bytes,
    at: usize,
}

impl<'a> Cdr<'a> {
    /// Reads the next `count` bytes; `None` beyond the end.
    fn next_bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(count)?;
        let taken = self.bytes.get(self.at..end)?;
        self.at = end;
        Some(taken)
    }

    /// Reads a number, aligned to 4 bytes.
    fn u32(&mut self) -> Option<u32> {
        let offset = self.at - ENCAPSULATION_BYTES;
        self.at += offset.next_multiple_of(4) - offset;
        self.next_bytes(4)?.try_into().ok().map(u32::from_le_bytes)
    }

    /// Reads a string, whose 32-bit length includes the closing zero; bytes that are no UTF-8 are replaced.
    fn text(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        let bytes = self.next_bytes(length)?;
        Some(String::from_utf8_lossy(bytes.strip_suffix(&[0]).unwrap_or(bytes)).into_owned())
    }
}
